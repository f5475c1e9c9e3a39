"""Leave the dispenser on the nail or spur that already passes through its loop."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import (
    FingersStuck,
    HandPathOptions,
    HandPressed,
    calibrated_joints,
    follow_hand_path,
    smooth_step,
    straight,
)
from grape.actions.servoing import leave
from grape.actions.touching import touching
from grape.drivers import ArmDriver, GripperDriver
from grape.errors import ActionFailed
from grape.geometry import inverse, pose
from grape.messages import Array
from grape.tasks.dispenser.actions.withdraw_hand import CLEAR_M, WithdrawHandGoal, complete_release, finger_angle
from grape.tasks.dispenser.targets import AIM_DEPTH_M, FELT_MAX, RETREAT_M, HangTarget
from grape.tasks.dispenser.ways import GAP_M, nail_gap


@dataclass(frozen=True, kw_only=True)
class HangDispenserGoal:
    """How to let go.

    Attributes:
        target: where the loop is over, as servoed.
        close_s: time to close the fingers while the nails stay in place.
        careful_s: the same where they come near the wood of a spur, or may, as the arm's zeros are not known: what they
            meet is felt before they press on it.
        retreat_m: straight back along the fingers.
        retreat_s: its duration.
    """

    target: HangTarget
    close_s: float = 2.0
    careful_s: float = 5.0
    retreat_m: float = RETREAT_M
    retreat_s: float = 2.0


@action("HangDispenser")
def hang_dispenser(goal: HangDispenserGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Closes the fingers while the arm keeps the nails in place, then backs off along the fingers.

    When the arm cannot follow, the release is completed from where the hand is, as far as it goes. It ends well all the
    same: what became of the dispenser only a look can tell, and that comes next. With fingers that do not close the
    hand goes back over the tip, the way it came, and keeps the dispenser: that fails with TRACKING_ERROR. So it does,
    the fingers opened again, when the arm feels that nails press on something while they close: with CONTACT.
    """
    with (
        ctx.ledger.step("release", goal.target.plant, target=goal.target.as_record()),
        ctx.arm.lease("HangDispenser") as arm,
        ctx.gripper.lease("HangDispenser") as fingers,
        touching(ctx),
    ):
        T_base_nails = ctx.robot.hand_pose(calibrated_joints(ctx)) @ ctx.robot.hand.T_hand_nails(
            ctx.robot.description.gripper.open_angle
        )
        try:
            yield from _let_go(goal, ctx, arm, fingers, T_base_nails)
        except FingersStuck:
            yield from leave(ctx, arm, goal.target.approach, CLEAR_M + AIM_DEPTH_M)
            raise
        except HandPressed:
            yield from _open_again(goal, ctx, arm, fingers, T_base_nails)
            yield from leave(ctx, arm, goal.target.approach, CLEAR_M + AIM_DEPTH_M)
            raise
        ctx.ledger.move_dispenser("hand", goal.target.plant)
    return NoResult()


def _let_go(
    goal: HangDispenserGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver, T_base_nails: Array
) -> Generator[Feedback, None, None]:
    """The release, completed as far as it goes where the arm hinders it."""
    rest = complete_release(WithdrawHandGoal(close_s=goal.close_s), ctx, arm, fingers, goal.target)
    for way in (_release(goal, ctx, arm, fingers, T_base_nails), rest):
        try:
            yield from way
            return
        except (FingersStuck, HandPressed):
            raise
        except ActionFailed as failed:
            ctx.log.event("release_hindered", reason=str(failed.reason), detail=failed.detail)


def _release(
    goal: HangDispenserGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver, T_base_nails: Array
) -> Generator[Feedback, None, None]:
    hand, gripper = ctx.robot.hand, ctx.robot.description.gripper
    sure = ctx.world.encoder_offsets is not None and nail_gap(ctx.robot, goal.target) >= GAP_M
    careful = goal.target.kind == "spur" and not sure
    yield from _move_fingers(
        ctx, arm, fingers, T_base_nails, (gripper.open_angle, gripper.closed_angle),
        goal.careful_s if careful else goal.close_s, "closing the fingers",
        HandPathOptions(calibrated=True, felt_max=FELT_MAX),
    )  # fmt: skip
    T_closed = T_base_nails @ inverse(hand.T_hand_nails(gripper.closed_angle))
    T_back = T_closed @ pose(None, (0.0, 0.0, goal.retreat_m))
    yield from follow_hand_path(
        ctx, arm, straight(T_closed, T_back, goal.retreat_s), goal.retreat_s, status="released, backing off",
        options=HandPathOptions(tolerance_m=0.08, tolerance_rad=0.5, calibrated=True),
    )  # fmt: skip


def _open_again(
    goal: HangDispenserGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver, T_base_nails: Array
) -> Generator[Feedback, None, None]:
    """From wherever the fingers are, the nails in place: they span the loop as before."""
    gripper = ctx.robot.description.gripper
    angle, opened = finger_angle(ctx)
    yield from _move_fingers(
        ctx, arm, fingers, T_base_nails, (angle, gripper.open_angle), max(0.3, goal.close_s * (1.0 - opened)),
        "opening the fingers again", HandPathOptions(calibrated=True),
    )  # fmt: skip


def _move_fingers(
    ctx: Context,
    arm: ArmDriver,
    fingers: GripperDriver,
    T_base_nails: Array,
    ends: tuple[float, float],
    duration_s: float,
    status: str,
    options: HandPathOptions,
) -> Generator[Feedback, None, None]:
    """Turns the fingers from one angle (rad) to another while the arm keeps the nails at `T_base_nails` (4, 4)."""

    def angle_at(t: float) -> float:
        return ends[0] + smooth_step(t / duration_s) * (ends[1] - ends[0])

    def hand_at(t: float) -> Array:
        return np.asarray(T_base_nails @ inverse(ctx.robot.hand.T_hand_nails(angle_at(t))))

    thumb = ctx.robot.description.gripper.thumb_clear
    yield from follow_hand_path(
        ctx, arm, hand_at, duration_s, status=status, gripper=fingers,
        fingers_at=lambda t: np.array([thumb, angle_at(t), angle_at(t)]), options=options,
    )  # fmt: skip
