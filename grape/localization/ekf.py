"""Extended Kalman filter of 15 states with a configuration vector per sensor.

Source: Moore and Stouch, A generalized extended Kalman filter implementation for the Robot Operating System, 2014.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from math import ceil, isfinite, isnan

import numpy as np

from grape.errors import InvalidInput
from grape.localization.state import Belief, Correction, Measurement, Verdict
from grape.messages import Array, frozen_array

MOST_STEPS = 1000
PORTION = 17  # beliefs that are forgotten at a time at least: a deletion at the front moves the whole list


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
        max_step_s: a longer prediction is split into steps of this length, a very long one into 1000 steps.
        longest_gap_s: a measurement further ahead of the belief is refused: its stamp is taken for wrong.
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
    longest_gap_s: float = 3600.0

    def __post_init__(self) -> None:
        for name in ("noise", "motion_noise", "turn_noise"):
            value = frozen_array(getattr(self, name), float)
            if value.shape != (15,) or not (value >= 0).all():
                raise InvalidInput(f"{name} must be 15 variances >= 0, got {value}")
            object.__setattr__(self, name, value)
        if not (self.history_s >= 0 and self.max_step_s > 0 and self.longest_gap_s > 0):
            raise InvalidInput(
                f"history_s >= 0, max_step_s > 0 and longest_gap_s > 0 needed, got {self.history_s}, "
                f"{self.max_step_s}, {self.longest_gap_s}"
            )
        object.__setattr__(self, "noises", frozen_array([self.noise, self.motion_noise, self.turn_noise]))

    noises: Array = field(init=False, repr=False, compare=False)  # (3, 15) as the kernels take them


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
        if np.abs(covariance - covariance.T).max() > 1e-9 or np.linalg.eigvalsh(covariance)[0] < -1e-9:
            raise InvalidInput("the initial covariance must be symmetric and without negative eigenvalues")
        covariance = 0.5 * (covariance + covariance.T)  # the kernels keep it so to the last bit
        self.options = options or EkfOptions()
        self._kernels = ekf_kernels
        if self.options.two_d:
            ekf_kernels.flatten(mean, covariance)
        self._stamps: list[float] = [stamp]
        self._beliefs: list[Belief] = [_frozen(stamp, mean, covariance)]
        self._causes: list[Measurement | _Widening | None] = [None]

    @property
    def belief(self) -> Belief:
        """Mean and covariance at the newest stamp."""
        return self._beliefs[-1]

    def predicted(self, stamp: float) -> Belief:
        """The belief moved to `stamp` without changing the filter; an earlier stamp gives the belief as it is."""
        belief, options = self.belief, self.options
        duration = stamp - belief.stamp
        if not duration > 0:
            return belief
        mean, covariance = self._kernels.advance(
            belief.mean, belief.covariance, options.noises, duration, self._steps(duration), options.two_d
        )
        return _frozen(stamp, mean, covariance)

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
        stamp, newest = measurement.stamp, self._stamps[-1]
        if newest <= stamp <= newest + self.options.longest_gap_s:
            return self._fuse(measurement)
        if not measurement.usable:
            return Correction(verdict=Verdict.NOT_FINITE)
        if stamp < self._stamps[0]:
            return Correction(verdict=Verdict.TOO_OLD)
        if stamp > newest:
            return Correction(verdict=Verdict.TOO_NEW)
        place = bisect_right(self._stamps, stamp)
        later, later_stamps = self._causes[place:], self._stamps[place:]
        for buffer in (self._stamps, self._beliefs, self._causes):
            del buffer[place:]
        correction = self._fuse(measurement)
        for stamp, cause in zip(later_stamps, later, strict=True):
            if cause is None:
                self._append(self.predicted(stamp), None)
            elif isinstance(cause, _Widening):
                self._widen(cause)
            else:
                self._fuse(cause)
        return correction

    def widen(self, index: Array, variance: float) -> None:
        """Add `variance` to the given components of the newest belief: the caller no longer trusts them."""
        self._widen(_Widening(frozen_array(index, np.int64), variance))

    def _widen(self, widening: _Widening) -> None:
        belief, index = self.belief, widening.index
        covariance = belief.covariance.copy()
        covariance[index, index] += widening.variance
        self._append(_frozen(belief.stamp, belief.mean, covariance), widening)

    def _fuse(self, m: Measurement) -> Correction:
        prior, options = self.belief, self.options
        duration = m.stamp - prior.stamp
        mean, covariance, distance = self._kernels.fuse(
            prior.mean,
            prior.covariance,
            options.noises,
            duration,
            self._steps(duration),
            options.two_d,
            m.index,
            m.value,
            m.covariance,
            m.lever,
            m.gate,
            m.frames,
        )
        if isnan(distance):
            return Correction(verdict=Verdict.NOT_FINITE)
        self._append(_frozen(max(m.stamp, prior.stamp), mean, covariance), m)
        return Correction(verdict=Verdict.GATED if distance > m.gate else Verdict.ACCEPTED, distance=distance)

    def _steps(self, duration: float) -> int:
        if duration <= 0:
            return 0
        return max(1, min(MOST_STEPS, ceil(duration / self.options.max_step_s - 1e-9)))

    def _append(self, belief: Belief, cause: Measurement | _Widening | None) -> None:
        self._stamps.append(belief.stamp)
        self._beliefs.append(belief)
        self._causes.append(cause)
        since = belief.stamp - self.options.history_s
        if len(self._stamps) > PORTION and self._stamps[PORTION] <= since:
            oldest = bisect_right(self._stamps, since) - 1
            for buffer in (self._stamps, self._beliefs, self._causes):
                del buffer[:oldest]


@dataclass(frozen=True)
class _Widening:
    """That some components were no longer trusted from some time on."""

    index: Array
    variance: float


def _frozen(stamp: float, mean: Array, covariance: Array) -> Belief:
    mean.setflags(write=False)  # in half the time of flags.writeable
    covariance.setflags(write=False)
    return Belief(stamp, mean, covariance)
