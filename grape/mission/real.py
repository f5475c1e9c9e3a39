"""A real robot as what a mission runs on: the drivers that it brings, and beats of the wall clock."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from grape.clock import Beats, Clock, MonotonicClock
from grape.drivers import Drivers
from grape.errors import InvalidInput
from grape.mission.record import read_events
from grape.mission.runner import BEAT_S
from grape.mission.track import Track
from grape.plugins import Plugin

DOWN_S = 1.0  # of the mission's clock between a kill and the next session


class RobotBackend:
    """The drivers of a robot, with a beat that waits for the clock."""

    def __init__(self, drivers: Drivers, clock: Clock) -> None:
        self.drivers = drivers
        self.clock = clock
        self._beats = Beats(clock, BEAT_S)

    def advance(self) -> None:
        """Wait for the next beat."""
        self._beats.wait()


@contextmanager
def connected(description: Any, name: str, start_s: float = 0.0) -> Iterator[RobotBackend]:
    """A robot on drivers of its own, which are closed at the end of the block.

    Args:
        description: `grape.robots.RobotDescription`.
        name: which of its `drivers`.
        start_s: what the clock shows at first.

    Raises:
        PluginError: they cannot be imported.
        InvalidInput: they are no `Drivers`, or a scanner of theirs has no mount.
        DriverError: they cannot be connected.
    """
    target = description.drivers[name]
    connect = Plugin(group="drivers", name=name, target=target, origin=description.name).load()
    clock = MonotonicClock(start_s)
    with connect(description, clock) as drivers:
        if not isinstance(drivers, Drivers):
            raise InvalidInput(f"{target} must give grape.drivers.Drivers, got {type(drivers).__name__}")
        lost = [scanner for scanner in (*drivers.scans, *drivers.clouds) if scanner not in description.mounts]
        if lost:  # the guard of the base would not look at it
            known = ", ".join(description.mounts)
            raise InvalidInput(f"{target}: {description.name} has no mount {', '.join(lost)}; there are {known}")
        yield RobotBackend(drivers, clock)


def resumed_at(folder: Path) -> float:
    """Time of the mission's clock at which the next session begins: after all that the earlier ones have written."""
    events = folder / "events.jsonl"
    stamps = [float(event["t"]) for event in read_events(events)] if events.exists() else []
    track = Track(folder / "track.csv")
    track.close()
    return max([*stamps, *track.samples[:, 0]], default=-DOWN_S) + DOWN_S
