"""Take up the deployment poses that were found before an interruption."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, action
from grape.tasks.dispenser.actions.next_target import remembered
from grape.tasks.dispenser.targets import HangTarget


@dataclass(frozen=True, kw_only=True)
class RecallTargetsGoal:
    """Attributes: plant: id in the site file."""

    plant: str


@dataclass(frozen=True, kw_only=True)
class RecallTargetsResult:
    """Attributes: targets: deployment poses still to try, from the one at which it was interrupted."""

    targets: tuple[HangTarget, ...]


@action("RecallTargets")
def recall_targets(goal: RecallTargetsGoal, ctx: Context) -> Generator[Feedback, None, RecallTargetsResult]:
    """Gives the deployment poses that the ledger remembers of this stop: the base has not moved, so they hold."""
    yield Feedback(status="recalling the deployment poses")
    return RecallTargetsResult(targets=remembered(ctx, goal.plant))
