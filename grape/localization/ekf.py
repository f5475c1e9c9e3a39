"""Extended Kalman filter of 15 states with a configuration vector per sensor.

Source: Moore and Stouch, A generalized extended Kalman filter implementation for the Robot Operating System, 2014.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, isfinite

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, frozen_array

STATE = ("x", "y", "z", "roll", "pitch", "yaw", "vx", "vy", "vz", "wx", "wy", "wz", "ax", "ay", "az")
OUT_OF_PLANE = (2, 3, 4, 8, 9, 10, 14)  # z, roll, pitch, vz, wx, wy, az


def components(*names: str) -> tuple[bool, ...]:
    """The configuration vector (15 flags in the order of `STATE`) that is true for the named components.

    Raises:
        InvalidInput: a name is not in `STATE`.
    """
    unknown = [name for name in names if name not in STATE]
    if unknown:
        raise InvalidInput(f"unknown state components {unknown}; allowed: {', '.join(STATE)}")
    return tuple(name in names for name in STATE)


@dataclass(frozen=True, kw_only=True)
class EkfOptions:
    """How the filter moves between measurements.

    Args:
        noise: (15,) variance gained per second, in units squared of each state.
        motion_noise: (15,) variance gained per metre driven: slip.
        turn_noise: (15,) variance gained per radian turned; skidding wheels lose decimetres in a bend, and a filter
            that does not expect it takes the next good fix for a jump.
        two_d: hold z, roll, pitch and their rates at zero.
        history_s: how late a measurement may be; the filter is rewound and replayed for it.
        max_step_s: a longer prediction is split into steps of this length.
    """

    noise: Array = field(
        default_factory=lambda: np.array(
            [1e-6, 1e-6, 1e-6, 1e-5, 1e-5, 1e-7, 0.5, 0.05, 0.02, 0.5, 0.5, 1.0, 1e-4, 1e-4, 1e-4]
        )
    )
    motion_noise: Array = field(default_factory=lambda: np.array([5e-4, 5e-4, 5e-4, 1e-3, 1e-3, 1e-5, *([0.0] * 9)]))
    turn_noise: Array = field(default_factory=lambda: np.array([2e-2, 2e-2, 5e-4, 1e-3, 1e-3, 1e-5, *([0.0] * 9)]))
    two_d: bool = False
    history_s: float = 1.0
    max_step_s: float = 0.1

    def __post_init__(self) -> None:
        for name in ("noise", "motion_noise", "turn_noise"):
            value = frozen_array(getattr(self, name), float)
            if value.shape != (15,) or not (value >= 0).all():
                raise InvalidInput(f"{name} must be 15 variances >= 0, got {value}")
            object.__setattr__(self, name, value)
        if self.history_s < 0 or self.max_step_s <= 0:
            raise InvalidInput(f"history_s >= 0 and max_step_s > 0 needed, got {self.history_s}, {self.max_step_s}")


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """Values of some state components at one time.

    Args:
        source: name of the sensor, for counting and reports.
        index: (m,) indices into `STATE`.
        value: (m,) what was measured; positions in map, velocities, rates and accelerations in base_link.
        covariance: (m, m).
        lever: (3,) m, point of base_link whose position and velocity are meant (a GNSS antenna).
        gate: largest Mahalanobis distance that is accepted.
    """

    stamp: float
    source: str
    index: Array
    value: Array
    covariance: Array
    lever: Array = field(default_factory=lambda: np.zeros(3))
    gate: float = inf

    def __post_init__(self) -> None:
        for name, dtype in (("index", np.int64), ("value", float), ("covariance", float), ("lever", float)):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype))
        m = self.index.size
        if m == 0 or self.value.shape != (m,) or self.covariance.shape != (m, m) or self.lever.shape != (3,):
            raise InvalidInput(
                f"{self.source}: {m} components need values ({m},), covariance ({m}, {m}) and lever (3,), got "
                f"{self.value.shape}, {self.covariance.shape}, {self.lever.shape}"
            )

    @property
    def usable(self) -> bool:
        """Whether the numbers are finite and the variances positive."""
        total = self.stamp + self.value.sum() + self.covariance.sum() + self.lever.sum()  # one bad number spoils it
        return bool(isfinite(total) and self.covariance.diagonal().min() > 0)


class Verdict(StrEnum):
    """What the filter did with a measurement."""

    ACCEPTED = "accepted"
    GATED = "gated"
    NOT_FINITE = "not_finite"
    TOO_OLD = "too_old"


@dataclass(frozen=True, kw_only=True)
class Correction:
    """The verdict and the Mahalanobis distance of the innovation (nan when it was not computed)."""

    verdict: Verdict
    distance: float = np.nan

    @property
    def accepted(self) -> bool:
        return self.verdict is Verdict.ACCEPTED


@dataclass(frozen=True)
class Belief:
    """Mean (15,) and covariance (15, 15) at a time; read-only."""

    stamp: float
    mean: Array
    covariance: Array


class Ekf:
    """Holds the belief; moves it only to the stamps of measurements, so looking ahead never spoils what comes late.

    A measurement older than the belief is handled by going back to the last belief before it and replaying what was
    received since, within `history_s`; older ones are refused.
    """

    def __init__(self, stamp: float, mean: Array, covariance: Array, options: EkfOptions | None = None) -> None:
        from grape.localization import ekf_kernels  # numba takes a second to import

        mean, covariance = np.array(mean, float), np.array(covariance, float)
        if mean.shape != (15,) or covariance.shape != (15, 15):
            raise InvalidInput(f"mean (15,) and covariance (15, 15) needed, got {mean.shape} and {covariance.shape}")
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all() and isfinite(stamp)):
            raise InvalidInput("the initial stamp, mean and covariance must be finite")
        self.options = options or EkfOptions()
        self._kernels = ekf_kernels
        self._stamps: list[float] = [stamp]
        self._beliefs: list[Belief] = [self._flattened(Belief(stamp, mean, covariance))]
        self._measurements: list[Measurement | None] = [None]

    @property
    def belief(self) -> Belief:
        """Mean and covariance at the newest stamp."""
        return self._beliefs[-1]

    def predicted(self, stamp: float) -> Belief:
        """The belief moved to `stamp` without changing the filter; an earlier stamp gives the belief as it is."""
        return self._advanced(self.belief, stamp)

    def rotation(self, belief: Belief) -> Array:
        """R_map_base (3, 3) of a belief."""
        return self._kernels.rotation(belief.mean[3], belief.mean[4], belief.mean[5])

    def predict_to(self, stamp: float) -> Belief:
        """Move the filter to `stamp`; the covariance grows while sensors are silent."""
        if stamp > self.belief.stamp:
            self._append(self.predicted(stamp), None)
        return self.belief

    def correct(self, measurement: Measurement) -> Correction:
        """Fuse a measurement at its own stamp, late ones by rewind and replay."""
        if not measurement.usable:
            return Correction(verdict=Verdict.NOT_FINITE)
        if measurement.stamp < self._stamps[0]:
            return Correction(verdict=Verdict.TOO_OLD)
        place = bisect_right(self._stamps, measurement.stamp)
        later = self._measurements[place:]
        later_stamps = self._stamps[place:]
        for buffer in (self._stamps, self._beliefs, self._measurements):
            del buffer[place:]
        correction = self._fuse(measurement)
        for stamp, late in zip(later_stamps, later, strict=True):
            if late is None:
                self._append(self.predicted(stamp), None)
            else:
                self._fuse(late)
        return correction

    def widen(self, index: Array, variance: float) -> None:
        """Add `variance` to the given components of the newest belief: the caller no longer trusts them."""
        covariance = self.belief.covariance.copy()
        covariance[index, index] += variance
        self._append(Belief(self.belief.stamp, self.belief.mean, covariance), None)

    def _fuse(self, m: Measurement) -> Correction:
        prior = self.predicted(m.stamp)
        mean, covariance, distance = self._kernels.correct(
            prior.mean, prior.covariance, m.index, m.value, m.covariance, m.lever, m.gate
        )
        self._append(self._flattened(Belief(max(m.stamp, prior.stamp), mean, covariance)), m)
        return Correction(verdict=Verdict.GATED if distance > m.gate else Verdict.ACCEPTED, distance=float(distance))

    def _advanced(self, belief: Belief, stamp: float) -> Belief:
        remaining = stamp - belief.stamp
        mean, covariance = belief.mean, belief.covariance
        if remaining <= 0:
            return belief
        steps = max(1, int(np.ceil(remaining / self.options.max_step_s - 1e-9)))
        for _ in range(steps):
            mean, covariance = self._kernels.predict(
                mean,
                covariance,
                self.options.noise,
                self.options.motion_noise,
                self.options.turn_noise,
                remaining / steps,
            )
        return self._flattened(Belief(stamp, mean, covariance))

    def _flattened(self, belief: Belief) -> Belief:
        mean, covariance = belief.mean, belief.covariance
        if self.options.two_d:
            mean, covariance = mean.copy(), covariance.copy()
            index = np.array(OUT_OF_PLANE)
            mean[index] = 0.0
            covariance[index, :] = 0.0
            covariance[:, index] = 0.0
            covariance[index, index] = 1e-9
        mean.flags.writeable = covariance.flags.writeable = False
        return Belief(belief.stamp, mean, covariance)

    def _append(self, belief: Belief, measurement: Measurement | None) -> None:
        self._stamps.append(belief.stamp)
        self._beliefs.append(belief)
        self._measurements.append(measurement)
        oldest = bisect_right(self._stamps, belief.stamp - self.options.history_s) - 1
        if oldest > 16:  # trimmed in portions, a deletion at the front moves the whole list
            for buffer in (self._stamps, self._beliefs, self._measurements):
                del buffer[:oldest]
