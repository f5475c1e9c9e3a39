"""Look from above which dispenser in the feeder is on top."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, action
from grape.actions.looking import next_image
from grape.actions.move_arm import move_to_pose
from grape.actions.retract import back_off
from grape.errors import ActionFailed, InvalidInput, Reason
from grape.messages import RgbdImage
from grape.perception.markers import MarkerDetector, board_pose
from grape.tasks.dispenser.feeder import FEEDER_BOXES, VIEW_M, feeder_geometry, hand_at_feeder
from grape.tasks.dispenser.perception.feeder import FeederGeometry, FeederTop, feeder_top

FEEDER_EMPTY = "feeder_empty"  # in world.committed, once the feeder was seen empty


@dataclass(frozen=True, kw_only=True)
class CheckFeederGoal:
    """Attributes: frames: frames that must agree. timeout_s: without any dispenser in view, the feeder is empty."""

    frames: int = 5
    timeout_s: float = 5.0


@dataclass(frozen=True, kw_only=True)
class CheckFeederResult:
    """Attributes: level: of the dispenser on top, 0 is the lowest."""

    level: int


@action("CheckFeeder")
def check_feeder(goal: CheckFeederGoal, ctx: Context) -> Generator[Feedback, None, CheckFeederResult]:
    """Moves the camera over the feeder and finds the top dispenser by its wings; FEEDER_EMPTY after the time-out."""
    if ctx.world.committed.get(FEEDER_EMPTY):
        raise ActionFailed(Reason.FEEDER_EMPTY, "it was seen empty before")
    robot = ctx.robot
    gripper = robot.description.gripper
    with ctx.arm.lease("CheckFeeder") as arm, ctx.gripper.lease("CheckFeeder") as fingers:
        fingers.send(np.array([gripper.thumb_clear, gripper.closed_angle, gripper.closed_angle]))
        yield from back_off(ctx, arm)  # from where an attempt before has failed
        above = hand_at_feeder(robot, robot.description.feeder.levels - 1, VIEW_M)
        line = (above, hand_at_feeder(robot, 0, 0.0))
        yield from move_to_pose(ctx, arm, line, status="moving to feeder", touch_boxes=FEEDER_BOXES)
        level = yield from _agreed_level(goal, ctx)
    _settle_account(ctx, level + 1)
    return CheckFeederResult(level=level)


def _agreed_level(goal: CheckFeederGoal, ctx: Context) -> Generator[Feedback, None, int]:
    """The level that `frames` frames agree on."""
    geometry = feeder_geometry(ctx.robot)
    detector = MarkerDetector(ctx.robot.description.feeder.marker_dictionary)
    seen: Counter[int] = Counter()
    frames = empty = 0
    last, start, stamp = "", ctx.clock.now(), ctx.clock.now()
    while True:
        image = yield from next_image(ctx, stamp, status="looking for dispensers")
        stamp = image.stamp
        top = _look(image, geometry, detector)
        if top.level is not None:
            seen[top.level] += 1
            if seen[top.level] >= goal.frames:
                ctx.log.event("check", check="feeder", value=True, level=top.level, height_m=top.height_m)
                return top.level
        frames, empty, last = frames + 1, empty + top.empty, top.reason or last
        if ctx.clock.now() - start > goal.timeout_s:
            ctx.log.event("check", check="feeder", value=False, reason=last, frames=frames, empty=empty)
            ctx.log.picture("feeder", image.bgr)
            if 2 * empty > frames:
                _settle_account(ctx, 0)
                ctx.world.committed[FEEDER_EMPTY] = True
                raise ActionFailed(Reason.FEEDER_EMPTY, f"no dispenser seen for {goal.timeout_s} s: {last}")
            raise ActionFailed(Reason.FEATURE_LOST, f"no level is sure after {frames} frames, {dict(seen)}: {last}")


def _look(image: RgbdImage, geometry: FeederGeometry, detector: MarkerDetector) -> FeederTop:
    try:
        board = board_pose(detector.detect(image.bgr), geometry.T_feeder_marker, geometry.marker_side_m, image.info.K)
    except InvalidInput as error:
        return FeederTop(level=None, reason=str(error))
    return feeder_top(image, board.T_camera_board, geometry)


def _settle_account(ctx: Context, seen: int) -> None:
    """What the camera sees wins: others that the ledger has in the feeder are lost, more after a refill were loaded."""
    ctx.ledger.count_refill(seen)
    for _ in range(ctx.ledger.dispensers().get("feeder", 0) - seen):
        ctx.ledger.move_dispenser("feeder", "lost")
