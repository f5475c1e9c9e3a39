"""Leave the dispenser on the nail or spur that already passes through its loop."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import HandPathOptions, calibrated_joints, follow_hand_path, smooth_step, straight
from grape.errors import ActionFailed
from grape.geometry import pose
from grape.messages import Array
from grape.tasks.dispenser.targets import RETREAT_M, HangTarget


@dataclass(frozen=True, kw_only=True)
class HangDispenserGoal:
    """How to let go.

    Attributes:
        target: where the loop is over, as servoed.
        close_s: time to close the fingers while the nails stay in place.
        retreat_m: straight back along the fingers.
        retreat_s: its duration.
    """

    target: HangTarget
    close_s: float = 2.0
    retreat_m: float = RETREAT_M
    retreat_s: float = 2.0


@action("HangDispenser")
def hang_dispenser(goal: HangDispenserGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Closes the fingers while the arm keeps the nails in place, then backs off along the fingers."""
    robot = ctx.robot
    gripper = robot.description.gripper
    with (
        ctx.ledger.step("release", goal.target.plant, target=goal.target.as_record()),
        ctx.arm.lease("HangDispenser") as arm,
        ctx.gripper.lease("HangDispenser") as fingers,
    ):
        T_base_nails = robot.hand_pose(calibrated_joints(ctx)) @ robot.hand.T_hand_nails(gripper.open_angle)

        def angle_at(t: float) -> float:
            s = smooth_step(t / goal.close_s)
            return gripper.open_angle + s * (gripper.closed_angle - gripper.open_angle)

        def nails_held(t: float) -> Array:
            return T_base_nails @ np.linalg.inv(robot.hand.T_hand_nails(angle_at(t)))

        yield from follow_hand_path(
            ctx, arm, nails_held, goal.close_s, status="closing the fingers", gripper=fingers,
            fingers_at=lambda t: np.array([gripper.thumb_clear, angle_at(t), angle_at(t)]),
            options=HandPathOptions(calibrated=True),
        )  # fmt: skip
        ctx.ledger.move_dispenser("hand", goal.target.plant)
        T_closed = nails_held(goal.close_s)
        T_back = T_closed @ pose(None, (0.0, 0.0, goal.retreat_m))
        try:
            yield from follow_hand_path(
                ctx, arm, straight(T_closed, T_back, goal.retreat_s), goal.retreat_s, status="released, backing off",
                options=HandPathOptions(tolerance_m=0.08, tolerance_rad=0.5, calibrated=True),
            )  # fmt: skip
        except ActionFailed as failed:  # the dispenser is let go: whether it hangs, the look that follows has to tell
            ctx.log.event("backing_off_failed", reason=str(failed.reason), detail=failed.detail)
    return NoResult()
