"""Ask whether a dispenser is still held from an earlier attempt."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, Step, action
from grape.actions.looking import Ballot, vote
from grape.errors import ActionFailed, Reason
from grape.tasks.dispenser.actions.check_deployment import CheckDeploymentGoal, check_deployment
from grape.tasks.dispenser.actions.check_grasp import account_for_taken
from grape.tasks.dispenser.actions.withdraw_hand import WithdrawHandGoal, withdraw_hand
from grape.tasks.dispenser.conditions import IsDeployedGoal, is_deployed
from grape.tasks.dispenser.perception.wings import held
from grape.tasks.dispenser.targets import HangTarget


@dataclass(frozen=True, kw_only=True)
class HoldsDispenserGoal:
    """Attributes: frames: how many camera frames vote."""

    frames: int = 5


@action("HoldsDispenser")
def holds_dispenser(goal: HoldsDispenserGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Succeeds when the ledger says that the hand holds a dispenser and the camera agrees; else it was lost.

    What was grasped last and not seen yet may be held, too: then the ledger learns of it here.
    """
    step, in_hand = ctx.ledger.last_step(), ctx.ledger.dispensers().get("hand", 0) > 0
    if not in_hand and (step is None or step.name != "grasp"):
        raise ActionFailed(Reason.GRASP_FAILED, "nothing was grasped yet")
    ballot = yield from look_at_hand(ctx, goal.frames)
    if not in_hand and not ballot.value:
        raise ActionFailed(Reason.GRASP_FAILED, ballot.reason)
    if not in_hand:
        account_for_taken(ctx)
    elif not ballot.value:
        yield from account_for_fallen(ctx, ballot)
        raise ActionFailed(Reason.DISPENSER_FALLEN, ballot.reason)
    return NoResult()


def look_at_hand(ctx: Context, frames: int) -> Generator[Feedback, None, Ballot]:
    """Lets camera frames vote whether the nails hold a dispenser.

    Raises:
        ActionFailed: STALE_DATA when the camera stops.
    """
    ballot = yield from vote(
        ctx, lambda image: held(image).ballot, frames=frames, status="checking what the hand holds"
    )
    ctx.log.event("check", check="grasp", value=ballot.value, yes=ballot.yes, no=ballot.no, reason=ballot.reason)
    return ballot


def account_for_fallen(ctx: Context, seen: Ballot) -> Generator[Feedback, None, str]:
    """What the hand held by the account and does not hold hangs where it was put last, as far as is seen, or is lost.

    One that was put somewhere and not let go may hang askew from a nail, where it looks as if it hung on the plant: the
    hand leaves the plant before anybody looks there, and what comes along stays on the hand's account.

    Args:
        seen: what the camera saw at the nails.

    Returns:
        The plant that it hangs on, or nothing.

    Raises:
        ActionFailed: the hand could not be withdrawn.
    """
    step = ctx.ledger.last_step()
    if step is None or step.name not in ("place", "release"):
        ctx.ledger.move_dispenser("hand", "lost")
        return ""
    if step.name == "place" and held(seen.image).blobs:
        yield from withdraw_hand(WithdrawHandGoal(), ctx)
        if held((yield from look_at_hand(ctx, seen.yes + seen.no)).image).blobs:
            return ""
    hangs = yield from hangs_there(ctx, HangTarget(**step.details["target"]))
    return step.plant if hangs else ""


def hangs_there(ctx: Context, target: HangTarget) -> Generator[Feedback, None, bool]:
    """Whether it hangs; the check itself settles the account."""
    try:
        yield from check_deployment(CheckDeploymentGoal(target=target), ctx)
    except ActionFailed as failed:
        if failed.reason is not Reason.DEPLOYMENT_NOT_CONFIRMED:
            raise
        return False
    return True


def unseen(ctx: Context, step: Step) -> bool:
    """Whether a step has put a dispenser on its plant by the account, and the plant is not finished as deployed."""
    if step.name not in ("place", "release") or not ctx.ledger.dispensers()[step.plant]:
        return False
    return not is_deployed(IsDeployedGoal(plant=step.plant), ctx)
