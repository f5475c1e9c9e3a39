"""Wait until the robot knows where it is."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, action
from grape.errors import ActionFailed, Reason


@dataclass(frozen=True, kw_only=True)
class WaitForLocalizationGoal:
    """Attributes: timeout_s: without a good estimate by then, the action fails."""

    timeout_s: float = 30.0


@action("WaitForLocalization")
def wait_for_localization(goal: WaitForLocalizationGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Waits, standing, until the pose estimate is good enough to drive by."""
    start = ctx.clock.now()
    while not ctx.world.localized:
        if ctx.clock.now() - start > goal.timeout_s:
            raise ActionFailed(Reason.NOT_LOCALIZED, f"no good pose estimate within {goal.timeout_s} s")
        yield Feedback(status="estimating the pose")
    return NoResult()
