"""Bring the held dispenser in front of a nail."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, action
from grape.actions.move_arm import move_to_pose
from grape.actions.retract import back_off
from grape.tasks.dispenser.nail_board import NailBoard, nail_target
from grape.tasks.dispenser.row import ROW, expect_row
from grape.tasks.dispenser.targets import HangTarget, hang_line


@dataclass(frozen=True, kw_only=True)
class ApproachNailGoal:
    """Where to stop before the nail.

    Attributes:
        plant: id of the nail in the site file.
        stand_off_m: of the loop before the nail.
        farther_m: each further attempt on the plant stops this much farther off, where the camera sees more.
    """

    plant: str
    stand_off_m: float = 0.14
    farther_m: float = 0.05


@dataclass(frozen=True, kw_only=True)
class ApproachNailResult:
    """Attributes: target: the nail as survey and pose estimate have it."""

    target: HangTarget


@action("ApproachNail")
def approach_nail(goal: ApproachNailGoal, ctx: Context) -> Generator[Feedback, None, ApproachNailResult]:
    """Plans to a level hand pose in front of a nail from which both markers are in view."""
    target = nail_target(ctx, goal.plant, NailBoard())
    attempts = ctx.ledger.attempt(goal.plant)
    line = hang_line(ctx.robot, target, goal.stand_off_m + min(attempts - 1, 2) * goal.farther_m)
    expect_row(ctx, goal.plant)
    with ctx.ledger.step("approach", goal.plant), ctx.arm.lease("ApproachNail") as arm:
        yield from back_off(ctx, arm)  # from where an attempt before has failed
        yield from move_to_pose(ctx, arm, line, status="moving in front of target", touch_boxes=(ROW,))
    return ApproachNailResult(target=target)
