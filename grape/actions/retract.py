"""Bring the arm to where it may travel."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import follow_hand_path, straight
from grape.actions.move_arm import checker_for, move_to_joints
from grape.drivers import ArmDriver
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
        yield from back_off(ctx, arm, goal.back_off_m)
        travel = np.asarray(ctx.robot.description.arm.poses[goal.pose])
        yield from move_to_joints(ctx, arm, (travel,), status="retracting", absolute=True)
    return NoResult()


def back_off(ctx: Context, arm: ArmDriver, distance_m: float = 0.10) -> Generator[Feedback, None, None]:
    """Moves the hand straight back along its fingers when it is too near to something to plan from there.

    Raises:
        ActionFailed: TRACKING_ERROR.
    """
    q = ctx.world.joints()
    if checker_for(ctx).is_valid(q):
        return
    T = ctx.robot.hand_pose(q)
    T_back = T @ pose(None, (0.0, 0.0, distance_m))
    yield from follow_hand_path(ctx, arm, straight(T, T_back, 2.0), 2.0, status="backing off")
