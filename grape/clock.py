"""Time: the one protocol through which anything in grape reads it."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A source of time in seconds; simulated time or a monotonic clock."""

    def now(self) -> float:
        """Seconds since the clock's epoch, never decreasing."""
        ...


class MonotonicClock:
    """Wall-clock time since construction, immune to clock adjustments."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()

    def now(self) -> float:
        return time.monotonic() - self._start_s
