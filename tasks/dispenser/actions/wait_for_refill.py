"""Stand at the refill point until somebody has refilled the feeder."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, action
from grape.actions.move_arm import move_to_joints
from grape.errors import ActionFailed, Reason
from grape.messages import Refilled
from grape.tasks.dispenser.actions.check_feeder import FEEDER_EMPTY


@dataclass(frozen=True, kw_only=True)
class WaitForRefillGoal:
    """Attributes: pose: of the arm meanwhile. timeout_s: how long to wait for a confirmation."""

    pose: str = "travel"
    timeout_s: float = 600.0


@dataclass(frozen=True, kw_only=True)
class WaitForRefillResult:
    """Attributes: added: dispensers, as the operator says; the next look at the feeder counts them."""

    added: int


@action("WaitForRefill")
def wait_for_refill(goal: WaitForRefillGoal, ctx: Context) -> Generator[Feedback, None, WaitForRefillResult]:
    """Calls the operator and keeps base, arm and hand still until a refill is confirmed; REFILL_TIMEOUT after that.

    A refill that was confirmed before, but never written down because of an interruption, counts at once.
    """
    begun_s = ctx.clock.now()
    with (
        ctx.ledger.step("refill"),
        ctx.base.lease("WaitForRefill") as base,
        ctx.arm.lease("WaitForRefill") as arm,
        ctx.gripper.lease("WaitForRefill") as fingers,
    ):
        gripper = ctx.robot.description.gripper
        closed = np.array([gripper.thumb_clear, gripper.closed_angle, gripper.closed_angle])
        still = np.asarray(ctx.robot.description.arm.poses[goal.pose])
        yield from move_to_joints(ctx, arm, (still,), status="moving out of the way", absolute=True)
        while not (told := ctx.drivers.operator.refilled(ctx.ledger.refills())):
            waited_s = ctx.clock.now() - begun_s
            if waited_s > goal.timeout_s:
                raise ActionFailed(Reason.REFILL_TIMEOUT, f"no refill was confirmed within {goal.timeout_s:.0f} s")
            ctx.drivers.operator.call()
            base.send(0.0, 0.0)
            arm.send(np.zeros(len(still)))
            fingers.send(closed)
            yield Feedback(status=f"waiting for a refill, {waited_s:.0f} s", progress=waited_s / goal.timeout_s)
        added = sum(_write_down(ctx, refill) for refill in told)
    if not added:
        raise ActionFailed(Reason.FEEDER_EMPTY, "the operator has no more dispensers")
    ctx.world.committed.pop(FEEDER_EMPTY, None)
    return WaitForRefillResult(added=added)


def _write_down(ctx: Context, refill: Refilled) -> int:
    """How many a refill has added to the account; none when it was written down before."""
    if not ctx.ledger.refill(refill.number, refill.added):
        return 0
    ctx.log.event("refilled", number=refill.number, added=refill.added)
    return refill.added
