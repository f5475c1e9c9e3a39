"""Bring the arm to where it may travel."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import HandPathOptions, follow_hand_path, straight
from grape.actions.move_arm import checker_for, densely, known_joints, move_to_joints, planning_margins
from grape.drivers import ArmDriver
from grape.geometry import pose
from grape.kinematics import inverse_path
from grape.messages import Array
from grape.planning import StateChecker


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
    """Moves the hand straight away from what it is too near to, until a motion can be planned from there.

    Of the ways back along the fingers, to the robot's right, up and between them it takes the first that leads out,
    else the one that ends with most room, up to three times.

    Raises:
        ActionFailed: TRACKING_ERROR or STALE_DATA.
    """
    for _ in range(3):
        checker = checker_for(ctx, options=planning_margins(ctx))
        q = yield from known_joints(ctx)
        if checker.is_valid(q):
            return
        T = ctx.robot.hand_pose(q)
        T_back = yield from ctx.jobs.run(_way_out, ctx.robot, checker, q, T, distance_m)
        yield from follow_hand_path(
            ctx, arm, straight(T, T_back, 2.0), 2.0, status="backing off",
            options=HandPathOptions(tolerance_m=0.08, tolerance_rad=0.5),
        )  # fmt: skip


def _way_out(robot: Any, checker: StateChecker, q: Array, T: Array, distance_m: float) -> Array:
    """The hand pose (4, 4) at the end of the first straight way out, or of the one that ends with most room."""
    fingers, up, right = T[:3, 2], np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    best, most = pose(T[:3, :3], T[:3, 3] + distance_m * fingers), -np.inf
    for way in (fingers, right, up, fingers + right, up + right, fingers + up):
        T_end = pose(T[:3, :3], T[:3, 3] + distance_m * way / max(float(np.linalg.norm(way)), 1e-9))
        path = inverse_path(robot.arm, np.array(densely([robot.in_arm_base(P) for P in (T, T_end)])), q)
        if path is None:
            continue
        if checker.is_valid(path[-1]):
            return T_end
        if (room := checker.clearance(path[-1])) > most:
            best, most = T_end, room
    return best
