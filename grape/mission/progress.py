"""What a running mission tells a person: phase, plant, percent, times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Progress:
    """One moment of a mission.

    Attributes:
        phase: the action that runs.
        plant: id of the plant in hand, empty between plants.
        done, plants: how many plants have an outcome, of how many.
        real_time_factor: simulated seconds per second of the wall clock since the start.
    """

    phase: str
    plant: str
    done: int
    plants: int
    sim_time_s: float
    wall_time_s: float

    @property
    def percent(self) -> float:
        return 100.0 * self.done / max(self.plants, 1)

    @property
    def real_time_factor(self) -> float:
        return self.sim_time_s / self.wall_time_s if self.wall_time_s > 0 else 0.0


class ProgressTracker:
    """Follows a mission's events."""

    def __init__(self, plants: Sequence[str]) -> None:
        self._plants = len(plants)
        self.finished: set[str] = set()
        self.plant = ""
        self.phase = "starting"

    def observe(self, event: dict[str, Any]) -> None:
        """Take one event of the recorder into account."""
        kind = event["kind"]
        if kind == "plant_started":
            self.plant = str(event["plant"])
        elif kind == "plant_finished":
            self.finished.add(str(event["plant"]))
        elif kind == "action" and event["status"] == "active":
            self.phase = str(event["name"])

    def progress(self, sim_time_s: float, wall_time_s: float) -> Progress:
        """The moment as it is now."""
        return Progress(
            phase=self.phase,
            plant=self.plant,
            done=len(self.finished),
            plants=self._plants,
            sim_time_s=sim_time_s,
            wall_time_s=wall_time_s,
        )
