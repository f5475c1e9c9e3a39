"""Lead the held loop over the tip of a spur, by what the camera sees of it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

from grape.actions.core import Context, Feedback, action
from grape.actions.servoing import camera_mount, hand_shift, leave, servo_on_point
from grape.control.point_servo import PointServo, PointServoOptions
from grape.errors import ActionFailed
from grape.geometry import inverse, transform
from grape.messages import Array, RgbdImage
from grape.tasks.dispenser.perception.branch_point import branch_point, reference_colour
from grape.tasks.dispenser.targets import AIM_DEPTH_M, HangTarget


@dataclass(frozen=True, kw_only=True)
class ServoToSpurGoal:
    """Which spur, and how.

    Attributes:
        target: the deployment pose.
        stand_off_m: of the loop above the tip at which the first stage settles.
        timeout_s: of the servoing.
    """

    target: HangTarget
    stand_off_m: float = 0.07
    timeout_s: float = 20.0


@dataclass(frozen=True, kw_only=True)
class ServoToSpurResult:
    """Attributes: refined: the spur where the camera has shown it to be."""

    refined: HangTarget


@action("ServoToSpur")
def servo_to_spur(goal: ServoToSpurGoal, ctx: Context) -> Generator[Feedback, None, ServoToSpurResult]:
    """Servos on the spur's tip, orientation held, until the spur passes through the loop."""
    robot, target = ctx.robot, goal.target
    T_hand_camera = camera_mount(ctx)
    T_hand_nails = robot.hand.T_hand_nails(robot.description.gripper.open_angle)
    reference: Array | None = None

    def find(image: RgbdImage, pixel: Array, depth: float) -> tuple[Array | None, float | None]:
        nonlocal reference
        if reference is None:
            reference = reference_colour(image, pixel, depth)
        if reference is None:
            return None, None
        point = branch_point(image, pixel, depth, reference)
        return point.pixel, point.depth_m

    def place(stand_off: float) -> Array:
        return transform(inverse(target.hand_pose(T_hand_nails, stand_off) @ T_hand_camera), target.tip)

    servo = PointServo(
        place, ctx.camera.latest().info.K, PointServoOptions(standoff_m=goal.stand_off_m), p_base_point=target.tip
    )
    step = ctx.ledger.step("place", target.plant, target=target.as_record())
    with step, ctx.arm.lease("ServoToSpur") as arm:
        try:
            yield from servo_on_point(
                ctx, arm, servo, find, place,
                name="ServoToSpur", status="servoing to target", timeout_s=goal.timeout_s,
            )  # fmt: skip
        except ActionFailed:
            yield from leave(ctx, arm, target.approach, goal.stand_off_m + AIM_DEPTH_M)
            raise
        shift = hand_shift(robot.hand_pose(ctx.world.joints()), target.hand_pose(T_hand_nails))
    return ServoToSpurResult(refined=replace(target, tip=target.tip + shift))
