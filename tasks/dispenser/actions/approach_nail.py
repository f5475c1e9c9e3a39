"""Bring the held dispenser in front of a nail."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, action
from grape.actions.move_arm import move_to_pose
from grape.actions.retract import back_off
from grape.tasks.dispenser.nail_board import NailBoard, nail_target
from grape.tasks.dispenser.row import row_boxes
from grape.tasks.dispenser.targets import HangTarget


@dataclass(frozen=True, kw_only=True)
class ApproachNailGoal:
    """Attributes: plant: id of the nail in the site file. stand_off_m: of the loop before the nail."""

    plant: str
    stand_off_m: float = 0.14


@dataclass(frozen=True, kw_only=True)
class ApproachNailResult:
    """Attributes: target: the nail as survey and pose estimate have it."""

    target: HangTarget


@action("ApproachNail")
def approach_nail(goal: ApproachNailGoal, ctx: Context) -> Generator[Feedback, None, ApproachNailResult]:
    """Plans to a level hand pose in front of a nail from which both markers are in view."""
    target = nail_target(ctx, goal.plant, NailBoard())
    ctx.ledger.attempt(goal.plant)
    T_hand_nails = ctx.robot.hand.T_hand_nails(ctx.robot.description.gripper.open_angle)
    line = (target.hand_pose(T_hand_nails, goal.stand_off_m), target.hand_pose(T_hand_nails, 0.0))
    with ctx.arm.lease("ApproachNail") as arm:
        yield from back_off(ctx, arm)  # from where an attempt before has failed
        yield from move_to_pose(
            ctx, arm, line, status="moving in front of target", boxes=row_boxes(ctx, goal.plant, depth_m=0.09)
        )
    return ApproachNailResult(target=target)
