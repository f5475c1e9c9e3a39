"""Ways to tell where the base of a log is; at any time each knows only what has come by then."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from grape.experiments.session_laser import FilterWithAmcl, session_scans, vineyard_and_map
from grape.experiments.skid_steer_log import (
    DATUM,
    LOCAL_SENSORS,
    PERIOD_S,
    SkidSteerLog,
    skid_steer_sensors,
    with_accelerations,
)
from grape.geodesy import enu_from_geodetic
from grape.localization import Cascade, Fusion, FusionOptions, Reading, SensorOptions, components, per_component
from grape.messages import Array

LOOK_S = 0.1
CHAIN_S = 0.1
YAW, CHAINED_YAW_STD = components("yaw"), 0.05  # rad; ten times a second, and smoothed already
CHI_SQUARE_95 = 5.991  # of two degrees of freedom


@dataclass(frozen=True, kw_only=True)
class Track:
    """What one way said at its looks.

    Attributes:
        stamps: (n,) s.
        said: (n, 2) m, x and y in map.
        true: (n, 2) m, the true place of the point that it speaks of.
        covariances: (n, 2, 2); empty where it gives none.
    """

    stamps: Array
    said: Array
    true: Array
    covariances: Array

    @property
    def errors(self) -> Array:
        """(n,) m."""
        return np.linalg.norm(self.said - self.true, axis=1)

    @property
    def lag_s(self) -> float:
        """By how much it trails: the least-squares time shift between what is said and the truth."""
        velocity = np.gradient(self.true, self.stamps, axis=0)
        return float(np.sum(velocity * (self.true - self.said)) / np.sum(velocity**2))

    @property
    def within_95(self) -> Array:
        """(n,) whether the truth is within the ellipse that should hold 95 % of all errors."""
        off = (self.said - self.true)[:, :, None]
        return np.squeeze(off.transpose(0, 2, 1) @ np.linalg.solve(self.covariances, off)) < CHI_SQUARE_95

    def between(self, first_s: float, last_s: float) -> Track:
        """The looks from one time to another."""
        some = (self.stamps >= first_s) & (self.stamps <= last_s)
        covariances = self.covariances[some] if len(self.covariances) else self.covariances
        return Track(stamps=self.stamps[some], said=self.said[some], true=self.true[some], covariances=covariances)


@dataclass(frozen=True, kw_only=True)
class Way:
    """One estimator of the comparison.

    Attributes:
        reference: what the reference found of it.
        keeps_up: whether it stays near enough to the truth for a lag to mean anything.
    """

    name: str
    colour: str
    reference: str
    track: Callable[[SkidSteerLog], Track]
    keeps_up: bool = True


def by_wheels(log: SkidSteerLog) -> Track:
    """Speeds of the wheels added up from the true start."""
    v, w = np.array([reading.values[[6, 11]] for reading in log.readings if reading.sensor == "wheels"]).T
    turned = np.cumsum(w) * PERIOD_S
    middle = turned - 0.5 * w * PERIOD_S
    moved = np.cumsum(np.column_stack([v * np.cos(middle), v * np.sin(middle)]), axis=0) * PERIOD_S
    every = round(LOOK_S / PERIOD_S)
    looks = slice(every - 1, None, every)
    true = log.poses[:, :2]
    return Track(stamps=log.stamps[looks], said=(true[0] + moved)[looks], true=true[looks], covariances=np.empty(0))


def _places(fixes: Sequence[Reading]) -> Array:
    """(n, 2) m, east and north of the antenna at fixes."""
    geodetic = [fix.geodetic for fix in fixes if fix.geodetic is not None]
    return np.array([enu_from_geodetic(DATUM, *place)[:2] for place in geodetic])


def by_gnss(log: SkidSteerLog) -> Track:
    """The place of the antenna by the newest fix that has come, held until the next; it gives no heading."""
    fixes = [reading for reading in log.readings if reading.sensor == "gnss"]
    came = np.array([fix.stamp for fix in fixes]) + log.noise.gnss_delay_s
    places = _places(fixes)
    stamps = np.arange(came[0], log.stamps[-1], LOOK_S)
    newest = np.searchsorted(came, stamps + 1e-9, side="right") - 1
    true = log.antenna[[log.index(stamp) for stamp in stamps], :2]
    return Track(stamps=stamps, said=places[newest], true=true, covariances=np.empty(0))


def at_its_fixes(log: SkidSteerLog) -> Track:
    """The same, asked for the very time at which each fix was measured."""
    fixes = [reading for reading in log.readings if reading.sensor == "gnss"]
    stamps = np.array([fix.stamp for fix in fixes])
    places = _places(fixes)
    true = log.antenna[[log.index(stamp) for stamp in stamps], :2]
    return Track(stamps=stamps, said=places, true=true, covariances=np.empty(0))


def by_one_filter(log: SkidSteerLog) -> Track:
    """Wheels, IMU and GNSS in one filter."""
    fusion = Fusion(skid_steer_sensors(), datum=DATUM)
    return followed(log, fusion, fusion.take, log.readings)


def by_filter_with_accelerations(log: SkidSteerLog) -> Track:
    """Wheels, IMU with its accelerations, and GNSS in one filter."""
    fusion = Fusion(*with_accelerations(), datum=DATUM)
    return followed(log, fusion, fusion.take, log.all_readings())


def by_chained_filters(log: SkidSteerLog) -> Track:
    """The reference's way: a local filter of wheels and IMU, and a global one that gets its estimate and GNSS."""
    sensors = skid_steer_sensors()
    local = {name: sensors[name] for name in LOCAL_SENSORS}
    chained = SensorOptions(
        components=components("roll", "pitch", "yaw", "vx", "vy", "vz", "wx", "wy", "wz"),
        std=np.where(YAW, CHAINED_YAW_STD, np.fmax(sensors["wheels"].std, sensors["imu"].std)),
        std_per_speed=sensors["wheels"].std_per_speed,
        std_per_turn=per_component(vx=0.05, vy=0.05, vz=0.05),
    )
    below = Fusion(local, FusionOptions(frame_id="odom"))
    above = Fusion({"local": chained, "gnss": sensors["gnss"]}, datum=DATUM)
    return followed(log, above, Cascade(below, above, chain_every_s=CHAIN_S).take, log.readings)


