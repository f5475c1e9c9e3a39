"""What actions write down before and after they change the world, so that a kill loses nothing."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

RESUMED = "resumed"  # in world.committed: an earlier session was cut off, and what it left is not settled yet


class Outcome(StrEnum):
    """What became of a plant."""

    DEPLOYED = "deployed"
    SKIPPED = "skipped"
    FAILED = "failed"


@dataclass(frozen=True, kw_only=True)
class PlantTask:
    """One plant of the mission as the ledger holds it."""

    plant: str
    mode: str  # nail | plant | plant_open_loop
    outcome: Outcome | None = None
    reason: str = ""
    attempts: int = 0


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step that changes the world, as the ledger holds it.

    Attributes:
        name: what is done.
        plant: id of the plant it is done for.
        details: where and how, as JSON has it.
        outcome: done or failed; None when it was begun and then cut off, so that only a look can tell what came of it.
    """

    name: str
    plant: str = ""
    details: Mapping[str, Any] = field(default_factory=dict)
    outcome: str | None = None


class Ledger(Protocol):
    """What was done to which plant and where each dispenser is; survives a kill (SQLite in `mission.ledger`)."""

    def plants(self) -> tuple[PlantTask, ...]:
        """Every plant of the mission, in the order it is to be served."""
        ...

    def attempt(self, plant: str) -> int:
        """Count one more deployment attempt on a plant; returns how many there were."""
        ...

    def finish(self, plant: str, outcome: Outcome, reason: str = "") -> None:
        """Write down what became of a plant."""
        ...

    def move_dispenser(self, source: str, target: str) -> None:
        """One dispenser went from a place to another: feeder, hand, lost, stock or a plant's id."""
        ...

    def refill(self, number: int, added: int) -> bool:
        """Somebody has put so many into the feeder, his refill `number`; False when that was written down before."""
        ...

    def refills(self) -> int:
        """Number of the last refill that was written down; 0 before the first."""
        ...

    def count_refill(self, seen: int) -> None:
        """The first look after a refill shows so many in the feeder: more than were told count as loaded."""
        ...

    def dispensers(self) -> Mapping[str, int]:
        """How many dispensers are at each place: feeder, hand, lost, plants' ids, and stock, ready for a refill."""
        ...

    def step(
        self, name: str, plant: str = "", *, moves_base: bool = False, **details: Any
    ) -> AbstractContextManager[None]:
        """Around a step that changes the world: it is written down before, its outcome after.

        Args:
            name, plant: what is done, and for which plant.
            moves_base: what was remembered of this stop is forgotten.
            details: where and how, JSON-able.
        """
        ...

    def last_step(self) -> Step | None:
        """The step that was begun last."""
        ...

    def remember(self, key: str, value: Any) -> None:
        """Keep something for as long as the base stands where it is: JSON-able, or bytes."""
        ...

    def recall(self, key: str) -> Any:
        """What was remembered since the base moved last; None when nothing was."""
        ...
