"""Leave the dispenser on the nail or spur that already passes through its loop."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import (
    FingersStuck,
    HandPathOptions,
    HandPressed,
    calibrated_joints,
    follow_hand_path,
    straight,
)
from grape.actions.servoing import leave
from grape.actions.touching import touching
from grape.drivers import ArmDriver, GripperDriver
from grape.errors import ActionFailed
from grape.geometry import inverse, pose
from grape.messages import Array
from grape.tasks.dispenser.actions.withdraw_hand import (
    CLEAR_M,
    WithdrawHandGoal,
    complete_release,
    take_back,
    tell_hindered,
)
from grape.tasks.dispenser.fingers import CAREFUL_S, CLOSE_S, turn_fingers
from grape.tasks.dispenser.targets import AIM_DEPTH_M, FELT_MAX, RETREAT_M, HangTarget


@dataclass(frozen=True, kw_only=True)
class HangDispenserGoal:
    """How to let go.

    Attributes:
        target: where the loop is over, as servoed.
        close_s: time to close the fingers while the nails stay in place.
        careful_s: the same beside a spur: what they meet of its wood is felt before they press on it.
        retreat_m: straight back along the fingers.
        retreat_s: its duration.
    """

    target: HangTarget
    close_s: float = CLOSE_S
    careful_s: float = CAREFUL_S
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
            yield from take_back(ctx, arm, fingers, goal.target, T_base_nails)
            raise
        ctx.ledger.move_dispenser("hand", goal.target.plant)
    return NoResult()


def _let_go(
    goal: HangDispenserGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver, T_base_nails: Array
) -> Generator[Feedback, None, None]:
    """The release, completed as far as it goes where the arm hinders it."""
    withdrawal = WithdrawHandGoal(close_s=goal.close_s, careful_s=goal.careful_s)
    rest = complete_release(withdrawal, ctx, arm, fingers, goal.target)
    for way in (_release(goal, ctx, arm, fingers, T_base_nails), rest):
        try:
            yield from way
            return
        except (FingersStuck, HandPressed):
            raise
        except ActionFailed as failed:
            tell_hindered(ctx, failed)


def _release(
    goal: HangDispenserGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver, T_base_nails: Array
) -> Generator[Feedback, None, None]:
    hand, gripper = ctx.robot.hand, ctx.robot.description.gripper
    yield from turn_fingers(
        ctx, arm, fingers, (T_base_nails, T_base_nails), (gripper.open_angle, gripper.closed_angle),
        goal.careful_s if goal.target.kind == "spur" else goal.close_s, status="closing the fingers",
        options=HandPathOptions(calibrated=True, felt_max=FELT_MAX),
    )  # fmt: skip
    T_closed = T_base_nails @ inverse(hand.T_hand_nails(gripper.closed_angle))
    T_back = T_closed @ pose(None, (0.0, 0.0, goal.retreat_m))
    yield from follow_hand_path(
        ctx, arm, straight(T_closed, T_back, goal.retreat_s), goal.retreat_s, status="released, backing off",
        options=HandPathOptions(tolerance_m=0.08, tolerance_rad=0.5, calibrated=True),
    )  # fmt: skip
