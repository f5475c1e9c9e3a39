"""Progress checker: whether a base that should come nearer to its goal does.

Source: Nav2 progress checker, with the way left along the path instead of the distance moved.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grape.geometry import wrap_angle
from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class ProgressOptions:
    """Patience in seconds.

    Args:
        step: m by which the way left must shrink to count.
        stuck_s: with free way, but without coming nearer.
        blocked_s: with something in the way that does not go.
        still_s: without any motion, whatever the base is about.
        still_m, still_rad: how far it must go or turn for a motion.
    """

    step: float = 0.02
    stuck_s: float = 12.0
    blocked_s: float = 15.0
    still_s: float = 20.0
    still_m: float = 0.05
    still_rad: float = 0.05


@dataclass(kw_only=True)
class ProgressChecker:
    """Watches the way left, and whether the base moves at all.

    Attributes:
        free_s: time at which the way was free last.
    """

    begun_s: float
    options: ProgressOptions = field(default_factory=ProgressOptions)
    free_s: float = field(init=False)
    _nearest: float = field(init=False, default=np.inf)
    _nearer_s: float = field(init=False)
    _told_s: float = field(init=False)
    _moved_s: float = field(init=False)
    _rest: Array | None = field(init=False, default=None)  # (3,) x y yaw where it began to stand

    def __post_init__(self) -> None:
        self.free_s = self._nearer_s = self._told_s = self._moved_s = self.begun_s

    def restart(self, now: float) -> None:
        """Begin with another path."""
        self._nearest, self._nearer_s, self._told_s = np.inf, now, now

    def pause(self, now: float) -> None:
        """The base was told to stand since the last word: that time counts for nothing."""
        self.free_s += now - self._told_s
        self._nearer_s += now - self._told_s
        self._moved_s += now - self._told_s
        self._told_s = now

    def update(self, now: float, left: float, pose: Array, *, blocked: bool, excused: bool) -> None:
        """Take note of the way left (m) and the pose (3,); `excused` is a manoeuvre that need not come nearer."""
        if self._rest is None or self._is_elsewhere(pose, self._rest):
            self._rest, self._moved_s = pose, now
        if left < self._nearest - self.options.step or excused:
            self._nearest, self._nearer_s = left, now
        if not blocked:
            self.free_s = now
        self._told_s = now

    def blocked_for(self, now: float) -> float:
        """Seconds since the way was free."""
        return now - self.free_s

    def stuck(self, now: float) -> bool:
        """Whether the way was free and the base came no nearer for too long."""
        return self.free_s == now and now - self._nearer_s > self.options.stuck_s

    def still(self, now: float) -> bool:
        """Whether the base has not moved for too long."""
        return now - self._moved_s > self.options.still_s

    def _is_elsewhere(self, pose: Array, rest: Array) -> bool:
        way, turn = np.hypot(*(pose[:2] - rest[:2])), np.abs(wrap_angle(pose[2] - rest[2]))
        return bool(way > self.options.still_m or turn > self.options.still_rad)

    def given_up(self, now: float) -> bool:
        """Whether something has been in the way for too long."""
        return self.blocked_for(now) > self.options.blocked_s
