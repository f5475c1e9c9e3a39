"""Leave the dispenser on the nail or spur that already passes through its loop."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import (
    FingersStuck,
    HandPathOptions,
    calibrated_joints,
    follow_hand_path,
    smooth_step,
    straight,
)
from grape.actions.servoing import leave
from grape.actions.touching import touching
from grape.drivers import ArmDriver, GripperDriver
from grape.errors import ActionFailed
from grape.geometry import pose
from grape.messages import Array
from grape.tasks.dispenser.actions.withdraw_hand import CLEAR_M, WithdrawHandGoal, complete_release
from grape.tasks.dispenser.targets import AIM_DEPTH_M, RETREAT_M, HangTarget


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
    """Closes the fingers while the arm keeps the nails in place, then backs off along the fingers.

    When the arm cannot follow, the release is completed from where the hand is, as far as it goes. It ends well all the
    same: what became of the dispenser only a look can tell, and that comes next. With fingers that do not close the
    hand goes back over the tip, the way it came, and keeps the dispenser: that fails with TRACKING_ERROR.
    """
    with (
        ctx.ledger.step("release", goal.target.plant, target=goal.target.as_record()),
        ctx.arm.lease("HangDispenser") as arm,
        ctx.gripper.lease("HangDispenser") as fingers,
        touching(ctx),
    ):
        try:
            yield from _let_go(goal, ctx, arm, fingers)
        except FingersStuck:
            yield from leave(ctx, arm, goal.target.approach, CLEAR_M + AIM_DEPTH_M)
            raise
        ctx.ledger.move_dispenser("hand", goal.target.plant)
    return NoResult()


def _let_go(
    goal: HangDispenserGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver
) -> Generator[Feedback, None, None]:
    """The release, completed as far as it goes where the arm hinders it."""
    rest = WithdrawHandGoal(close_s=goal.close_s)
    for way in (_release(goal, ctx, arm, fingers), complete_release(rest, ctx, arm, fingers, goal.target)):
        try:
            yield from way
            return
        except FingersStuck:
            raise
        except ActionFailed as failed:
            ctx.log.event("release_hindered", reason=str(failed.reason), detail=failed.detail)


def _release(
    goal: HangDispenserGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver
) -> Generator[Feedback, None, None]:
    robot, gripper = ctx.robot, ctx.robot.description.gripper
    T_base_nails = robot.hand_pose(calibrated_joints(ctx)) @ robot.hand.T_hand_nails(gripper.open_angle)

    def angle_at(t: float) -> float:
        s = smooth_step(t / goal.close_s)
        return float(gripper.open_angle + s * (gripper.closed_angle - gripper.open_angle))

    def nails_held(t: float) -> Array:
        return np.asarray(T_base_nails @ np.linalg.inv(robot.hand.T_hand_nails(angle_at(t))))

    yield from follow_hand_path(
        ctx, arm, nails_held, goal.close_s, status="closing the fingers", gripper=fingers,
        fingers_at=lambda t: np.array([gripper.thumb_clear, angle_at(t), angle_at(t)]),
        options=HandPathOptions(calibrated=True),
    )  # fmt: skip
    T_closed = nails_held(goal.close_s)
    T_back = T_closed @ pose(None, (0.0, 0.0, goal.retreat_m))
    yield from follow_hand_path(
        ctx, arm, straight(T_closed, T_back, goal.retreat_s), goal.retreat_s, status="released, backing off",
        options=HandPathOptions(tolerance_m=0.08, tolerance_rad=0.5, calibrated=True),
    )  # fmt: skip
