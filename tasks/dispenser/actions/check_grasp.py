"""Make sure that a dispenser hangs on the nails of the fingers."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.looking import vote
from grape.errors import ActionFailed, Reason
from grape.tasks.dispenser.perception.wings import held


@dataclass(frozen=True, kw_only=True)
class CheckGraspGoal:
    """Attributes: frames: how many camera frames vote (the reference's 50 take 3.3 s; 15 take 1 s)."""

    frames: int = 15


@action("CheckGrasp")
def check_grasp(goal: CheckGraspGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Looks for the two wings of a held dispenser; fails with GRASP_FAILED when the majority of frames shows none."""
    ballot = yield from vote(ctx, lambda image: held(image).ballot, frames=goal.frames, status="checking the grasp")
    ctx.log.event("check", check="grasp", value=ballot.value, yes=ballot.yes, no=ballot.no, reason=ballot.reason)
    ctx.log.picture("grasp", ballot.image.bgr)
    if not ballot.value:
        # Whether it fell or never left the feeder, the next look at the feeder tells.
        raise ActionFailed(Reason.GRASP_FAILED, f"{ballot.no} of {goal.frames} frames: {ballot.reason}")
    account_for_taken(ctx)
    return NoResult()


def account_for_taken(ctx: Context) -> None:
    """The hand holds one that it has not by the account: out of the feeder, or one that was given up for lost there.

    One that it had by the account, askew on a nail after its release, has fallen when another was taken.
    """
    if ctx.ledger.dispensers()["hand"]:
        ctx.ledger.move_dispenser("hand", "lost")
    ctx.ledger.move_dispenser("feeder" if ctx.ledger.dispensers()["feeder"] else "lost", "hand")
