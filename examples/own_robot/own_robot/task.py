"""A task of your own: an action, and grape's own actions that its tree uses."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.drive_to_pose import drive_to_pose
from grape.actions.wait_for_localization import wait_for_localization
from grape.errors import ActionFailed, InvalidInput, Reason
from grape.plugins import Task


@dataclass(frozen=True, kw_only=True)
class WaveGoal:
    """How to wave.

    Attributes:
        angle: rad to each side.
        times: how often.
        speed: rad/s, at most 0.5.
    """

    angle: float = 0.1
    times: int = 2
    speed: float = 0.3

    def __post_init__(self) -> None:
        if not 0 < self.speed <= 0.5:
            raise InvalidInput(f"speed must be over 0 and at most 0.5 rad/s, got {self.speed}")


@action("Wave")
def wave(goal: WaveGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Turns the last joint to and fro."""
    start = float(ctx.drivers.arm.latest(max_age_s=0.1).position[-1])
    targets = [start + side * goal.angle for _ in range(goal.times) for side in (1, -1)] + [start]
    until = ctx.clock.now() + 2.0 + 4 * goal.times * goal.angle / goal.speed
    with ctx.arm.lease("Wave") as arm:
        for k, target in enumerate(targets):
            while abs(left := target - float(arm.latest(max_age_s=0.1).position[-1])) > 0.02:
                if ctx.clock.now() > until:
                    raise ActionFailed(Reason.TRACKING_ERROR, f"the last joint is {left:.2f} rad from its target")
                arm.send(np.array([0.0] * 5 + [np.clip(3 * left, -goal.speed, goal.speed)]))
                yield Feedback(status="waving", progress=k / len(targets))
    return NoResult()


TASK = Task(
    name="waving",
    summary="Drives somewhere and waves.",
    actions=(wave, drive_to_pose, wait_for_localization),
    serves_plants=False,
)
