"""Biases of rates and accelerations, learnt while the base stands.

Source: Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd edition, 2013, section
15.3 (zero velocity and zero angular rate updates).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grape.localization.state import Belief, Measurement
from grape.messages import Array

MOVING = slice(6, 15)
SETTLED_S, FRESH_S = 0.3, 0.2


class Standing:
    """Whether the base stands, by the last word of the sensors that can tell."""

    def __init__(self) -> None:
        self._since: float | None = None
        self._until = -np.inf

    def told(self, stamp: float, stands: bool) -> None:
        """A sensor said at `stamp` (s) whether it stands."""
        self._since = (stamp if self._since is None else self._since) if stands else None
        self._until = stamp

    def at(self, stamp: float) -> bool:
        """Whether it has stood long enough to have settled, and somebody has just said so."""
        return self._since is not None and stamp - self._since >= SETTLED_S and stamp - self._until <= FRESH_S


class StillBias:
    """What a sensor says too much of some components.

    While the base stands its rates are zero and an accelerometer feels gravity alone. What is said beyond that is
    averaged over all standing since the start, later over the last `forget_s` of it.

    Args:
        learnt: (15,) flags of the components whose bias is learnt.
        forget_s: s of standing after which an old bias counts little.
    """

    def __init__(self, learnt: Array, forget_s: float) -> None:
        from grape.localization.ekf_observation import observe  # numba takes a second to import

        self.bias = np.zeros(15)
        self._observe = observe
        self._learnt = learnt
        self._forget_s = forget_s
        self._stood_s = 0.0
        self._before: float | None = None  # stamp of the last reading while it stood, s

    def taken_off(self, measurements: list[Measurement], standing: Belief | None) -> list[Measurement]:
        """The measurements of one reading without their biases, learnt from them first where the base stands.

        Args:
            standing: belief of the filter when the base stands, None when it does not.
        """
        if standing is None:
            self._before = None
        elif measurements:
            self._learn(measurements, standing)
        return [replace(m, value=m.value - self.bias[m.index]) for m in measurements]

    def _learn(self, measurements: list[Measurement], standing: Belief) -> None:
        stamp = measurements[0].stamp
        before, self._before = self._before, stamp
        if before is None or not stamp > before or not all(np.isfinite(m.value).all() for m in measurements):
            return
        resting = standing.mean.copy()
        resting[MOVING] = 0.0
        self._stood_s = min(self._stood_s + stamp - before, self._forget_s)
        share = min((stamp - before) / self._stood_s, 1.0)
        for m in measurements:
            expected, _ = self._observe(resting, m.index, m.lever, m.frames)
            at = self._learnt[m.index]
            index = m.index[at]
            self.bias[index] += share * ((m.value - expected)[at] - self.bias[index])
