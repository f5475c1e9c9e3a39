"""A sensor of the filter: its configuration vector, its mount and its noise; readings in, measurements out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite, sqrt

import numpy as np

from grape.errors import InvalidInput
from grape.geodesy import Datum, enu_from_geodetic
from grape.geometry import inverse, pose, rotation_from_rpy, rotation_log, rotation_to_rpy
from grape.localization.readings import ACCELERATION, POSE, TWIST, Reading
from grape.localization.state import STATE, Measurement, Mount
from grape.messages import Array, frozen_array

UNKNOWN = np.nan
STARTED_OVER_S = 10.0  # a stamp so far behind is no late one, the sensor's time has started over
FLOAT_FACTORS = {"single": 3.0, "float": 3.0}


def per_component(**values: float) -> Array:
    """(15,) with the named values, nan elsewhere: `per_component(vx=0.05, wz=0.1)`."""
    unknown = set(values) - set(STATE)
    if unknown:
        raise InvalidInput(f"unknown state components {sorted(unknown)}; allowed: {', '.join(STATE)}")
    return np.array([values.get(name, UNKNOWN) for name in STATE])


@dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """What a sensor contributes, where it sits and how far it is believed.

    Args:
        components: the configuration vector, 15 flags in the order of `STATE`: which components are fused. Positions
            count in the sensor's frame of the world, velocities, rates and accelerations along the sensor's own axes,
            attitudes as roll, pitch and yaw of base_link (the mount is taken off the sensor's orientation).
        mount: where the sensor sits, the frame of its poses, and the gravity that its accelerometer feels.
        std: (15,) standard deviations, nan where the covariance of the reading is used.
        least_std: (15,) a covariance of the reading is never believed below these; nan is none.
        std_per_speed: (15,) what is added to the standard deviation for each m/s of the reading's own speed.
        std_per_turn: (15,) what is added for each rad/s of its own yaw rate: skidding wheels.
        status_factors: what the standard deviations are multiplied with, by GNSS status; 1 for a status not named.
        differential: poses enter as their change from one reading to the next, as velocities along the sensor's axes;
            their noise is `std` of those velocities, or else follows from the covariances of both poses.
        relative: poses are taken relative to the first one, which is where base_link starts.
        yaw_offset: rad added to the yaw of the reading: magnetic declination and mounting of a compass.
        pose_gate: largest Mahalanobis distance at which position and attitude are accepted.
        delay_s: how long before its stamp the sensor really measured.
        still_below: m/s and rad/s; when all velocities and rates of a reading are less, the base stands and all six
            are taken as zero with `still_std`; 0 is never.
        relocate_after: after so many refused poses in a row the filter gives up its position; 0 is never.
    """

    components: tuple[bool, ...]
    mount: Mount = field(default_factory=Mount)
    std: Array = field(default_factory=per_component)
    least_std: Array = field(default_factory=per_component)
    std_per_speed: Array = field(default_factory=per_component)
    std_per_turn: Array = field(default_factory=per_component)
    status_factors: Mapping[str, float] = field(default_factory=lambda: FLOAT_FACTORS)
    differential: bool = False
    relative: bool = False
    yaw_offset: float = 0.0
    pose_gate: float = inf
    twist_gate: float = inf
    acceleration_gate: float = inf
    delay_s: float = 0.0
    still_below: float = 0.0
    still_std: float = 0.002
    relocate_after: int = 0

    def __post_init__(self) -> None:
        if len(self.components) != len(STATE) or not any(self.components):
            raise InvalidInput(f"components must be 15 flags, at least one of them true, got {self.components}")
        for name in ("std", "least_std", "std_per_speed", "std_per_turn"):
            value = frozen_array(getattr(self, name), float)
            if value.shape != (15,) or (value < 0).any() or np.isinf(value).any():
                raise InvalidInput(f"{name} must be 15 numbers from 0 (nan: not set), got {value}")
            object.__setattr__(self, name, value)
        if (self.std == 0).any():
            raise InvalidInput("std must be positive: nothing is measured without error")
        if min(self.pose_gate, self.twist_gate, self.acceleration_gate) <= 0:
            raise InvalidInput("pose_gate, twist_gate and acceleration_gate must be positive")
        if self.differential and self.relative:
            raise InvalidInput("differential and relative exclude each other")
        if self.still_below > 0 and not any(self.components[6:9]):
            raise InvalidInput("still_below needs vx, vy or vz among the components: rates alone tell no standing")
        if not (isfinite(self.delay_s) and self.delay_s >= 0):
            raise InvalidInput(f"delay_s must be finite and not negative, got {self.delay_s}")


class Sensor:
    """Turns the readings of one sensor into measurements; remembers the poses that later ones are relative to.

    Args:
        datum: WGS84 origin of the frame in which geodetic readings are placed; without it the first one is the origin.
        two_d: leave out z, roll and pitch.
    """

    def __init__(self, name: str, options: SensorOptions, datum: Datum | None = None, *, two_d: bool = False) -> None:
        from grape.localization.ekf_observation import base_attitude  # numba takes a second to import

        self.name = name
        self.options = options
        self._base_attitude = base_attitude
        self.datum = datum
        flags = np.array(options.components, bool)
        if options.differential:
            flags[TWIST] |= flags[POSE]
            flags[POSE] = False
        if two_d:
            flags[2:5] = False
        self._flags = flags
        mount = options.mount
        if options.relative:  # the world is base_link at the start; the sensor stood at its mount there
            mount = Mount(
                T_base_sensor=mount.T_base_sensor,
                T_world_frame=mount.T_world_frame @ mount.T_base_sensor,
                gravity=mount.gravity,
            )
        self._mount = mount
        self._R_world_frame = np.ascontiguousarray(mount.T_world_frame[:3, :3])
        self._R_base_sensor = np.ascontiguousarray(mount.T_base_sensor[:3, :3])
        self._groups = self._grouped()
        self._known: dict[bytes, list[tuple[Array, float]]] = {}
        self._turns_poses = bool(flags[POSE].any())
        self._set_by_user = np.isfinite(options.std)
        self._variance = options.std**2
        self._per_speed, self._per_turn = np.nan_to_num(options.std_per_speed), np.nan_to_num(options.std_per_turn)
        self._grows = bool(self._per_speed.any() or self._per_turn.any())
        self._floor = options.least_std**2
        self._has_floor = bool(np.isfinite(self._floor).any())
        self.geodetic = False  # whether it has given latitudes and longitudes
        self._first: Array | None = None
        self._previous: tuple[float, Array, Array] | None = None

    @property
    def flags(self) -> Array:
        """(15,) components that its measurements have, `differential` poses counted as velocities."""
        return self._flags

    def measurements(self, reading: Reading) -> list[Measurement]:
        """What the reading says about the state; empty when it says nothing (yet).

        Raises:
            InvalidInput: no GNSS fix, a noise that neither the options nor the reading know, a differential position
                without orientation, or stamps of a differential sensor that do not increase.
        """
        if reading.status == "none":
            raise InvalidInput(f"{self.name}: GNSS without a fix gives no position")
        values, given = reading.values.copy(), reading.given.copy()
        if reading.geodetic is not None:
            values[:3], self.geodetic = self._placed(reading.geodetic), True
        if self._is_still(values, given):
            return [self._stands(reading.stamp - self.options.delay_s)]
        (variance, correlated), stamp = self._noise(reading, values), reading.stamp - self.options.delay_s
        if self.options.differential and given[POSE].any():
            variance = variance.copy()
            middle = self._differentiate(stamp, values, given, variance)
            if middle is None:
                given[TWIST] &= np.array(self.options.components[TWIST])
            stamp = middle if middle is not None else stamp
        elif self._turns_poses and (self.options.relative or given[3:6].any()):
            self._take_off_mount(values, given)
        return self._selected(stamp, values, given, variance, correlated)

    def _grouped(self) -> list[tuple[Array, float]]:
        o = self.options
        if o.pose_gate == o.twist_gate == o.acceleration_gate == inf:
            return [(self._flags, inf)]
        groups = []
        for part, gate in ((POSE, o.pose_gate), (TWIST, o.twist_gate), (ACCELERATION, o.acceleration_gate)):
            mask = np.zeros(15, bool)
            mask[part] = self._flags[part]
            if mask.any():
                groups.append((mask, gate))
        return groups

    def _placed(self, geodetic: Array) -> Array:
        latitude, longitude, altitude = (float(v) for v in geodetic)
        if not (np.isfinite(geodetic[:2]).all() and abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            return np.full(3, np.nan)
        if self.datum is None:
            self.datum = Datum(
                latitude_deg=latitude, longitude_deg=longitude, altitude_m=altitude if np.isfinite(altitude) else 0.0
            )
        if np.isnan(altitude):  # a receiver without altitude still gives x and y
            east, north, _ = enu_from_geodetic(self.datum, latitude, longitude)
            return np.array([east, north, np.nan])
        return enu_from_geodetic(self.datum, latitude, longitude, altitude)

    def _is_still(self, values: Array, given: Array) -> bool:
        if self.options.still_below <= 0:
            return False
        moving = values[TWIST][given[TWIST]]
        return bool(moving.size and np.abs(moving).max() < self.options.still_below)

    def _stands(self, stamp: float) -> Measurement:
        return Measurement(
            stamp=stamp,
            source=self.name,
            index=np.arange(6, 12),
            value=np.zeros(6),
            covariance=np.eye(6) * self.options.still_std**2,
            gate=self.options.twist_gate,
        )

    def _noise(self, reading: Reading, values: Array) -> tuple[Array, Array | None]:
        """Variances (15,), nan where nothing is known, and the covariances (15, 15) beside them if there are any."""
        variance, correlated = self._variance, None
        if reading.covariance is not None:
            correlated = reading.covariance.copy()
            correlated[self._set_by_user, :] = correlated[:, self._set_by_user] = 0.0
            own = correlated.diagonal()
            variance = np.where(self._set_by_user | ~(own > 0), variance, own)
        if self._grows:
            speed, turn = sqrt(values[6:9] @ values[6:9]), abs(values[11])
            if isfinite(speed) and isfinite(turn):
                variance = (np.sqrt(variance) + self._per_speed * speed + self._per_turn * turn) ** 2
        factor = self.options.status_factors.get(reading.status, 1.0) ** 2
        if factor != 1.0:
            variance, correlated = variance * factor, None if correlated is None else correlated * factor
        if self._has_floor:
            variance = np.where(variance < self._floor, self._floor, variance)
        return variance, correlated

    def _pose(self, values: Array, given: Array) -> Array:
        """(4, 4) of the sensor in its frame of the world, what is not given as 0; nan when a number is none."""
        T = np.where(given[POSE], values[POSE], 0.0)
        if not np.isfinite(T).all():
            return np.full((4, 4), np.nan)
        return pose(rotation_from_rpy(T[3], T[4], T[5] + self.options.yaw_offset), T[:3])

    def _take_off_mount(self, values: Array, given: Array) -> None:
        """The sensor's attitude in its frame of the world becomes that of base_link in the world, in place."""
        rpy, offset = np.where(given[3:6], values[3:6], 0.0), self.options.yaw_offset
        if self.options.relative:
            T = self._pose(values, given)
            if not np.isfinite(T).all():
                values[POSE] = np.nan
                return
            self._first = T if self._first is None else self._first
            T_first_now = inverse(self._first) @ T
            values[:3], rpy, offset = T_first_now[:3, 3], rotation_to_rpy(T_first_now[:3, :3]), 0.0
        finite = bool(np.isfinite(rpy).all())
        values[3:6] = self._base_attitude(rpy, offset, self._R_world_frame, self._R_base_sensor) if finite else np.nan

    def _differentiate(self, stamp: float, values: Array, given: Array, variance: Array) -> float | None:
        """Pose since the reading before as velocities along the sensor's axes, in place; the time in their middle."""
        if np.array(self.options.components[:3]).any() and not given[3:6].any():
            raise InvalidInput(f"{self.name}: a differential position needs the orientation in the same reading")
        T = self._pose(values, given)
        if not np.isfinite(T).all():
            values[TWIST] = np.nan
            return stamp
        previous, self._previous = self._previous, (stamp, T, variance[POSE].copy())
        if previous is None:
            return None
        dt = stamp - previous[0]
        if not dt > 0:
            if dt > -STARTED_OVER_S:
                self._previous = previous
            raise InvalidInput(f"{self.name}: stamps of a differential sensor must increase, got {dt} s")
        T_before_now = inverse(previous[1]) @ T
        change = np.concatenate([T_before_now[:3, 3], rotation_log(T_before_now[:3, :3])]) / dt
        measured = np.array(self.options.components[POSE]) & given[POSE]
        values[TWIST] = np.where(measured, change, values[TWIST])
        given[TWIST] |= measured
        of_poses = (previous[2] + variance[POSE]) / dt**2
        variance[TWIST] = np.where(measured & ~self._set_by_user[TWIST], of_poses, variance[TWIST])
        return stamp - 0.5 * dt

    def _selected(
        self, stamp: float, values: Array, given: Array, variance: Array, correlated: Array | None
    ) -> list[Measurement]:
        found = []
        for index, gate in self._chosen(given):
            own = variance[index]
            if np.isnan(own).any():
                names = ", ".join(STATE[i] for i in index[np.isnan(own)])
                raise InvalidInput(f"{self.name}: neither the reading nor `std` says how good {names} are")
            C = np.zeros((index.size, index.size)) if correlated is None else correlated[np.ix_(index, index)]
            np.fill_diagonal(C, own)
            found.append(
                Measurement(
                    stamp=stamp,
                    source=self.name,
                    index=index,
                    value=values[index],
                    covariance=C,
                    gate=gate,
                    mount=self._mount,
                )
            )
        return found

    def _chosen(self, given: Array) -> list[tuple[Array, float]]:
        """Components that are fused together, and their gate; most readings give the same ones again and again."""
        key = given.tobytes()
        if key not in self._known:
            indices = ((np.flatnonzero(mask & given), gate) for mask, gate in self._groups)
            self._known[key] = [(frozen_array(index), gate) for index, gate in indices if index.size]
        return self._known[key]


def skid_steer_rates(left: float, right: float, effective_track: float) -> tuple[float, float]:
    """Forward speed (m/s) and yaw rate (rad/s) of ground speeds of the left and right wheels (m/s).

    Args:
        effective_track: m; of a skidding base 1.5 to 1.9 times the distance of the wheels.
    """
    return 0.5 * (left + right), (right - left) / effective_track
