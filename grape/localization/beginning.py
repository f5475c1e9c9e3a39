"""How a filter begins: its options, and its first belief of the first measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import transform
from grape.localization.ekf import Ekf, EkfOptions
from grape.localization.state import STATE, Measurement
from grape.messages import Array

FAR_M = 1e3
INITIAL_STD = np.array([*[1e-3] * 3, 0.1, 0.1, 1e-3, *[1.0] * 3, *[0.5] * 3, *[0.5] * 3])


@dataclass(frozen=True, kw_only=True)
class FusionOptions:
    """The filter, its frames and how it begins.

    Args:
        frame_id: frame of the estimate: map, or odom for a filter without absolute positions.
        initial: values of components at the start, by name; all others come from the sensors, or are 0.
        initial_std: their standard deviations, by name.
        leap_s: a reading that is further ahead of all others waits for the next one to agree on the time.
        restart_after: after so many readings in a row that were refused for their stamps the filter begins anew.
    """

    filter: EkfOptions = field(default_factory=EkfOptions)
    frame_id: str = "map"
    child_frame_id: str = "base_link"
    initial: Mapping[str, float] = field(default_factory=dict)
    initial_std: Mapping[str, float] = field(default_factory=dict)
    leap_s: float = 10.0
    restart_after: int = 200

    def __post_init__(self) -> None:
        for name in ("initial", "initial_std"):
            given: Mapping[str, float] = getattr(self, name)
            if unknown := set(given) - set(STATE):
                raise InvalidInput(f"{name}: unknown components {sorted(unknown)}; allowed: {', '.join(STATE)}")
            if not all(isfinite(v) for v in given.values()):
                raise InvalidInput(f"{name} must be finite, got {dict(given)}")
        if any(v <= 0 for v in self.initial_std.values()):
            raise InvalidInput(f"initial_std must be positive, got {dict(self.initial_std)}")


def begun(firsts: list[Measurement], absolute: Array, options: FusionOptions) -> Ekf:
    """A filter that begins with the first measurements, the newest last.

    Args:
        absolute: (6,) components of the pose that they give.
    """
    mean, std = np.zeros(15), INITIAL_STD.copy()
    std[:3][absolute[:3]], std[3:6][absolute[3:]] = FAR_M, np.pi
    for names, target in ((options.initial, mean), (options.initial_std, std)):
        for name, value in names.items():
            target[STATE.index(name)] = value
    for m in firsts:  # angles are set, not corrected: half a turn is no small error
        angles = [k for k, i in enumerate(m.index) if 3 <= i < 6 and absolute[i]]
        mean[m.index[angles]], std[m.index[angles]] = m.value[angles], np.sqrt(m.covariance.diagonal()[angles])
        place = _measured_place(m)
        mean[:3] = np.where((std[:3] == FAR_M) & np.isfinite(place), place, mean[:3])
    stamp = firsts[-1].stamp
    ekf = Ekf(stamp, mean, np.diag(std**2), options.filter)
    for m in firsts:
        positions = np.flatnonzero(m.index < 3)
        if positions.size:
            ekf.correct(_part(m, positions, stamp))
    return ekf


def _measured_place(m: Measurement) -> Array:
    """(3,) m, the sensor's place as far as it was measured, else NaN: from 0 the broad first belief would pull."""
    measured = np.flatnonzero(m.index < 3)
    place = np.zeros(3)
    place[m.index[measured]] = m.value[measured]
    if m.mount is not None:
        place = transform(m.mount.T_world_frame, place)
    return np.where(np.isin(np.arange(3), m.index[measured]), place, np.nan)


def _part(m: Measurement, chosen: Array, stamp: float) -> Measurement:
    """Some components of a measurement, at another time and without a gate."""
    return Measurement(
        stamp=stamp,
        source=m.source,
        index=m.index[chosen],
        value=m.value[chosen],
        covariance=m.covariance[np.ix_(chosen, chosen)],
        mount=m.mount,
    )
