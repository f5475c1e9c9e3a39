"""Look whether the dispenser hangs where it was put."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.looking import Ballot, vote
from grape.actions.move_arm import move_to_pose
from grape.errors import ActionFailed, Reason
from grape.geometry import inverse, pose, rotation_x, rotation_z, transform
from grape.messages import Array, RgbdImage
from grape.perception.blobs import Blob
from grape.tasks.dispenser.perception.wings import HungExpectation, held, hung
from grape.tasks.dispenser.row import GROUND_CLEARANCE_M
from grape.tasks.dispenser.targets import HangTarget

# Where the wings of a hung dispenser may be: around a place so far below the tip, within a radius, m. From a spur the
# loop slides down to where it stands on its arm, and on a steep arm into the fork of the vine.
PLACE_M = {"nail": (0.07, 0.12), "spur": (0.17, 0.28)}
LOWEST_M = 0.20  # over the ground under the robot: what lies there does not hang


@dataclass(frozen=True, kw_only=True)
class CheckDeploymentGoal:
    """What to look at, and how.

    Attributes:
        target: where the dispenser was put.
        frames: how many camera frames vote.
        aside_rad: turns of the hand through that place, about the vertical and then towards level, for more looks where
            nothing was seen: a loop that is seen edge-on, or behind an arm of the vine, shows no wings.
        most: how many of them are taken; those that the arm does not reach do not count.
    """

    target: HangTarget
    frames: int = 15
    aside_rad: tuple[tuple[float, float], ...] = ((0.6, 0.0), (-0.6, 0.0), (0.3, 0.4), (-0.3, 0.4), (0.0, 0.4))
    most: int = 3


@action("CheckDeployment")
def check_deployment(goal: CheckDeploymentGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Looks for the wings of a hung dispenser from where the hand backed off to, and settles the account by it.

    Fails with DEPLOYMENT_NOT_CONFIRMED: the dispenser is back in the hand's account when wings are still at the nails,
    and lost when it is seen nowhere.
    """
    robot = ctx.robot
    below, radius = PLACE_M[goal.target.kind]
    place = goal.target.tip - np.array([0.0, 0.0, below])
    at_nails = 0

    def decide(image: RgbdImage) -> tuple[bool, str]:
        nonlocal at_nails
        T_camera_base = inverse(ctx.world.frames.lookup("base_link", "camera_optical", image.stamp))
        T_hand_nails = robot.hand.T_hand_nails(robot.description.gripper.closed_angle)
        nails = (T_camera_base @ ctx.world.frames.lookup("base_link", "hand", image.stamp) @ T_hand_nails)[:3, 3]
        check = hung(image, HungExpectation(target=transform(T_camera_base, place), radius_m=radius, nails=nails))
        at_nails += check.reason.startswith("a wing is still")
        if check.value and not _off_the_ground(check.blobs, inverse(T_camera_base)):
            return False, "what is seen lies on the ground"
        return check.value, check.reason

    ballot = yield from vote(ctx, decide, frames=goal.frames, status="validating the deployment")
    still_held = at_nails > goal.frames // 4 or held(ballot.image).value
    if not ballot.value and not still_held:
        ballot = yield from _from_aside(goal, ctx, place, decide, ballot)
    ctx.log.event("check", check="deployment", value=ballot.value, yes=ballot.yes, no=ballot.no, reason=ballot.reason)
    ctx.log.picture("deployment", ballot.image.bgr)
    if ballot.value:
        return NoResult()
    ctx.ledger.move_dispenser(goal.target.plant, "hand" if still_held else "lost")
    raise ActionFailed(Reason.DEPLOYMENT_NOT_CONFIRMED, f"{ballot.no} of {goal.frames} frames: {ballot.reason}")


def _from_aside(
    goal: CheckDeploymentGoal,
    ctx: Context,
    place: Array,
    decide: Callable[[RgbdImage], tuple[bool, str]],
    first: Ballot,
) -> Generator[Feedback, None, Ballot]:
    """The first look from aside that shows the dispenser, else the last one; `first` where the arm gets nowhere."""
    T, ballot, taken = ctx.robot.hand_pose(ctx.world.joints()), first, 0
    in_hand = transform(inverse(T), place)
    with ctx.arm.lease("CheckDeployment") as arm:
        for turn, tilt in goal.aside_rad:
            R = rotation_z(turn) @ T[:3, :3] @ rotation_x(tilt)
            T_aside = pose(R, place - R @ in_hand)
            try:
                yield from move_to_pose(ctx, arm, (T_aside,), status="looking from aside")
            except ActionFailed as failed:
                ctx.log.event("not_looked", action="CheckDeployment", reason=str(failed.reason), detail=failed.detail)
                continue
            ballot = yield from vote(ctx, decide, frames=goal.frames, status="validating the deployment from aside")
            taken += 1
            if ballot.value or taken >= goal.most:
                break
    return ballot


def _off_the_ground(blobs: Sequence[Blob], T_base_camera: Array) -> bool:
    """Whether the highest of what was seen is where nothing lies."""
    heights = transform(T_base_camera, np.array([blob.position for blob in blobs]))[:, 2] + GROUND_CLEARANCE_M
    return bool(heights.max() > LOWEST_M)
