"""Choose the plant to serve next."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, action
from grape.errors import ActionFailed, Reason


@dataclass(frozen=True, kw_only=True)
class NextPlantGoal:
    """No inputs: the ledger knows the mission's plants and their order."""


@dataclass(frozen=True, kw_only=True)
class NextPlantResult:
    """The plant to serve.

    Attributes:
        plant: id in the site file.
        mode: how to hang there (nail, plant, plant_open_loop).
    """

    plant: str
    mode: str


@action("NextPlant")
def next_plant(goal: NextPlantGoal, ctx: Context) -> Generator[Feedback, None, NextPlantResult]:
    """Picks the first plant of the ledger that has no outcome yet; fails when every plant has one."""
    yield Feedback(status="choosing the next plant")
    for task in ctx.ledger.plants():
        if task.outcome is None:
            ctx.log.event("plant_started", plant=task.plant, mode=task.mode)
            return NextPlantResult(plant=task.plant, mode=task.mode)
    raise ActionFailed(Reason.NO_PLANT_LEFT, "every plant of the mission has an outcome")
