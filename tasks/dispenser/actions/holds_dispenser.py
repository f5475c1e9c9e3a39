"""Ask whether a dispenser is still held from an earlier attempt."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.looking import vote
from grape.errors import ActionFailed, Reason
from grape.tasks.dispenser.perception.wings import held


@dataclass(frozen=True, kw_only=True)
class HoldsDispenserGoal:
    """Attributes: frames: how many camera frames vote."""

    frames: int = 5


@action("HoldsDispenser")
def holds_dispenser(goal: HoldsDispenserGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Succeeds when the ledger says that the hand holds a dispenser and the camera agrees; else it was lost."""
    if ctx.ledger.dispensers().get("hand", 0) == 0:
        raise ActionFailed(Reason.GRASP_FAILED, "nothing was grasped yet")
    ballot = yield from vote(
        ctx, lambda image: held(image).ballot, frames=goal.frames, status="checking what the hand holds"
    )
    if not ballot.value:
        ctx.ledger.move_dispenser("hand", "lost")
        raise ActionFailed(Reason.DISPENSER_FALLEN, ballot.reason)
    return NoResult()
