"""Lead the held loop over the tip of a spur, by what the camera sees of it."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np

from grape.actions.core import Context, Feedback, action
from grape.actions.hand_path import HandPathOptions, follow_hand_path, hand_correction, straight
from grape.actions.look_around import LookAroundOptions, look_around
from grape.actions.move_arm import checker_for
from grape.actions.servoing import ServoOutcome, camera_mount, servo_on_point
from grape.control.point_servo import PointServo, PointServoOptions
from grape.drivers import ArmDriver
from grape.errors import ActionFailed
from grape.geometry import inverse, transform
from grape.messages import Array, RgbdImage
from grape.perception.blobs import back_project
from grape.planning import CheckerOptions
from grape.tasks.dispenser.perception.branch_point import BranchPointOptions, branch_point, reference_colour
from grape.tasks.dispenser.scan_views import as_calibrated
from grape.tasks.dispenser.servo_target import ServoToTargetGoal, ServoToTargetResult, servo_to_target
from grape.tasks.dispenser.targets import TOUCH_UNSURE_M, HangTarget

Finder = Callable[[RgbdImage, Array, float], tuple[Array | None, float | None]]

# Without the joints' offsets the first look searches farther: scan and servoing see the spur from postures in which the
# arm errs differently, by up to 6 cm. With them the prediction is good to 1 cm, and a neighbour is not taken.
WIDE_LOOK = BranchPointOptions(beside_m=0.045, above_m=0.05, below_m=0.07, max_jump_m=0.05)
LOOKS = BranchPointOptions()
FIRST_GATE_M = {True: 0.04, False: 0.10}  # how far the first sight may be from the prediction, calibrated or not
# Nearer than 6 cm the held loop is beside the tip, and was taken for a piece of it that is 8 mm long. Known joints lead
# the hand over that way better.
OPTIONS = {False: PointServoOptions(), True: PointServoOptions(standoff_frames=8, smoothing=0.1, trust_m=0.06)}
AROUND = LookAroundOptions(turn_rad=0.0, shift_m=0.04)  # a spur is looked for past what hides it
CLOSE = CheckerOptions(padding_m=0.005)  # less than of the planned way, which servoing leaves by some mm
MEANT_SPEED = 0.06  # m/s
MEANT_MOST_M = 0.12  # a correction that is larger than this is not believed


@action("ServoToSpur")
def servo_to_spur(goal: ServoToTargetGoal, ctx: Context) -> Generator[Feedback, None, ServoToTargetResult]:
    """Servos on the spur's tip, orientation held, until the spur passes through the loop."""
    robot, target = ctx.robot, as_calibrated(ctx, goal.target)
    calibrated = target is not goal.target
    T_hand_camera = camera_mount(ctx)
    T_hand_nails = robot.hand.T_hand_nails(robot.description.gripper.open_angle)
    K = ctx.camera.latest().info.K
    touched = goal.target.touched() if calibrated else ((goal.target.tip, TOUCH_UNSURE_M),)
    clearance = checker_for(ctx, carve=touched, holding=False, options=CLOSE).clearance
    direction = (target.rotation() @ T_hand_camera[:3, :3]).T @ target.direction  # in the optical frame

    def place(stand_off: float) -> Array:
        return transform(inverse(target.hand_pose(T_hand_nails, stand_off) @ T_hand_camera), target.tip)

    def servo() -> PointServo:
        options = replace(OPTIONS[calibrated], standoff_m=goal.stand_off_m)
        return PointServo(place, K, options, p_base_point=target.tip, first_gate_m=FIRST_GATE_M[calibrated])

    def finder() -> Finder:
        return _finder(direction, target.diameter, LOOKS if calibrated else WIDE_LOOK)

    def seen(image: RgbdImage, T_base_camera: Array) -> bool:
        first, T = servo(), hand_correction(ctx) @ T_base_camera
        guess = first.predict(T)
        return guess is not None and first.update(image.stamp, *finder()(image, *guess), T).seen

    step = ctx.ledger.step("place", target.plant, target=goal.target.as_record())
    with step, ctx.arm.lease("ServoToSpur") as arm:
        if calibrated:
            yield from _go_where_meant(goal.target, target, ctx, arm, T_hand_nails)

        def look() -> Generator[Feedback, None, None]:
            return look_around(
                ctx, arm, seen, name="ServoToSpur", what="the spur", away=target.approach, checker=checker_for(ctx),
                options=AROUND,
            )  # fmt: skip

        def attempt() -> Generator[Feedback, None, ServoOutcome]:
            return servo_on_point(
                ctx, arm, servo(), finder(), place, name="ServoToSpur", status="servoing to target",
                timeout_s=goal.timeout_s, clearance=clearance, calibrated=True,
            )  # fmt: skip

        return (yield from servo_to_target(goal, ctx, arm, T_hand_nails, attempt, look))


def _go_where_meant(
    told: HangTarget, target: HangTarget, ctx: Context, arm: ArmDriver, T_hand_nails: Array
) -> Generator[Feedback, None, None]:
    """Moves the hand from where the encoders have it before the target `told` to the same place before `target`.

    As far as the arm can: servoing goes on from wherever that is.
    """
    T = ctx.robot.hand_pose(ctx.world.joints())
    stand_off = float((T[:3, 3] - told.hand_pose(T_hand_nails)[:3, 3]) @ told.approach)
    T_start, T_meant = hand_correction(ctx) @ T, target.hand_pose(T_hand_nails, max(stand_off, 0.0))
    way = float(np.linalg.norm(T_meant[:3, 3] - T_start[:3, 3]))
    if way > MEANT_MOST_M:
        return
    duration = max(0.5, way / MEANT_SPEED)
    try:
        yield from follow_hand_path(
            ctx, arm, straight(T_start, T_meant, duration), duration, status="moving to where it was meant to be",
            options=HandPathOptions(calibrated=True),
        )  # fmt: skip
    except ActionFailed as failed:
        ctx.log.event("correction_hindered", reason=str(failed.reason), detail=failed.detail)


def _finder(direction: Array, diameter: float, options: BranchPointOptions) -> Finder:
    """Finds the tip of a spur along `direction` (3,), frame after frame: by the colour of the first frame.

    Args:
        direction: in the optical frame.
        diameter: m.
        options: of the first find; from then on it is looked for nearby.
    """
    reference: Array | None = None

    def find(image: RgbdImage, pixel: Array, depth: float) -> tuple[Array | None, float | None]:
        nonlocal reference, options
        tip = back_project(pixel, depth, image.info.K)
        if reference is None:
            reference = reference_colour(image, tip, direction, options)
        if reference is None:
            return None, None
        point = branch_point(image, tip, direction, reference, options, diameter)
        if point.pixel is not None:
            options = LOOKS
        return point.pixel, point.depth_m

    return find
