"""After an interruption: bring the hand out of wherever it is."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.account import RESUMED
from grape.actions.calibration import recall_offsets
from grape.actions.core import Context, Feedback, NoResult, Step, action
from grape.actions.hand_path import (
    JOINT_OFFSETS,
    FingersStuck,
    HandPathOptions,
    HandPressed,
    calibrated_joints,
    follow_hand_path,
    straight,
)
from grape.actions.obstacles import OBSTACLES, recall_obstacles
from grape.actions.servoing import leave
from grape.actions.touching import touching
from grape.drivers import ArmDriver, GripperDriver
from grape.errors import ActionFailed
from grape.geometry import pose, pose_error
from grape.messages import Array
from grape.tasks.dispenser.actions.drive_to_plant import PARKED, STANDING
from grape.tasks.dispenser.actions.grasp_dispenser import GraspDispenserGoal
from grape.tasks.dispenser.feeder import hand_at_feeder
from grape.tasks.dispenser.fingers import CAREFUL_S, CLOSE_S, finger_angle, turn_fingers
from grape.tasks.dispenser.row import expect_row
from grape.tasks.dispenser.targets import AIM_DEPTH_M, FELT_MAX, RETREAT_M, HangTarget, hang_line

NEAR_FEEDER_M = 0.08  # beside the loop's place: farther away the hand is not in the feeder
RISEN_M = 0.003  # a loop that is higher has left its tray
# From where the hand hangs a dispenser: farther away, or turned farther as for another look, it has left the plant.
NEAR_TARGET_M, NEAR_TARGET_RAD = 0.25, 0.35
CLEAR_M = 0.08  # of the loop from the tip, when servoing was cut off


@dataclass(frozen=True, kw_only=True)
class WithdrawHandGoal:
    """How to go.

    Attributes:
        close_s: time to close fully opened fingers.
        careful_s: the same beside a spur.
        speed: m/s, mean, of the hand on its way out.
    """

    close_s: float = CLOSE_S
    careful_s: float = CAREFUL_S
    speed: float = 0.06


@action("WithdrawHand")
def withdraw_hand(goal: WithdrawHandGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Backs out of feeder or plant the way the hand went in, by the last step of the ledger and the arm's own joints.

    A release that was begun is completed; where nails press on something it is taken back with its dispenser. When the
    mission was interrupted, what was known of this stop (place, obstacles, joint offsets) is known again.
    """
    if ctx.world.committed.get(RESUMED):
        _recall_stop(ctx)
    yield Feedback(status="finding out where the hand is")
    step = ctx.ledger.last_step()
    with ctx.arm.lease("WithdrawHand") as arm, ctx.gripper.lease("WithdrawHand") as fingers, touching(ctx):
        if step is None:
            return NoResult()
        if step.name in ("insert", "grasp"):
            yield from _out_of_feeder(goal, ctx, arm, fingers, int(step.details["level"]))
        elif release_pending(ctx, step):
            yield from _complete_or_take_back(goal, ctx, arm, fingers, HangTarget(**step.details["target"]))
        elif step.name == "place" or (step.name == "release" and step.outcome == "failed"):
            yield from _off_the_tip(ctx, arm, HangTarget(**step.details["target"]))
    return NoResult()


def release_pending(ctx: Context, step: Step) -> bool:
    """Whether a dispenser was let go, or about to be, and nobody has looked yet what came of it."""
    if step.name != "release":
        return False
    task = next(task for task in ctx.ledger.plants() if task.plant == step.plant)
    places = ctx.ledger.dispensers()
    at_stake = places[step.plant] + (places["hand"] if step.outcome is None else 0)
    return task.outcome is None and at_stake > 0


def _recall_stop(ctx: Context) -> None:
    recall_offsets(ctx)
    parked, offsets = ctx.ledger.recall(PARKED), ctx.ledger.recall(JOINT_OFFSETS)
    seen = recall_obstacles(ctx)
    if parked is not None:
        ctx.world.committed[PARKED] = tuple(parked)
        ctx.world.committed[STANDING] = parked[0]
    if seen is not None:
        ctx.world.committed[OBSTACLES] = seen
    elif parked is not None:
        expect_row(ctx, parked[0])
    if offsets is not None:
        ctx.world.committed[JOINT_OFFSETS] = np.array(offsets)


