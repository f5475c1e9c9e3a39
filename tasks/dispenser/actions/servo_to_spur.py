"""Lead the held loop over the tip of a spur, by what the camera sees of it."""

from __future__ import annotations

from collections.abc import Callable, Generator

from grape.actions.core import Context, Feedback, action
from grape.actions.move_arm import checker_for
from grape.actions.servoing import ServoOutcome, camera_mount, servo_on_point
from grape.control.point_servo import PointServo, PointServoOptions
from grape.geometry import inverse, transform
from grape.messages import Array, RgbdImage
from grape.perception.blobs import back_project
from grape.tasks.dispenser.perception.branch_point import BranchPointOptions, branch_point, reference_colour
from grape.tasks.dispenser.servo_target import ServoToTargetGoal, ServoToTargetResult, servo_to_target
from grape.tasks.dispenser.targets import TOUCH_M

# The first look searches farther: scan and servoing see the spur from postures in which the arm errs differently.
FIRST_LOOK = BranchPointOptions(beside_m=0.045, above_m=0.05, below_m=0.07, max_jump_m=0.05)
LATER_LOOKS = BranchPointOptions()


@action("ServoToSpur")
def servo_to_spur(goal: ServoToTargetGoal, ctx: Context) -> Generator[Feedback, None, ServoToTargetResult]:
    """Servos on the spur's tip, orientation held, until the spur passes through the loop."""
    robot, target = ctx.robot, goal.target
    T_hand_camera = camera_mount(ctx)
    T_hand_nails = robot.hand.T_hand_nails(robot.description.gripper.open_angle)
    K = ctx.camera.latest().info.K
    clearance = checker_for(ctx, carve=((target.tip, TOUCH_M),), holding=False).clearance

    direction = (target.rotation() @ T_hand_camera[:3, :3]).T @ target.direction  # in the optical frame

    def place(stand_off: float) -> Array:
        return transform(inverse(target.hand_pose(T_hand_nails, stand_off) @ T_hand_camera), target.tip)

    step = ctx.ledger.step("place", target.plant, target=target.as_record())
    with step, ctx.arm.lease("ServoToSpur") as arm:

        def attempt() -> Generator[Feedback, None, ServoOutcome]:
            options = PointServoOptions(standoff_m=goal.stand_off_m)
            servo = PointServo(place, K, options, p_base_point=target.tip)
            return (
                yield from servo_on_point(
                    ctx, arm, servo, _finder(direction), place,
                    name="ServoToSpur", status="servoing to target", timeout_s=goal.timeout_s, clearance=clearance,
                )
            )  # fmt: skip

        return (yield from servo_to_target(goal, ctx, arm, T_hand_nails, attempt))


def _finder(direction: Array) -> Callable[[RgbdImage, Array, float], tuple[Array | None, float | None]]:
    """Finds the tip of a spur along `direction` (3,), frame after frame: by the colour of the first frame.

    In the first it looks farther from the prediction.
    """
    reference: Array | None = None
    options = FIRST_LOOK

    def find(image: RgbdImage, pixel: Array, depth: float) -> tuple[Array | None, float | None]:
        nonlocal reference, options
        tip = back_project(pixel, depth, image.info.K)
        if reference is None:
            reference = reference_colour(image, tip, direction, options)
        if reference is None:
            return None, None
        point = branch_point(image, tip, direction, reference, options)
        if point.pixel is not None:
            options = LATER_LOOKS
        return point.pixel, point.depth_m

    return find