def by_filter_and_amcl(log: SkidSteerLog) -> Track:
    """Wheels, IMU, GNSS and the pose that AMCL finds on a map, in one filter."""
    both = with_amcl(log)
    return followed(log, both.fusion, both.take, log.readings)


def with_amcl(log: SkidSteerLog) -> FilterWithAmcl:
    """A filter that has not begun, with the map of the log's vineyard and the scans of the log."""
    truth, survey = vineyard_and_map(log.seed)
    return FilterWithAmcl(log, survey, session_scans(log, truth))


def followed(
    log: SkidSteerLog, fusion: Fusion, take: Callable[[Reading], object], readings: Iterable[Reading]
) -> Track:
    """What a filter says at its looks while it, or the cascade it belongs to, takes readings."""
    looks = np.arange(1, round(log.stamps[-1] / LOOK_S) + 1) * LOOK_S
    stamps, said, covariances, k = [], [], [], 0
    for reading in readings:
        while looks[k] < reading.stamp:
            if fusion.started:
                belief = fusion.belief(looks[k])
                stamps.append(looks[k])
                said.append(belief.mean[:2])
                covariances.append(belief.covariance[:2, :2])
            k += 1
        take(reading)
    true = log.poses[[log.index(stamp) for stamp in stamps], :2]
    return Track(stamps=np.array(stamps), said=np.array(said), true=true, covariances=np.array(covariances))


ONE_FILTER, ACCELERATED, WITH_AMCL = "EKF", "EKF with accelerations", "EKF + AMCL"
WAYS = (
    Way(
        name="wheels only",
        colour="#b85450",
        reference="unusable, a completely different path",
        track=by_wheels,
        keeps_up=False,
    ),
    Way(name="GNSS only", colour="#7a7a7a", reference="really accurate, but 1 Hz and no heading", track=by_gnss),
    Way(name=ONE_FILTER, colour="#4878a8", reference="very close to GNSS", track=by_one_filter),
    Way(name=ACCELERATED, colour="#8a5aa8", reference="very close to GNSS", track=by_filter_with_accelerations),
    Way(name="EKF cascade", colour="#e08a3c", reference="pretty precise, 0.2 to 0.3 s late", track=by_chained_filters),
    Way(name=WITH_AMCL, colour="#5a9c5a", reference="jumped between GNSS and AMCL", track=by_filter_and_amcl),
)