def _out_of_feeder(
    goal: WithdrawHandGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver, level: int
) -> Generator[Feedback, None, None]:
    """Straight up; a loop that is open but has not left its tray is let go before, one that has is dragged out."""
    robot, feeder, way = ctx.robot, ctx.robot.description.feeder, GraspDispenserGoal(level=level)
    top = (feeder.levels - 1 - level) * feeder.pitch + way.clear_m
    angle, opened = finger_angle(ctx)
    offset = _nails(ctx, angle)[:3, 3] - feeder.T_base_link_level(level)[:3, 3]
    if np.hypot(*offset[:2]) > NEAR_FEEDER_M or offset[2] > top - 0.01:
        return
    if opened > 0.1 and offset[2] < RISEN_M:
        down = hand_at_feeder(robot, level, 0.0)
        yield from _close(ctx, arm, fingers, down[:3, :3], goal.close_s)
    elif opened > 0.1 and offset[2] < way.rise_m + 0.02:
        yield from _go(goal, ctx, arm, np.array([min(0.0, -way.drag_m - offset[0]), 0.0, 0.0]))
    yield from _go(goal, ctx, arm, np.array([0.0, 0.0, max(0.0, top - offset[2])]))


def complete_release(
    goal: WithdrawHandGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver, target: HangTarget
) -> Generator[Feedback, None, None]:
    """Close the fingers where they are and back off along them, as far as that was not done yet.

    Raises:
        HandPressed: the arm feels that nails press on something while they close.
    """
    _, opened = finger_angle(ctx)
    T = ctx.robot.hand_pose(ctx.world.joints())
    if opened > 0.05:
        close_s = goal.careful_s if target.kind == "spur" else goal.close_s
        yield from _close(ctx, arm, fingers, T[:3, :3], close_s, HandPathOptions(felt_max=FELT_MAX))
        T = ctx.robot.hand_pose(ctx.world.joints())
    T_released = hang_line(ctx.robot, target, 0.1)[2]
    if not _in_plant(T, T_released):
        return
    gone = float((T[:3, 3] - T_released[:3, 3]) @ T[:3, 2])
    yield from _go(goal, ctx, arm, T[:3, 2] * (RETREAT_M - min(max(gone, 0.0), RETREAT_M)))


def _complete_or_take_back(
    goal: WithdrawHandGoal, ctx: Context, arm: ArmDriver, fingers: GripperDriver, target: HangTarget
) -> Generator[Feedback, None, None]:
    """A loop that was taken back over the tip already stays on the nails.

    Where arm or fingers cannot follow, it goes as far as it can: what came of it the look that is next tells.
    """
    angle, opened = finger_angle(ctx)
    if opened > 0.9 and _backed_off(ctx, target) > AIM_DEPTH_M:
        yield from _off_the_tip(ctx, arm, target)
        return
    T_base_nails = ctx.robot.hand_pose(calibrated_joints(ctx)) @ ctx.robot.hand.T_hand_nails(angle)
    try:
        yield from complete_release(goal, ctx, arm, fingers, target)
    except HandPressed as pressed:
        tell_hindered(ctx, pressed)
        yield from take_back(ctx, arm, fingers, target, T_base_nails)
    except FingersStuck as stuck:
        tell_hindered(ctx, stuck)
        yield from leave(ctx, arm, target.approach, CLEAR_M + AIM_DEPTH_M)
    except ActionFailed as failed:
        tell_hindered(ctx, failed)


