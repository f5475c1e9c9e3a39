"""Before the robot drives on: look whether the account of the hand is still right."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, Outcome, action
from grape.errors import ActionFailed, Reason, StaleData
from grape.tasks.dispenser.actions.check_feeder import CheckFeederGoal, check_feeder
from grape.tasks.dispenser.actions.check_grasp import account_for_taken
from grape.tasks.dispenser.actions.finish_plant import FinishPlantGoal, finish_plant
from grape.tasks.dispenser.actions.holds_dispenser import account_for_fallen, hangs_there, look_at_hand, unseen
from grape.tasks.dispenser.targets import HangTarget


@dataclass(frozen=True, kw_only=True)
class CheckHandGoal:
    """How to look.

    Attributes:
        frames: how many camera frames vote.
        feeder: whether to look at the feeder as well when it is not known what the last grasp took from there.
    """

    frames: int = 9
    feeder: bool = False


@action("CheckHand")
def check_hand(goal: CheckHandGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Looks whether a dispenser that the account has in the hand is there, so that none falls unnoticed; never fails.

    It moves nothing and takes no time when the account has none there and grasp and release were looked at. A plant on
    which the dispenser turns out to hang is finished as deployed.
    """
    yield Feedback(status="checking the account of the hand")
    try:
        plant = yield from _look(goal, ctx)
        if plant:
            yield from finish_plant(FinishPlantGoal(plant=plant, outcome=Outcome.DEPLOYED), ctx)
    except ActionFailed as failed:
        ctx.log.event("not_looked", action="CheckHand", reason=str(failed.reason), detail=failed.detail)
    except StaleData as stale:
        ctx.log.event("not_looked", action="CheckHand", reason=str(Reason.STALE_DATA), detail=str(stale))
    return NoResult()


def _look(goal: CheckHandGoal, ctx: Context) -> Generator[Feedback, None, str]:
    """Look where needed; the plant on which a dispenser was found that was not known to hang there, or nothing."""
    step, places = ctx.ledger.last_step(), ctx.ledger.dispensers()
    if places["hand"]:
        ballot = yield from look_at_hand(ctx, goal.frames)
        return "" if ballot.value else (yield from account_for_fallen(ctx, ballot))
    if step is not None and step.name == "grasp":
        ballot = yield from look_at_hand(ctx, goal.frames)
        if ballot.value:
            account_for_taken(ctx)
        elif goal.feeder:
            yield from check_feeder(CheckFeederGoal(), ctx)
    elif step is not None and unseen(ctx, step):
        return step.plant if (yield from hangs_there(ctx, HangTarget(**step.details["target"]))) else ""
    return ""
