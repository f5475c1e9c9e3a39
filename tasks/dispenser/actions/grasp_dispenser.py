"""Take the dispenser whose loop the closed nails stand in."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import HandPathOptions, calibrated_joints, follow_hand_path, smooth_step, straight
from grape.geometry import pose, rotation_x
from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class GraspDispenserGoal:
    """How to take it.

    Attributes:
        level: of the dispenser, 0 is the lowest.
        rise_m: straight up first, so that the loop's ends come over the lips of their trays.
        drag_m: then towards the feeder's open side, out from under the level above.
        clear_m: height of the nails over the topmost level to which the dispenser is lifted straight up.
        lift_speed: m/s, mean.
        open_s, rise_s, drag_s: durations.
    """

    level: int
    rise_m: float = 0.0065
    drag_m: float = 0.024
    clear_m: float = 0.12
    lift_speed: float = 0.08
    open_s: float = 2.0
    rise_s: float = 0.6
    drag_s: float = 1.0


@action("GraspDispenser")
def grasp_dispenser(goal: GraspDispenserGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Opens the fingers inside the loop while the arm keeps the nails in place, raises it, drags it out and lifts it.

    Opening turns the nails, and the loop with them: the hand turns against it, so that both ends rise alike.
    """
    robot = ctx.robot
    gripper = robot.description.gripper
    options = HandPathOptions(calibrated=True)
    with (
        ctx.ledger.step("grasp", level=int(goal.level)),
        ctx.arm.lease("GraspDispenser") as arm,
        ctx.gripper.lease("GraspDispenser") as fingers,
    ):
        T_base_nails = robot.hand_pose(calibrated_joints(ctx)) @ robot.hand.T_hand_nails(gripper.closed_angle)

        def angle_at(t: float) -> float:
            s = smooth_step(t / goal.open_s)
            return gripper.closed_angle + s * (gripper.open_angle - gripper.closed_angle)

        def nails_held(t: float) -> Array:
            level = pose(rotation_x(smooth_step(t / goal.open_s) * (gripper.reference - gripper.open_angle)))
            return T_base_nails @ level @ np.linalg.inv(robot.hand.T_hand_nails(angle_at(t)))

        yield from follow_hand_path(
            ctx, arm, nails_held, goal.open_s, status="opening the fingers in the loop", gripper=fingers,
            fingers_at=lambda t: np.array([gripper.thumb_clear, angle_at(t), angle_at(t)]), options=options,
        )  # fmt: skip
        lift = (robot.description.feeder.levels - 1 - goal.level) * robot.description.feeder.pitch + goal.clear_m
        T_risen = pose(None, (0.0, 0.0, goal.rise_m)) @ nails_held(goal.open_s)
        T_dragged = pose(None, (-goal.drag_m, 0.0, 0.0)) @ T_risen
        T_lifted = pose(None, (0.0, 0.0, lift)) @ T_dragged
        for name, T_start, T_end, duration in (
            ("raising", nails_held(goal.open_s), T_risen, goal.rise_s),
            ("dragging", T_risen, T_dragged, goal.drag_s),
            ("lifting", T_dragged, T_lifted, lift / goal.lift_speed),
        ):
            yield from follow_hand_path(
                ctx, arm, straight(T_start, T_end, duration), duration, status=f"{name} the dispenser", options=options
            )
    return NoResult()