def take_back(
    ctx: Context, arm: ArmDriver, fingers: GripperDriver, target: HangTarget, T_base_nails: Array
) -> Generator[Feedback, None, None]:
    """Opens the fingers again and brings hand and dispenser back over the tip, the way they came.

    Args:
        ctx: context.
        arm, fingers: leased.
        target: where the loop is over.
        T_base_nails: (4, 4), where the nails stay while they open, by the calibrated joints.
    """
    open_angle = ctx.robot.description.gripper.open_angle
    angle, opened = finger_angle(ctx)
    try:
        yield from turn_fingers(
            ctx, arm, fingers, (T_base_nails, T_base_nails), (angle, open_angle), max(0.3, CLOSE_S * (1.0 - opened)),
            status="opening the fingers again", options=HandPathOptions(calibrated=True),
        )  # fmt: skip
    except ActionFailed as failed:
        tell_hindered(ctx, failed)
    yield from leave(ctx, arm, target.approach, CLEAR_M + AIM_DEPTH_M)


def tell_hindered(ctx: Context, failed: ActionFailed) -> None:
    """Writes down what kept a release from going as it should; what came of it a look tells."""
    ctx.log.event("release_hindered", reason=str(failed.reason), detail=failed.detail)


def _off_the_tip(ctx: Context, arm: ArmDriver, target: HangTarget) -> Generator[Feedback, None, None]:
    """Back along the approach, the fingers as they are, until the loop is clear of the tip."""
    short = CLEAR_M + AIM_DEPTH_M - _backed_off(ctx, target)
    if short > 0.005 and _in_plant(ctx.robot.hand_pose(ctx.world.joints()), _over(ctx, target)):
        yield from leave(ctx, arm, target.approach, short)


def _in_plant(T_base_hand: Array, T_base_hanging: Array) -> bool:
    """Whether the hand has not yet gone elsewhere from where it hangs a dispenser."""
    error = pose_error(T_base_hanging, T_base_hand)
    return bool(np.linalg.norm(error[:3]) < NEAR_TARGET_M and np.linalg.norm(error[3:]) < NEAR_TARGET_RAD)


def _over(ctx: Context, target: HangTarget) -> Array:
    """`T_base_hand` where the loop is over the tip, fingers open."""
    return target.hand_pose(ctx.robot.hand.T_hand_nails(ctx.robot.description.gripper.open_angle))


def _backed_off(ctx: Context, target: HangTarget) -> float:
    """How far (m) the hand is along the approach from where the loop is over the tip."""
    return float((ctx.robot.hand_pose(ctx.world.joints()) - _over(ctx, target))[:3, 3] @ target.approach)


def _nails(ctx: Context, angle: float) -> Array:
    """`T_base_nails` as joints and fingers have it."""
    return np.asarray(ctx.robot.hand_pose(ctx.world.joints()) @ ctx.robot.hand.T_hand_nails(angle))


def _close(
    ctx: Context,
    arm: ArmDriver,
    fingers: GripperDriver,
    R_base_hand: Array,
    close_s: float,
    options: HandPathOptions | None = None,
) -> Generator[Feedback, None, None]:
    """Close the fingers while the nails stay where they are and the hand turns to `R_base_hand` (3, 3)."""
    robot, gripper = ctx.robot, ctx.robot.description.gripper
    angle, opened = finger_angle(ctx)
    T_first = _nails(ctx, angle)
    T_last = pose(R_base_hand @ robot.hand.T_hand_nails(gripper.closed_angle)[:3, :3], T_first[:3, 3])
    yield from turn_fingers(
        ctx, arm, fingers, (T_first, T_last), (angle, gripper.closed_angle), max(0.3, close_s * opened),
        status="closing the fingers", options=options,
    )  # fmt: skip


def _go(goal: WithdrawHandGoal, ctx: Context, arm: ArmDriver, way: Array) -> Generator[Feedback, None, None]:
    """Straight by `way` (3,) m in base_link."""
    length = float(np.linalg.norm(way))
    if length < 0.003:
        return
    T = ctx.robot.hand_pose(ctx.world.joints())
    duration = max(0.5, length / goal.speed)
    yield from follow_hand_path(
        ctx, arm, straight(T, pose(T[:3, :3], T[:3, 3] + way), duration), duration, status="withdrawing the hand",
        options=HandPathOptions(tolerance_m=0.08, tolerance_rad=0.5),
    )  # fmt: skip
