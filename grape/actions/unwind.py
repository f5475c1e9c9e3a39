"""Unwind the cables of the arm."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.move_arm import move_to_joints


@dataclass(frozen=True, kw_only=True)
class UnwindGoal:
    """Attributes: pose: the named arm pose to unwind to."""

    pose: str = "travel"


@action("Unwind")
def unwind(goal: UnwindGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Turns joints back by whole turns when one is farther from its unwound angle than half of its cable budget."""
    limits = ctx.robot.description.arm
    turned = np.abs(ctx.world.joints() - limits.unwound)
    yield Feedback(status=f"cables are at {turned.max() / limits.cable_turns:.0%} of their budget")
    if (turned > 0.5 * limits.cable_turns).any():
        with ctx.arm.lease("Unwind") as arm:
            yield from move_to_joints(ctx, arm, (limits.poses[goal.pose],), status="unwinding", absolute=True)
    return NoResult()
