"""Lead the held loop over a nail, by the markers beside it."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace

from grape.actions.core import Context, Feedback, action
from grape.actions.servoing import camera_mount, hand_shift, leave, servo_on_markers
from grape.control.ibvs import MarkerServo, MarkerServoOptions
from grape.errors import ActionFailed
from grape.messages import Array
from grape.perception.markers import MarkerDetector
from grape.tasks.dispenser.nail_board import MARKER_DICTIONARY, MARKER_SIDE_M, NailBoard, desired_markers
from grape.tasks.dispenser.targets import AIM_DEPTH_M, HangTarget


@dataclass(frozen=True, kw_only=True)
class ServoToNailGoal:
    """Which nail, and how.

    Attributes:
        target: the nail as the survey has it.
        stand_off_m: of the loop before the nail at which the first stage settles.
        timeout_s: of the servoing.
    """

    target: HangTarget
    stand_off_m: float = 0.08
    timeout_s: float = 25.0


@dataclass(frozen=True, kw_only=True)
class ServoToNailResult:
    """Attributes: refined: the nail where the markers have shown it to be."""

    refined: HangTarget


@action("ServoToNail")
def servo_to_nail(goal: ServoToNailGoal, ctx: Context) -> Generator[Feedback, None, ServoToNailResult]:
    """Servos on the corners of the nail's markers until the nail passes through the loop."""
    robot, target, board = ctx.robot, goal.target, NailBoard()
    ids = ctx.world.site.plant(target.plant).markers
    T_hand_camera = camera_mount(ctx)
    T_hand_nails = robot.hand.T_hand_nails(robot.description.gripper.open_angle)

    def desired(stand_off: float) -> Mapping[int, Array]:
        return desired_markers(target, board, ids, T_hand_nails, T_hand_camera, stand_off)

    servo = MarkerServo(
        {i: lambda stand_off, i=i: desired(stand_off)[i] for i in ids},  # type: ignore[misc]
        MARKER_SIDE_M,
        ctx.camera.latest().info.K,
        MarkerServoOptions(standoff_m=goal.stand_off_m, stop_px=1.0, stop_frames=6),
    )
    step = ctx.ledger.step("place", target.plant, target=target.as_record())
    with step, ctx.arm.lease("ServoToNail") as arm:
        try:
            yield from servo_on_markers(
                ctx, arm, servo, desired, MarkerDetector(MARKER_DICTIONARY), MARKER_SIDE_M,
                name="ServoToNail", status="servoing to target", timeout_s=goal.timeout_s,
            )  # fmt: skip
        except ActionFailed:
            yield from leave(ctx, arm, target.approach, goal.stand_off_m + AIM_DEPTH_M)
            raise
        shift = hand_shift(robot.hand_pose(ctx.world.joints()), target.hand_pose(T_hand_nails))
    return ServoToNailResult(refined=replace(target, tip=target.tip + shift))
