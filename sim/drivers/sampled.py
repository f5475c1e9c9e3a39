"""A simulated sensor: notes the state at each due step and makes the message only when somebody reads it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile
from typing import Any, ClassVar, Generic, TypeVar

from grape.errors import InvalidInput, StaleData
from grape.messages import Message
from grape.sim.physics import STEPS_PER_SECOND, Physics

M = TypeVar("M", bound=Message)
_BUFFER_S = 2.0


@dataclass
class _Slot(Generic[M]):
    index: int
    stamp: float
    snapshot: Any
    message: M | None = None


class SampledSensor(ABC, Generic[M]):
    """Base of the simulated sensors.

    `STATE` names the attributes that a checkpoint of the world keeps: numbers, or tuples and arrays of them, that the
    next samples and movements depend on. Messages that nobody has read yet are not among them.

    Args:
        physics: the scene it looks at.
        name: for error texts.
        period_s: time between samples, a multiple of the physics step.
        latency_s: how long after its capture a sample may be read.

    Raises:
        InvalidInput: the period is no whole number of steps.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_frozen",)

    def __init__(self, physics: Physics, name: str, period_s: float, latency_s: float = 0.0) -> None:
        steps = round(period_s * STEPS_PER_SECOND)
        if steps < 1 or abs(steps / STEPS_PER_SECOND - period_s) > 1e-9:
            raise InvalidInput(f"{name}: the period must be a whole number of 2 ms steps, got {period_s} s")
        self._physics = physics
        self._name = name
        self.period_steps = steps
        self._latency_steps = round(latency_s * STEPS_PER_SECOND)
        self._frozen = False
        keep = int(_BUFFER_S * STEPS_PER_SECOND / steps) + 1 + -(-self._latency_steps // steps)
        self._slots: deque[_Slot[M]] = deque(maxlen=keep)

    def sample(self) -> None:
        """Note the present state; the simulation calls this at each due step."""
        snapshot = self._snapshot()  # of a silent sensor too: rates are counted from one to the next
        if not self._frozen:
            clock = self._physics.clock
            self._slots.append(_Slot(clock.step // self.period_steps, clock.now(), snapshot))

    def freeze(self, frozen: bool = True) -> None:
        """Stop (or resume) sampling: the last message stays and grows old."""
        self._frozen = frozen

    def forget(self) -> None:
        """Drop every message, read or not."""
        self._slots.clear()

    def latest(self, max_age_s: float | None = None) -> M:
        """The newest message.

        Raises:
            StaleData: there is none yet, or it is older than `max_age_s`.
        """
        slot = next(self._readable(), None)
        if slot is None:
            raise StaleData(f"{self._name}: nothing measured yet")
        age_s = self._physics.clock.now() - slot.stamp
        if max_age_s is not None and age_s > max_age_s + 1e-9:
            raise StaleData(
                f"{self._name}: the newest message is {age_s:.3f} s old, at most {max_age_s:.3f} s is allowed"
            )
        return self._message(slot)

    def since(self, stamp: float) -> tuple[M, ...]:
        """Every buffered message newer than `stamp`, oldest first."""
        newer = list(takewhile(lambda slot: slot.stamp > stamp + 1e-9, self._readable()))
        return tuple(self._message(slot) for slot in reversed(newer))

    def _readable(self) -> Iterator[_Slot[M]]:
        """What may be read by now, newest first."""
        newest = (self._physics.clock.step - self._latency_steps) / STEPS_PER_SECOND + 1e-9
        return (slot for slot in reversed(self._slots) if slot.stamp <= newest)

    def _message(self, slot: _Slot[M]) -> M:
        if slot.message is None:
            slot.message = self._measure(slot.index, slot.stamp, slot.snapshot)
            slot.snapshot = None
        return slot.message

    @abstractmethod
    def _snapshot(self) -> Any:
        """What a message will need of the present state; cheap, and copied."""

    @abstractmethod
    def _measure(self, index: int, stamp: float, snapshot: Any) -> M:
        """The message of sample `index`; may depend on its arguments and the seed alone."""
