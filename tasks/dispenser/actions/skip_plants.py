"""Give up the plants that are left."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, Outcome, action
from grape.tasks.dispenser.actions.finish_plant import FinishPlantGoal, finish_plant


@dataclass(frozen=True, kw_only=True)
class SkipPlantsGoal:
    """Attributes: why: reason code."""

    why: str


@action("SkipPlants")
def skip_plants(goal: SkipPlantsGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Writes down every plant without an outcome as skipped."""
    for task in ctx.ledger.plants():
        if task.outcome is None:
            yield from finish_plant(FinishPlantGoal(plant=task.plant, outcome=Outcome.SKIPPED, why=goal.why), ctx)
    return NoResult()
