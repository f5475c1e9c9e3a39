"""Bring the held loop over a spur by the arm's kinematics alone."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, action
from grape.actions.hand_path import HandPathOptions, follow_hand_path, straight
from grape.actions.servoing import go_straight
from grape.errors import ActionFailed
from grape.tasks.dispenser.targets import FELT_MAX, HangTarget


@dataclass(frozen=True, kw_only=True)
class LowerOntoTargetGoal:
    """Attributes: target: the deployment pose. speed: m/s."""

    target: HangTarget
    speed: float = 0.04


@dataclass(frozen=True, kw_only=True)
class LowerOntoTargetResult:
    """Attributes: reached: the target as it was given: nothing was measured on the way."""

    reached: HangTarget


@action("LowerOntoTarget")
def lower_onto_target(goal: LowerOntoTargetGoal, ctx: Context) -> Generator[Feedback, None, LowerOntoTargetResult]:
    """Moves straight from the stand-off to the deployment pose, open loop: it is as good as cloud and arm are.

    Where it fails on its way, as with CONTACT when the arm feels to touch something, it leaves the way it came.
    """
    robot = ctx.robot
    T_hand_nails = robot.hand.T_hand_nails(robot.description.gripper.open_angle)
    step = ctx.ledger.step("place", goal.target.plant, target=goal.target.as_record())
    with step, ctx.arm.lease("LowerOntoTarget") as arm:
        T_start, T_end = robot.hand_pose(ctx.world.joints()), goal.target.hand_pose(T_hand_nails)
        duration = float(np.linalg.norm(T_end[:3, 3] - T_start[:3, 3])) / goal.speed
        try:
            yield from follow_hand_path(
                ctx, arm, straight(T_start, T_end, duration), duration, status="lowering onto the target",
                options=HandPathOptions(felt_max=FELT_MAX),
            )  # fmt: skip
        except ActionFailed:
            with suppress(ActionFailed):  # what failed first is what to tell
                yield from go_straight(ctx, arm, T_start, status="back from the target")
            raise
    return LowerOntoTargetResult(reached=goal.target)
