"""Look whether the dispenser hangs where it was put."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.looking import Ballot, vote
from grape.actions.move_arm import move_to_pose
from grape.actions.retract import back_off
from grape.actions.servoing import camera_mount
from grape.errors import ActionFailed, Reason
from grape.geometry import inverse, pose, rotation_z, transform
from grape.messages import Array, RgbdImage
from grape.perception.blobs import Blob
from grape.tasks.dispenser.perception.wings import HungExpectation, HungOptions, held, hung
from grape.tasks.dispenser.targets import HangTarget

# Where the wings of a hung dispenser may be: around a place so far below the tip, within a radius, m. From a spur the
# loop slides down to where it stands on its arm, and on a steep arm into the fork of the vine.
PLACE_M = {"nail": (0.07, 0.12), "spur": (0.17, 0.28)}
FAR = HungOptions(depth_m=(0.20, 0.80))  # what hangs in the next row is farther away
LOWEST_M = 0.20  # over the ground under the robot: what lies there does not hang


@dataclass(frozen=True, kw_only=True)
class CheckDeploymentGoal:
    """What to look at, and how.

    Attributes:
        target: where the dispenser was put.
        frames: how many camera frames vote.
        more: further looks at that place where nothing was seen, for a loop that has slid out of the picture, is seen
            edge-on or behind an arm of the vine. Each is a turn of the camera about the vertical through the place,
            counted from the arm's base, and a height over it, rad. Those that the arm does not reach are left out.
        more_m: of the camera from the place, on these looks.
    """

    target: HangTarget
    frames: int = 15
    more: tuple[tuple[float, float], ...] = ((0.0, 0.3), (0.0, 0.7), (0.8, 0.3), (-0.8, 0.3), (0.4, 0.3), (-0.4, 0.3))
    more_m: float = 0.5


@action("CheckDeployment")
def check_deployment(goal: CheckDeploymentGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Looks for the wings of a hung dispenser from where the hand backed off to, and settles the account by it.

    Fails with DEPLOYMENT_NOT_CONFIRMED: the dispenser is on the hand's account when wings are still at the nails, and
    lost when it is seen nowhere. Until the look has ended, it is where it was by the account.
    """
    robot = ctx.robot
    below, radius = PLACE_M[goal.target.kind]
    place = goal.target.tip - np.array([0.0, 0.0, below])
    base_height = robot.description.base.height
    at_nails = 0

    def decide(image: RgbdImage) -> tuple[bool, str]:
        nonlocal at_nails
        T_camera_base = inverse(ctx.world.frames.lookup("base_link", "camera_optical", image.stamp))
        T_hand_nails = robot.hand.T_hand_nails(robot.description.gripper.closed_angle)
        nails = (T_camera_base @ ctx.world.frames.lookup("base_link", "hand", image.stamp) @ T_hand_nails)[:3, 3]
        check = hung(image, HungExpectation(target=transform(T_camera_base, place), radius_m=radius, nails=nails), FAR)
        at_nails += check.reason.startswith("a wing is still")
        if check.value and not _off_the_ground(check.blobs, inverse(T_camera_base), base_height):
            return False, "what is seen lies on the ground"
        return check.value, check.reason

    ballot = yield from vote(ctx, decide, frames=goal.frames, status="validating the deployment")
    still_held = at_nails > goal.frames // 4 or held(ballot.image).value
    if not ballot.value and not still_held:
        ballot = yield from _look_again(goal, ctx, place, decide, ballot)
    ctx.log.event("check", check="deployment", value=ballot.value, yes=ballot.yes, no=ballot.no, reason=ballot.reason)
    ctx.log.picture("deployment", ballot.image.bgr)
    _account_for(ctx, goal.target.plant, goal.target.plant if ballot.value else "hand" if still_held else "lost")
    if ballot.value:
        return NoResult()
    raise ActionFailed(Reason.DEPLOYMENT_NOT_CONFIRMED, f"{ballot.no} of {goal.frames} frames: {ballot.reason}")


def _account_for(ctx: Context, plant: str, seen_at: str) -> None:
    """The dispenser that by the account is in the hand, or else on the plant, is where it was seen."""
    booked = "hand" if ctx.ledger.dispensers()["hand"] else plant
    if seen_at != booked:
        ctx.ledger.move_dispenser(booked, seen_at)


def _look_again(
    goal: CheckDeploymentGoal,
    ctx: Context,
    place: Array,
    decide: Callable[[RgbdImage], tuple[bool, str]],
    first: Ballot,
) -> Generator[Feedback, None, Ballot]:
    """The first further look that shows the dispenser, else the last one; `first` where the arm gets nowhere."""
    T_hand_camera = camera_mount(ctx)
    right = (ctx.robot.hand_pose(ctx.world.joints()) @ T_hand_camera)[:3, 0]
    towards_arm = (ctx.robot.description.arm.T_base_link_arm_base[:3, 3] - place) * [1.0, 1.0, 0.0]
    ballot = first
    with ctx.arm.lease("CheckDeployment") as arm:
        yield from back_off(ctx, arm)
        for turn, height in goal.more:
            side = rotation_z(turn) @ towards_arm
            T_look = looking_at(place, side, goal.more_m, height, right) @ inverse(T_hand_camera)
            try:
                yield from move_to_pose(ctx, arm, (T_look,), status="looking again")
            except ActionFailed as failed:
                ctx.log.event("not_looked", action="CheckDeployment", reason=str(failed.reason), detail=failed.detail)
                continue
            ballot = yield from vote(ctx, decide, frames=goal.frames, status="validating the deployment again")
            if ballot.value:
                break
    return ballot


def looking_at(place: Array, side: Array, distance_m: float, height: float, right: Array) -> Array:
    """`T_base_camera` that has a place in the middle of a level picture.

    Args:
        place: (3,) m in base_link.
        side: (3,) level vector from the place to the side that the camera is on.
        distance_m: of the camera from the place.
        height: rad, of the camera over the level of the place, less than pi/2.
        right: (3,) the picture's right is on this side: which way up it is.
    """
    away = np.cos(height) * side / np.linalg.norm(side) + [0.0, 0.0, np.sin(height)]
    x = np.cross(-away, [0.0, 0.0, 1.0])
    x *= np.copysign(1.0, x @ right) / np.linalg.norm(x)
    return pose(np.column_stack([x, np.cross(-away, x), -away]), place + distance_m * away)


def _off_the_ground(blobs: Sequence[Blob], T_base_camera: Array, base_height: float) -> bool:
    """Whether the highest of what was seen is where nothing lies; base_link is `base_height` m over the ground."""
    heights = transform(T_base_camera, np.array([blob.position for blob in blobs]))[:, 2] + base_height
    return bool(heights.max() > LOWEST_M)
