"""A sensor of the filter: readings in, measurements out."""

from __future__ import annotations

from math import inf, isfinite, sqrt

import numpy as np

from grape.errors import InvalidInput
from grape.geodesy import Datum, enu_from_geodetic
from grape.geometry import inverse, pose, rotation_from_rpy, rotation_log, rotation_to_rpy
from grape.localization.readings import ACCELERATION, POSE, TWIST, Reading
from grape.localization.sensor_options import SensorOptions
from grape.localization.state import STATE, Measurement, Mount
from grape.messages import Array, frozen_array

STARTED_OVER_S = 10.0  # a stamp so far behind is no late one, the sensor's time has started over


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
        self._known: dict[bytes, list[tuple[Array, float, Array | None]]] = {}
        self._turns_poses = bool(flags[POSE].any())
        self._set_by_user = np.isfinite(options.std)
        self._variance = options.std**2
        self._per_speed, self._per_turn = np.nan_to_num(options.std_per_speed), np.nan_to_num(options.std_per_turn)
        self._grows = bool(self._per_speed.any() or self._per_turn.any())
        self._floor = options.least_std**2
        self._has_floor = bool(np.isfinite(self._floor).any())
        self.stands = False  # by its last reading
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
        self.stands = self._is_still(values, given)
        if self.stands:
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
        for index, gate, constant in self._chosen(given):
            C = constant
            if C is None or correlated is not None or variance is not self._variance:
                C = self._covariance(index, variance, correlated)
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

    def _covariance(self, index: Array, variance: Array, correlated: Array | None) -> Array:
        own = variance[index]
        if np.isnan(own).any():
            names = ", ".join(STATE[i] for i in index[np.isnan(own)])
            raise InvalidInput(f"{self.name}: neither the reading nor `std` says how good {names} are")
        if correlated is None:
            return np.diag(own)
        C: Array = correlated[np.ix_(index, index)]
        np.fill_diagonal(C, own)
        return C

    def _chosen(self, given: Array) -> list[tuple[Array, float, Array | None]]:
        """Components that are fused together, their gate, and their covariance (m, m) if `std` has them all.

        Most readings give the same ones again and again.
        """
        key = given.tobytes()
        if key not in self._known:
            self._known[key] = []
            for mask, gate in self._groups:
                index = frozen_array(np.flatnonzero(mask & given))
                known = self._set_by_user[index].all()
                if index.size:
                    self._known[key].append(
                        (index, gate, frozen_array(np.diag(self._variance[index])) if known else None)
                    )
        return self._known[key]


def skid_steer_rates(left: float, right: float, effective_track: float) -> tuple[float, float]:
    """Forward speed (m/s) and yaw rate (rad/s) of ground speeds of the left and right wheels (m/s).

    Args:
        effective_track: m; of a skidding base 1.5 to 1.9 times the distance of the wheels.
    """
    return 0.5 * (left + right), (right - left) / effective_track
