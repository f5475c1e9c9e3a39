"""What servoing to a nail and to a spur share: goal, result, and the way back when it fails."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any

from grape.actions.core import Context, Feedback
from grape.actions.servo_tries import with_retries
from grape.actions.servoing import go_straight, hand_shift, leave
from grape.drivers import ArmDriver
from grape.messages import Array
from grape.tasks.dispenser.targets import HangTarget


@dataclass(frozen=True, kw_only=True)
class ServoToTargetGoal:
    """Which nail or spur, and how.

    Attributes:
        target: the nail as the survey has it, or the deployment pose.
        stand_off_m: of the loop before the tip at which the first stage settles.
        timeout_s: of one servo run.
        tries: runs from the staging pose, the one in which this action was started.
    """

    target: HangTarget
    stand_off_m: float = 0.08
    timeout_s: float = 25.0
    tries: int = 2


@dataclass(frozen=True, kw_only=True)
class ServoToTargetResult:
    """Attributes: refined: nail or spur where the camera has shown it to be."""

    refined: HangTarget


def servo_to_target(
    goal: ServoToTargetGoal,
    ctx: Context,
    arm: ArmDriver,
    T_hand_nails: Array,
    attempt: Callable[[], Generator[Feedback, None, Any]],
    look: Callable[[], Generator[Feedback, None, None]],
) -> Generator[Feedback, None, ServoToTargetResult]:
    """Looks and runs `attempt`, again from the staging pose when that fails, and tells where the target is."""
    target = goal.target
    T_staging = ctx.robot.hand_pose(ctx.world.joints())

    def back() -> Generator[Feedback, None, None]:
        here = ctx.robot.hand_pose(ctx.world.joints())[:3, 3]
        inside = float((T_staging[:3, 3] - here) @ target.approach)
        if inside > 0.0:
            yield from leave(ctx, arm, target.approach, inside)
        yield from go_straight(ctx, arm, T_staging, status="back before the target")

    yield from with_retries(ctx, goal.tries, attempt, back, look)
    shift = hand_shift(ctx.robot.hand_pose(ctx.world.joints()), target.hand_pose(T_hand_nails))
    return ServoToTargetResult(refined=replace(target, tip=target.tip + shift))
