"""Bring the held dispenser above a spur."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.move_arm import move_to_pose
from grape.actions.retract import back_off
from grape.tasks.dispenser.targets import TOUCH_M, HangTarget, hang_line


@dataclass(frozen=True, kw_only=True)
class ApproachSpurGoal:
    """Attributes: target: the deployment pose. stand_off_m: of the loop above the spur's tip."""

    target: HangTarget
    stand_off_m: float = 0.10


@action("ApproachSpur")
def approach_spur(goal: ApproachSpurGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Plans to a pitched hand pose above a spur, collision-free against the scanned vine."""
    target = goal.target
    ctx.ledger.attempt(target.plant)
    line = hang_line(ctx.robot, target, goal.stand_off_m)
    with ctx.ledger.step("approach", target.plant), ctx.arm.lease("ApproachSpur") as arm:
        yield from back_off(ctx, arm)  # from where an attempt before has failed
        yield from move_to_pose(ctx, arm, line, status="moving in front of target", touch=(target.tip, TOUCH_M))
    return NoResult()
