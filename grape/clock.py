"""Time: the one protocol through which anything in grape reads it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

AHEAD_S = 0.05  # how far a stamp may be ahead of the clock that reads it; what is further ahead is of another clock


class Clock(Protocol):
    """A source of time in seconds; simulated time or a monotonic clock."""

    def now(self) -> float:
        """Seconds since the clock's epoch, never decreasing."""
        ...


class MonotonicClock:
    """Wall-clock time since construction, immune to clock adjustments.

    Args:
        start_s: what it shows at first.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._zero_s = time.monotonic() - start_s

    def now(self) -> float:
        return time.monotonic() - self._zero_s


class Beats:
    """Beats of a clock that nobody can hold: `wait` sleeps until the next one is due.

    A beat that took too long is not made up for: the next one comes at once, and the one after it a whole period later.

    Args:
        sleep: lets so many seconds of the clock pass.
    """

    def __init__(self, clock: Clock, period_s: float, sleep: Callable[[float], None] = time.sleep) -> None:
        self._clock, self._period_s, self._sleep = clock, period_s, sleep
        self._due_s = clock.now()

    def wait(self) -> None:
        """Let the time until the next beat pass."""
        now = self._clock.now()
        self._due_s = max(self._due_s + self._period_s, now)
        self._sleep(self._due_s - now)
