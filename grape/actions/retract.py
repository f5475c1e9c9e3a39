"""Bring the arm to where it may travel."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import follow_hand_path, straight
from grape.actions.move_arm import checker_for, move_to_joints
from grape.geometry import pose


@dataclass(frozen=True, kw_only=True)
class RetractGoal:
    """Attributes: pose: the named arm pose for driving. back_off_m: first step back along the fingers when too near."""

    pose: str = "travel"
    back_off_m: float = 0.10


@action("Retract")
def retract(goal: RetractGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Backs the hand off whatever it is near and brings the arm to its stable travel pose."""
    with ctx.arm.lease("Retract") as arm:
        if not checker_for(ctx).is_valid(ctx.world.joints()):
            T = ctx.robot.hand_pose(ctx.world.joints())
            T_back = T @ pose(None, (0.0, 0.0, goal.back_off_m))
            yield from follow_hand_path(ctx, arm, straight(T, T_back, 2.0), 2.0, status="backing off")
        travel = np.asarray(ctx.robot.description.arm.poses[goal.pose])
        yield from move_to_joints(ctx, arm, (travel,), status="retracting", absolute=True)
    return NoResult()
