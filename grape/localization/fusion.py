"""Any number of sensors into one filter: readings in, estimate out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from math import isfinite

import numpy as np

from grape.errors import InvalidInput
from grape.geodesy import Datum, geodetic_from_enu
from grape.geometry import inverse, pose, transform
from grape.localization.beginning import FusionOptions, begun
from grape.localization.ekf import Ekf
from grape.localization.readings import Reading
from grape.localization.refusals import Discord, Refusals
from grape.localization.sensor_options import SensorOptions
from grape.localization.sensors import Sensor
from grape.localization.state import STATE, Belief, Correction, Measurement, Verdict
from grape.localization.still_bias import Standing, StillBias
from grape.messages import Array, Odometry

INVALID = "invalid"
DISABLED = "disabled"


class Fusion:
    """One filter and its sensors.

    It begins when each absolute component that some sensor gives has been seen once; a filter whose sensors give no
    position or heading begins at zero, which then is where the robot stood. Nothing that a sensor says stops it: what
    cannot be used is counted in `verdicts`.

    Args:
        sensors: options of each sensor by its name.
        datum: WGS84 origin of geodetic readings; without it the first one is the origin.
    """

    def __init__(
        self, sensors: Mapping[str, SensorOptions], options: FusionOptions | None = None, *, datum: Datum | None = None
    ) -> None:
        if not sensors:
            raise InvalidInput("a filter needs at least one sensor")
        self.options = options or FusionOptions()
        self.verdicts: Counter[tuple[str, str]] = Counter()  # (sensor, verdict) -> how often
        self._options = dict(sensors)
        self._given_datum = datum
        self._disabled: set[str] = set()
        self.reset()

    def reset(self) -> None:
        """Forget the estimate and begin anew with the next readings."""
        two_d = self.options.filter.two_d
        self._sensors = {name: Sensor(name, o, self._given_datum, two_d=two_d) for name, o in self._options.items()}
        self._ekf: Ekf | None = None
        self._newest = -np.inf
        self._leaping: Reading | None = None
        self._last: dict[str, float] = {}
        self._first: dict[tuple[str, int], Measurement] = {}
        self._refused_in_time = 0
        self._standing = Standing()
        self._biases = {
            name: StillBias(np.array(o.still_bias), o.still_bias_s)
            for name, o in self._options.items()
            if any(o.still_bias)
        }
        self._refusals = Refusals()
        self._refused_poses: Counter[str] = Counter()
        self._relocations: Counter[str] = Counter()

    @property
    def started(self) -> bool:
        """Whether there is an estimate."""
        return self._ekf is not None

    @property
    def waiting_for(self) -> tuple[str, ...]:
        """Absolute components that no sensor has given yet, though some should; the filter begins when all are in."""
        if self._ekf is not None:
            return ()
        missing = self._absolute()
        for measurement in self._first.values():
            missing[measurement.index[measurement.index < 6]] = False
        return tuple(STATE[i] for i in np.flatnonzero(missing))

    @property
    def datum(self) -> Datum | None:
        """WGS84 origin of the geodetic readings; None before the first when none was given."""
        return self._given_datum

    @property
    def stamp(self) -> float:
        """Time of the newest thing that was fused, s."""
        return self._running().belief.stamp

    @property
    def discords(self) -> tuple[Discord, ...]:
        """Sources of poses that say otherwise than the estimate, again and again, up to their newest word."""
        return self._refusals.discords

    def bias(self, sensor: str) -> Array:
        """(15,) what is taken off the readings of a sensor, learnt while the base stood; zero without `still_bias`."""
        self._known(sensor)
        return self._biases[sensor].bias.copy() if sensor in self._biases else np.zeros(15)

    def knows(self, sensor: str) -> bool:
        """Whether it has a sensor of that name."""
        return sensor in self._sensors

    def enable(self, sensor: str, wanted: bool = True) -> None:
        """Take a sensor's readings, or leave them alone until it is enabled again."""
        self._known(sensor)
        (self._disabled.discard if wanted else self._disabled.add)(sensor)

    def silent(self, stamp: float, longer_than_s: float) -> tuple[str, ...]:
        """Sensors that have said nothing usable for so long, in the order they were given."""
        return tuple(n for n in self._sensors if stamp - self._last.get(n, -np.inf) > longer_than_s)

    def take(self, reading: Reading) -> tuple[Correction, ...]:
        """Fuse a reading; late ones by rewind and replay. What became of it, empty when nothing was fused (yet).

        Raises:
            InvalidInput: the sensor's name is unknown.
        """
        self._known(reading.sensor)
        if reading.sensor in self._disabled or not isfinite(reading.stamp):
            self._count(reading.sensor, DISABLED if reading.sensor in self._disabled else Verdict.NOT_FINITE)
            return ()
        held, self._leaping = self._leaping, None
        if held is None and self.leaps(reading.stamp):
            self._leaping = reading
            return ()
        if held is None:
            return self._process(reading)
        if abs(reading.stamp - held.stamp) < self.options.leap_s:
            self._newest = max(self._newest, held.stamp)
            return (*self._process(held), *self._process(reading))
        self._count(held.sensor, Verdict.TOO_NEW)
        return self._process(reading)

    def correct(self, measurement: Measurement) -> Correction:
        """Fuse what is no reading of a sensor of its own, such as AMCL's pose; it counts under its source.

        Raises:
            InvalidInput: there is no estimate yet.
        """
        self._running()
        return self._correct(measurement)

    def leaps(self, stamp: float) -> bool:
        """Whether a stamp is so far ahead of all that was fused that it needs the next reading to agree."""
        return self.started and stamp > self._newest + self.options.leap_s

    def confirms(self, stamp: float) -> bool:
        """Whether a reading waits that a reading at `stamp` would agree with."""
        return self._leaping is not None and abs(stamp - self._leaping.stamp) < self.options.leap_s

    def belief(self, stamp: float | None = None) -> Belief:
        """Mean and covariance at `stamp` (default: the newest), extrapolated without changing the filter.

        Raises:
            InvalidInput: there is no estimate yet.
        """
        ekf = self._running()
        return ekf.belief if stamp is None else ekf.predicted(stamp)

    def odometry(self, stamp: float | None = None) -> Odometry:
        """Pose of base_link in the filter's frame at `stamp`, twist in base_link, both with covariances."""
        belief = self.belief(stamp)
        mean, covariance = belief.mean, belief.covariance
        return Odometry(
            stamp=belief.stamp if stamp is None else stamp,
            frame_id=self.options.frame_id,
            child_frame_id=self.options.child_frame_id,
            pose=pose(self._running().rotation(belief), mean[:3]),
            linear=mean[6:9],
            angular=mean[9:12],
            pose_covariance=covariance[:6, :6],
            twist_covariance=covariance[6:12, 6:12],
        )

    def geodetic(self, stamp: float | None = None) -> Array:
        """(3,) latitude (deg), longitude (deg) and altitude (m) of base_link in WGS84.

        Raises:
            InvalidInput: there is no estimate or no datum yet.
        """
        if self.datum is None:
            raise InvalidInput("without a datum there is no latitude and longitude; give one or a GNSS sensor")
        T_world_enu = next((s.options.mount.T_world_frame for s in self._sensors.values() if s.geodetic), np.eye(4))
        return geodetic_from_enu(self.datum, transform(inverse(T_world_enu), self.belief(stamp).mean[:3]))

    def widen(self, names: tuple[str, ...], std: float) -> None:
        """Trust the named components less by `std` (m, rad, …) from now on."""
        self._running().widen(np.array([STATE.index(name) for name in names]), std**2)

    def _known(self, sensor: str) -> None:
        if not self.knows(sensor):
            raise InvalidInput(f"unknown sensor {sensor!r}; known: {', '.join(self._sensors)}")

    def _running(self) -> Ekf:
        if self._ekf is None:
            raise InvalidInput(f"there is no estimate yet: waiting for {', '.join(self.waiting_for) or 'a reading'}")
        return self._ekf

    def _count(self, sensor: str, verdict: str) -> None:
        self.verdicts[sensor, str(verdict)] += 1

    def _process(self, reading: Reading) -> tuple[Correction, ...]:
        sensor = self._sensors[reading.sensor]
        try:
            measurements = sensor.measurements(reading)
        except InvalidInput:
            self._count(sensor.name, INVALID)
            return ()
        if sensor.datum is not None and self._given_datum is None:  # the first one is the origin of all
            self._given_datum = sensor.datum
            for other in self._sensors.values():
                other.datum = sensor.datum
        if self._ekf is None:
            self._begin(measurements)
            return ()
        if sensor.options.still_below > 0:
            self._standing.told(reading.stamp, sensor.stands)
        if sensor.name in self._biases:
            standing = self.belief() if self._standing.at(reading.stamp) else None
            measurements = self._biases[sensor.name].taken_off(measurements, standing)
        corrections = []
        for measurement in measurements:
            corrections.append(self._correct(measurement, sensor.options.relocate_after))
            if self._ekf is None:  # began anew: the rest has the stamp that was refused
                break
        return tuple(corrections)

    def _correct(self, measurement: Measurement, relocate_after: int = 0) -> Correction:
        correction, source = self._running().correct(measurement), measurement.source
        verdict = correction.verdict
        self._count(source, verdict)
        if verdict in (Verdict.TOO_OLD, Verdict.TOO_NEW):
            self._refused_in_time += 1
            if self._refused_in_time >= self.options.restart_after:
                self.reset()
            return correction
        if verdict is Verdict.NOT_FINITE:
            return correction
        self._refused_in_time = 0
        self._newest = max(self._newest, measurement.stamp)
        self._last[source] = max(self._last.get(source, -np.inf), measurement.stamp)
        if measurement.index[0] < 6:
            self._refusals.note(source, measurement.stamp, correction.distance, refused=not correction.accepted)
            self._watch_poses(measurement, verdict, relocate_after)
        return correction

    def _watch_poses(self, measurement: Measurement, verdict: Verdict, relocate_after: int) -> None:
        """Give the position up, further each time, when a source keeps seeing the robot elsewhere."""
        source = measurement.source
        if verdict is Verdict.ACCEPTED:
            self._refused_poses[source] = self._relocations[source] = 0
            return
        self._refused_poses[source] += 1
        if not 0 < relocate_after <= self._refused_poses[source]:
            return
        self._refused_poses[source] = 0
        factor = 4.0 ** self._relocations[source]
        self._relocations[source] = min(self._relocations[source] + 1, 10)
        ekf, index = self._running(), measurement.index
        if (index < 3).any():
            ekf.widen(np.arange(3), factor)
        if ((index >= 3) & (index < 6)).any():
            ekf.widen(index[(index >= 3) & (index < 6)], 0.1 * factor)

    def _absolute(self) -> Array:
        """(6,) components of the pose that some sensor gives and `initial` does not."""
        wanted = np.zeros(6, bool)
        for sensor in self._sensors.values():
            if sensor.name not in self._disabled:
                wanted |= sensor.flags[:6]
        for name in self.options.initial:
            if STATE.index(name) < 6:
                wanted[STATE.index(name)] = False
        return wanted

    def _begin(self, measurements: list[Measurement]) -> None:
        for measurement in measurements:
            if measurement.usable:
                self._first[measurement.source, int(measurement.index[0])] = measurement
        if not self._first or self.waiting_for:
            return
        firsts = sorted(self._first.values(), key=lambda m: m.stamp)
        self._ekf = begun(firsts, self._absolute(), self.options)
        for m in firsts:
            self._count(m.source, Verdict.ACCEPTED)
            self._last[m.source] = m.stamp
        self._newest = firsts[-1].stamp
        self._first.clear()
