"""A timed joint motion: what it is and where it is at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, frozen_array


@dataclass(frozen=True, kw_only=True)
class TrajectoryPoint:
    """Joint angles, speeds and accelerations at one time: (n,) rad, rad/s, rad/s^2."""

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """Joint angles and speeds at knots, cubic between them.

    Attributes:
        times: (k,) s, from 0, rising.
        positions: (k, n) rad, absolute.
        velocities: (k, n) rad/s.
    """

    times: Array
    positions: Array
    velocities: Array

    def __post_init__(self) -> None:
        for name in ("times", "positions", "velocities"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), float))
        k = len(self.times)
        if (
            self.positions.ndim != 2
            or self.positions.shape != self.velocities.shape
            or len(self.positions) != k
            or k < 1
        ):
            raise InvalidInput(
                f"a trajectory needs k >= 1 times and (k, n) positions and velocities, got {self.times.shape}, "
                f"{self.positions.shape}, {self.velocities.shape}"
            )
        if self.times[0] != 0.0 or (np.diff(self.times) <= 0).any():
            raise InvalidInput("the times of a trajectory must rise from 0")
        if not (np.isfinite(self.times).all() and np.isfinite(self.positions).all()):
            raise InvalidInput("a trajectory must be finite")

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return float(self.times[-1])

    @property
    def start(self) -> Array:
        """First joint angles (n,)."""
        return self.positions[0]

    @property
    def end(self) -> Array:
        """Last joint angles (n,)."""
        return self.positions[-1]

    def sample(self, t: float) -> TrajectoryPoint:
        """The set-point at `t` seconds; before the start and after the end it rests there."""
        rest = np.zeros(self.positions.shape[1])
        if t >= self.duration or len(self.times) == 1:
            return TrajectoryPoint(position=self.end, velocity=rest, acceleration=rest)
        if t <= 0.0:
            return TrajectoryPoint(position=self.start, velocity=rest, acceleration=rest)
        i = int(np.searchsorted(self.times, t, side="right")) - 1
        h = self.times[i + 1] - self.times[i]
        s = (t - self.times[i]) / h
        q0, q1 = self.positions[i], self.positions[i + 1]
        m0, m1 = h * self.velocities[i], h * self.velocities[i + 1]
        a, b = 2 * (q0 - q1) + m0 + m1, 3 * (q1 - q0) - 2 * m0 - m1  # q = a s^3 + b s^2 + m0 s + q0
        return TrajectoryPoint(
            position=((a * s + b) * s + m0) * s + q0,
            velocity=((3 * a * s + 2 * b) * s + m0) / h,
            acceleration=(6 * a * s + 2 * b) / h**2,
        )

    def progress(self, t: float) -> float:
        """Fraction 0..1 of the duration."""
        return 1.0 if self.duration == 0.0 else float(np.clip(t / self.duration, 0.0, 1.0))
