"""After an interruption: look what became of plant and dispenser, and settle the account by it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.account import RESUMED
from grape.actions.core import Context, Feedback, NoResult, Outcome, action
from grape.tasks.dispenser.actions.check_grasp import account_for_taken
from grape.tasks.dispenser.actions.finish_plant import FinishPlantGoal, finish_plant
from grape.tasks.dispenser.actions.holds_dispenser import hangs_there, look_at_hand, unseen
from grape.tasks.dispenser.actions.withdraw_hand import release_pending
from grape.tasks.dispenser.fingers import finger_angle
from grape.tasks.dispenser.targets import HangTarget


@dataclass(frozen=True, kw_only=True)
class SettleAccountGoal:
    """Attributes: frames: how many camera frames vote on what the hand holds."""

    frames: int = 9


@action("SettleAccount")
def settle_account(goal: SettleAccountGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Settles by the camera what the ledger's last step has left open: it hangs, it is in the hand, or it is lost.

    A plant on which the dispenser hangs is finished as deployed. Whether one is missing in the feeder, the next look
    at the feeder tells.
    """
    step, places = ctx.ledger.last_step(), ctx.ledger.dispensers()
    plant = step.plant if step is not None else ""
    hangs = False
    if step is not None and release_pending(ctx, step):
        taken_back = places["hand"] > 0 and finger_angle(ctx)[1] > 0.5
        if not (taken_back and (yield from look_at_hand(ctx, goal.frames)).value):
            hangs = yield from hangs_there(ctx, HangTarget(**step.details["target"]))
    elif places["hand"] or (step is not None and step.name in ("insert", "grasp")):
        holds = (yield from look_at_hand(ctx, goal.frames)).value
        if holds and not places["hand"]:
            account_for_taken(ctx)
        elif places["hand"] and not holds and step is not None and step.name in ("place", "release"):
            hangs = yield from hangs_there(ctx, HangTarget(**step.details["target"]))
        elif places["hand"] and not holds:
            ctx.ledger.move_dispenser("hand", "lost")
    elif step is not None and unseen(ctx, step):
        hangs = yield from hangs_there(ctx, HangTarget(**step.details["target"]))
    places = ctx.ledger.dispensers()
    ctx.log.event(
        "settled", step=step.name if step else "", plant=plant, hangs=hangs, holds=places["hand"] > 0,
        places=dict(places),
    )  # fmt: skip
    if hangs:
        yield from finish_plant(FinishPlantGoal(plant=plant, outcome=Outcome.DEPLOYED), ctx)
    ctx.world.committed.pop(RESUMED, None)
    return NoResult()
