"""Where the thread of an adapter leaves its messages for the beat."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

from grape.clock import AHEAD_S, Clock
from grape.errors import StaleData
from grape.messages import Message

M = TypeVar("M", bound=Message)
_AHEAD = "; what comes is stamped {:.3f} s ahead: stamps are clock.now() of the clock handed in"


class Mailbox(Generic[M]):
    """The newest messages of one device, put in by any thread: a `SensorDriver`.

    Args:
        name: for error texts.
        clock: the one that the messages are stamped by.
        keep_s: how long a message is kept after newer ones have come.
    """

    def __init__(self, name: str, clock: Clock, keep_s: float = 2.0) -> None:
        self._name, self._clock, self._keep_s = name, clock, keep_s
        self._messages: deque[M] = deque()
        self._ahead_s = 0.0  # of the message that came last, where it was refused for that
        self._lock = threading.Lock()

    def put(self, message: M) -> None:
        """Add a message. One that is stamped ahead of the clock, or before the newest, is refused."""
        ahead_s = message.stamp - self._clock.now()
        with self._lock:
            self._ahead_s = ahead_s if ahead_s > AHEAD_S else 0.0
            if self._ahead_s or (self._messages and message.stamp < self._messages[-1].stamp):
                return
            self._messages.append(message)
            while self._messages[0].stamp < message.stamp - self._keep_s:
                self._messages.popleft()

    def latest(self, max_age_s: float | None = None) -> M:
        """The newest message.

        Raises:
            StaleData: there is none yet, or it is older than `max_age_s`.
        """
        with self._lock:
            message, ahead_s = self._messages[-1] if self._messages else None, self._ahead_s
        hint = _AHEAD.format(ahead_s) if ahead_s else ""
        if message is None:
            raise StaleData(f"{self._name}: nothing measured yet{hint}")
        age_s = self._clock.now() - message.stamp
        if max_age_s is not None and age_s > max_age_s:
            raise StaleData(
                f"{self._name}: the newest message is {age_s:.3f} s old, at most {max_age_s:.3f} s is allowed{hint}"
            )
        return message

    def since(self, stamp: float) -> tuple[M, ...]:
        """Every kept message newer than `stamp`, oldest first."""
        with self._lock:
            return tuple(message for message in self._messages if message.stamp > stamp)
