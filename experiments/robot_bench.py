"""A robot in a simulated world that does one action after the other, without a mission around them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self, TypeVar

import numpy as np

from grape.actions.core import Context, Feedback, InlineJobs
from grape.actions.robot import build_robot
from grape.errors import ActionFailed, Reason
from grape.messages import Array
from grape.mission.guard import guarded
from grape.mission.ledger import SqliteLedger
from grape.robots import RobotDescription
from grape.sim.simulation import Simulation, SimulationOptions
from grape.sim.worlds import World as Vineyard
from grape.world import World

R = TypeVar("R")


@dataclass
class BenchLog:
    """Keeps what actions tell."""

    events: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    pictures: dict[str, Array] = field(default_factory=dict)

    def event(self, kind: str, /, **fields: Any) -> None:
        """Keep an event."""
        self.events.append((kind, fields))

    def picture(self, name: str, bgr: Array) -> None:
        """Keep the last picture of this name."""
        self.pictures[name] = bgr

    def of(self, kind: str) -> list[dict[str, Any]]:
        """The events of one kind."""
        return [fields for name, fields in self.events if name == kind]


class RobotBench(ABC):
    """One robot in one world, its base guarded as in a mission; a subclass says what it senses at each beat.

    Args:
        description: of the robot.
        truth: the world; the robot starts where its site says.
        seed: of the sensors' noise.
        plant: the one in the ledger.
        options: how the scene starts.
    """

    def __init__(
        self, description: RobotDescription, truth: Vineyard, seed: int, plant: str, options: SimulationOptions
    ) -> None:
        self.truth = truth
        self.simulation = Simulation(truth, description, seed=seed, options=options)
        self.robot = build_robot(description)
        self.log = BenchLog()
        self._folder = TemporaryDirectory()
        account = Path(self._folder.name) / "ledger.sqlite"
        self._ledger = SqliteLedger.create(account, [(plant, "auto")], options.dispensers)
        world, drivers, clock = World(site=truth.site), self.simulation.drivers, self.simulation.clock
        self.ctx = Context(
            clock=clock,
            world=world,
            drivers=guarded(drivers, self.robot, world, clock, self.log),
            robot=self.robot,
            jobs=InlineJobs(),
            log=self.log,
            ledger=self._ledger,
            rng=np.random.default_rng([seed, 7]),
        )

    def run(self, action: Generator[Feedback, None, R], limit_s: float = 120.0) -> R:
        """Beat until an action ends.

        Raises:
            ActionFailed: it failed, or TIMEOUT: it was stopped after `limit_s` simulated seconds.
        """
        end = self.ctx.clock.now() + limit_s
        while self.ctx.clock.now() < end:
            try:
                next(action)
            except StopIteration as stop:
                result: R = stop.value
                return result
            self.simulation.advance()
            self._sense()
        action.close()
        raise ActionFailed(Reason.TIMEOUT, f"the action took longer than {limit_s} s")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Give the graphics memory back, and the account's folder."""
        self.simulation.close()
        self._ledger.close()
        self._folder.cleanup()

    @abstractmethod
    def _sense(self) -> None:
        """What the robot takes in at a beat."""
