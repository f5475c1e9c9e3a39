"""The simulated RTK receiver: where the antenna is, in WGS84, in fix or float mode."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grape.geodesy import Datum, geodetic_from_enu
from grape.geometry import quaternion_to_rotation
from grape.messages import Array, NavSatFix
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.physics import Physics
from grape.sim.sensors.gnss import FloatSpell, GnssModel, float_spells
from grape.sim.sensors.noise import FrameNoise


@dataclass(frozen=True, kw_only=True)
class GnssOptions:
    """Where the antenna is mounted, how often it reports, and its errors."""

    body: str = "base_link"
    site: str = "gnss_link"
    period_s: float = 1.0
    errors: GnssModel = field(default_factory=GnssModel)


class SimulatedGnss(SampledSensor[NavSatFix]):
    """An RTK receiver. The covariance of a float position covers its bias as well as its noise."""

    def __init__(self, physics: Physics, datum: Datum, seed: int, options: GnssOptions) -> None:
        super().__init__(physics, "gnss", options.period_s)
        self._datum = datum
        self._options = options
        self._mount = physics.model.site_pos[physics.identify("site", options.site)].copy()
        body = physics.identify("body", options.body)
        self._qpos = int(physics.model.jnt_qposadr[physics.model.body_jntadr[body]])
        self._noise = FrameNoise(seed, "gnss")
        self._spells = list(float_spells(options.errors, self._noise.constant()))

    def jump(self, bias: Array, start: float, end: float, *, wrong_fix: bool = False) -> None:
        """Add a float spell with the given bias (3,) m from `start` to `end` seconds; or a fix that is wrong."""
        self._spells.append(FloatSpell(start=start, end=end, bias=np.array(bias, dtype=float), wrong_fix=wrong_fix))

    def _snapshot(self) -> tuple[Array, Array, bool]:
        now = self._physics.clock.now()
        spells = [spell for spell in self._spells if spell.start <= now < spell.end]
        bias = sum((spell.bias for spell in spells), np.zeros(3))
        base = self._physics.data.qpos[self._qpos : self._qpos + 7]
        antenna = base[:3] + quaternion_to_rotation(base[3:]) @ self._mount
        return antenna, bias, any(spell.bias.any() and not spell.wrong_fix for spell in spells)

    def _measure(self, index: int, stamp: float, snapshot: tuple[Array, Array, bool]) -> NavSatFix:
        model = self._options.errors
        antenna, bias, floating = snapshot
        horizontal = model.float_sigma if floating else model.fix_sigma
        sigma = np.array([horizontal, horizontal, 2 * horizontal if floating else model.fix_sigma_up])
        latitude, longitude, altitude = geodetic_from_enu(
            self._datum, antenna + bias + sigma * self._noise.normal(index, 3)
        )
        # A uniformly distributed length has the mean square (a^2 + a b + b^2) / 3, shared by two axes.
        low, high = model.float_bias
        spread = (low * low + low * high + high * high) / 6.0 if floating else 0.0
        return NavSatFix(
            stamp=stamp,
            frame_id=self._options.site,
            latitude=float(latitude),
            longitude=float(longitude),
            altitude=float(altitude),
            covariance=np.diag(sigma**2 + spread),
            status="float" if floating else "fix",
        )
