"""Learn from the feeder's markers what the arm's encoders are off, before anything is done by them."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.calibration import calibrate, remember_offsets
from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import JOINT_OFFSETS
from grape.actions.looking import next_image
from grape.actions.move_arm import move_to_pose
from grape.actions.obstacles import OBSTACLES
from grape.actions.servoing import camera_mount
from grape.control.joint_offsets import joint_offsets
from grape.drivers import ArmDriver
from grape.errors import ActionFailed, InvalidInput, Reason
from grape.geometry import inverse, pose, rotation_x, rotation_y, rotation_z
from grape.messages import Array
from grape.perception.markers import MarkerDetector, board_pose
from grape.tasks.dispenser.feeder import FEEDER_BOXES, VIEW_M, feeder_geometry, hand_at_feeder

POSE_SIGMA = np.array([1.5e-3, 1.5e-3, 1.5e-3, 3e-3, 3e-3, 3e-3])  # of one look, play of the gears included


@dataclass(frozen=True, kw_only=True)
class CalibrateArmGoal:
    """How to look.

    Attributes:
        tilt_rad, turn_rad: about the feeder's level axes and the vertical, how far the hand goes round it.
        least: looks that must show the markers.
        error_px: a look whose corners fit worse is not used.
        skip: leave the arm as it comes, to see what that costs.
    """

    tilt_rad: float = 0.26
    turn_rad: float = 0.44
    least: int = 3
    error_px: float = 1.0
    skip: bool = False


@action("CalibrateArm")
def calibrate_arm(goal: CalibrateArmGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Looks at the feeder's markers from places around it, and takes off what the encoders tell too much from then on.

    Where it was done already, it ends at once. So it does while something is in use that was seen before, as after an
    interruption: what servoing shows there is adopted when the base drives on. FEATURE_LOST when too few looks show the
    markers.
    """
    yield Feedback(status="calibrating the arm")
    in_use = any(name in ctx.world.committed for name in (OBSTACLES, JOINT_OFFSETS))
    if goal.skip or in_use or ctx.world.encoder_offsets is not None:
        return NoResult()
    places = _places(goal, ctx)
    postures, poses = [], []
    with ctx.arm.lease("CalibrateArm") as arm, ctx.gripper.lease("CalibrateArm") as fingers:
        gripper = ctx.robot.description.gripper
        if not ctx.ledger.dispensers().get("hand", 0):  # open fingers keep a dispenser
            fingers.send(np.array([gripper.thumb_clear, gripper.closed_angle, gripper.closed_angle]))
        for k, place in enumerate(places):
            yield Feedback(status="calibrating the arm", progress=k / len(places))
            try:
                yield from move_to_pose(ctx, arm, (place,), status="going round the feeder", touch_boxes=FEEDER_BOXES)
            except ActionFailed as failed:
                ctx.log.event("calibration_look", place=k, reason=str(failed.reason), detail=failed.detail)
                continue
            T_base_hand = yield from _look(goal, ctx, arm, k)
            if T_base_hand is not None:
                postures.append(ctx.world.joints())
                poses.append(ctx.robot.in_arm_base(T_base_hand))
    if len(poses) < goal.least:
        raise ActionFailed(Reason.FEATURE_LOST, f"{len(poses)} of {len(places)} looks showed the feeder's markers")
    offsets = joint_offsets(ctx.robot.arm, np.array(postures), np.array(poses), POSE_SIGMA)
    calibrate(ctx, offsets)
    remember_offsets(ctx)
    ctx.log.event("calibrated", looks=len(poses), offsets_rad=offsets)
    return NoResult()


def _places(goal: CalibrateArmGoal, ctx: Context) -> list[Array]:
    """`T_base_hand` over the feeder, then round it: tilted and turned about its middle, which stays in view."""
    robot = ctx.robot
    above = hand_at_feeder(robot, robot.description.feeder.levels - 1, VIEW_M)
    centre = robot.description.feeder.T_base_link_level(robot.description.feeder.levels - 1)[:3, 3]
    turns = [np.eye(3)]
    for sign in (1.0, -1.0):
        angles = (rotation_x(sign * goal.tilt_rad), rotation_y(sign * goal.tilt_rad), rotation_z(sign * goal.turn_rad))
        turns.extend(angles)
    return [pose(R, centre - R @ centre) @ above for R in turns]


def _look(goal: CalibrateArmGoal, ctx: Context, arm: ArmDriver, k: int) -> Generator[Feedback, None, Array | None]:
    """`T_base_hand` by the markers, from a frame taken at rest; None when they are not seen well."""
    robot = ctx.robot
    arm.send(np.zeros(len(ctx.world.joints())))
    feeder, described = feeder_geometry(robot), robot.description.feeder
    rest = ctx.clock.now() + 0.2
    while ctx.clock.now() < rest:
        yield Feedback(status="calibrating the arm")
    image = yield from next_image(ctx, ctx.clock.now(), status="looking at the feeder's markers")
    try:
        seen = MarkerDetector(described.marker_dictionary).detect(image.bgr)
        board = board_pose(seen, feeder.T_feeder_marker, feeder.marker_side_m, image.info.K)
    except InvalidInput as error:
        ctx.log.event("calibration_look", place=k, reason=str(Reason.FEATURE_LOST), detail=str(error))
        return None
    if board.error_px > goal.error_px or len(board.ids) < len(feeder.T_feeder_marker):
        detail = f"{len(board.ids)} markers, {board.error_px:.2f} px"
        ctx.log.event("calibration_look", place=k, reason=str(Reason.FEATURE_LOST), detail=detail)
        return None
    T_base_camera = described.T_base_link_feeder @ inverse(board.T_camera_board)
    return np.asarray(T_base_camera @ inverse(camera_mount(ctx)))
