"""Write down what became of a plant."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, Outcome, action


@dataclass(frozen=True, kw_only=True)
class FinishPlantGoal:
    """Which plant ended how.

    Attributes:
        plant: id in the site file.
        outcome: deployed, skipped or failed.
        why: reason code of a plant that was not deployed.
    """

    plant: str
    outcome: Outcome
    why: str = ""


@action("FinishPlant")
def finish_plant(goal: FinishPlantGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Writes a plant's outcome and reason into the ledger."""
    yield Feedback(status=f"plant {goal.plant} {goal.outcome}")
    ctx.ledger.finish(goal.plant, goal.outcome, goal.why)
    ctx.log.event("plant_finished", plant=goal.plant, outcome=str(goal.outcome), reason=goal.why)
    return NoResult()
