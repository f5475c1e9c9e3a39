"""Pose of the robot in the map from wheels, IMU and GNSS."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from grape.errors import InvalidInput
from grape.geodesy import Datum
from grape.geometry import pose
from grape.localization.ekf import Ekf, EkfOptions
from grape.localization.measurements import (
    GnssConfig,
    ImuConfig,
    WheelConfig,
    base_position,
    from_gnss,
    from_imu,
    from_wheels,
    wheel_speeds,
)
from grape.localization.state import Correction, Measurement, Verdict
from grape.messages import Array, Imu, JointState, NavSatFix, Odometry

UNKNOWN_VARIANCE = 1e6
_SOURCES = {JointState: "wheels", Imu: "imu", NavSatFix: "gnss"}


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """Sensors, filter and the limits within which the estimate counts as ready.

    Args:
        datum: WGS84 origin of the map frame.
        ready_position_std: m, larger of x and y.
        ready_yaw_std: rad.
        again: share of both below which an estimate that was not ready is so again. At one limit for both, a base that
            a float solution holds right there would start and stop with each fix.
        doubt_after: after so many refused RTK fixes in a row the estimate is not ready: better stand than drive by it.
        relocate_after: after so many the filter gives up its position.
        still_way: m of the wheels since an RTK fix was accepted, up to which the base still stands there. A fix that
            says otherwise is then more likely wrong than the base pushed away.
        still_share: a fix refused there counts for so much of one.
        motion_s: s, for which a motion that was seen speaks against wheels.
        motion_std: m/s, up to which its standard deviation ahead may be for that.
    """

    datum: Datum
    wheels: WheelConfig = field(default_factory=WheelConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    gnss: GnssConfig = field(default_factory=GnssConfig)
    filter: EkfOptions = field(default_factory=EkfOptions)
    ready_position_std: float = 0.10
    ready_yaw_std: float = 0.05
    again: float = 0.8
    doubt_after: int = 2
    relocate_after: int = 8
    still_way: float = 0.05
    still_share: float = 0.125
    motion_s: float = 0.5
    motion_std: float = 0.15


class PoseEstimator:
    """Fuses messages as they come and gives the pose of base_link in map at any time.

    It starts with the first IMU message and the first GNSS position; before that the covariance is enormous and
    `ready` is false.
    """

    def __init__(self, options: EstimatorOptions) -> None:
        self.options = options
        self.verdicts: Counter[tuple[str, str]] = Counter()  # (source, verdict) -> how often
        self._ekf: Ekf | None = None
        self._wheels: JointState | None = None
        self._imu: Imu | None = None
        self._ready = False
        self._refused_fixes = 0.0
        self._seen_motion: Measurement | None = None
        self._way = 0.0  # m that the wheels have turned since an RTK fix was accepted

    @property
    def initialized(self) -> bool:
        """Whether a first pose exists."""
        return self._ekf is not None

    @property
    def ready(self) -> bool:
        """Whether the pose is known well enough to drive by."""
        return self._ready

    def ready_at(self, stamp: float) -> bool:
        """Whether the pose extrapolated to `stamp` is known well enough; false after a long silence."""
        return self._ekf is not None and self._is_believed(self._ekf.predicted(stamp).covariance)

    def advance(
        self,
        stamp: float,
        *,
        wheels: tuple[JointState, ...] = (),
        imu: tuple[Imu, ...] = (),
        gnss: tuple[NavSatFix, ...] = (),
    ) -> Odometry:
        """Fuse new messages in the order of their stamps and give the odometry of base_link in map at `stamp` (s)."""
        messages: list[JointState | Imu | NavSatFix] = [*wheels, *imu, *gnss]
        for message in sorted(messages, key=lambda m: m.stamp):
            self._take(message)
        self._judge()
        return self.odometry(stamp)

    def odometry(self, stamp: float) -> Odometry:
        """The estimate extrapolated to `stamp`, without changing it; twist in base_link."""
        if self._ekf is None:
            return _unknown(stamp)
        belief = self._ekf.predicted(stamp)
        mean, covariance = belief.mean, belief.covariance
        return Odometry(
            stamp=stamp,
            frame_id="map",
            child_frame_id="base_link",
            pose=pose(self._ekf.rotation(belief), mean[:3]),
            linear=mean[6:9],
            angular=mean[9:12],
            pose_covariance=covariance[:6, :6],
            twist_covariance=covariance[6:12, 6:12],
        )

    def correct(self, measurement: Measurement) -> Correction:
        """Fuse what is no message of a sensor, such as AMCL's pose; refused fixes are forgotten when a pose
        is accepted.

        Raises:
            InvalidInput: there is no pose yet.
        """
        if self._ekf is None:
            raise InvalidInput("there is no pose yet: the filter waits for IMU and GNSS")
        correction = self._ekf.correct(measurement)
        self.verdicts[measurement.source, correction.verdict] += 1
        if correction.accepted and measurement.index[0] < 6:
            self._refused_fixes = 0.0
        self._judge()
        return correction

    def take_motion(self, motion: Measurement) -> Correction:
        """Fuse velocities in base_link, vx first, of what sees the world pass; wheels that say otherwise count less.

        Raises:
            InvalidInput: there is no pose yet.
        """
        self._seen_motion = motion
        return self.correct(motion)

    def _take(self, message: JointState | Imu | NavSatFix) -> None:
        source = _SOURCES[type(message)]
        try:
            measurement = self._measurement(message)
        except InvalidInput:
            self.verdicts[source, "invalid"] += 1
            return
        if measurement is None or self._ekf is None:
            return
        verdict = self._ekf.correct(measurement).verdict
        self.verdicts[source, verdict] += 1
        if isinstance(message, NavSatFix):
            self._watch_fixes(message, verdict)

    def _measurement(self, message: JointState | Imu | NavSatFix) -> Measurement | None:
        options = self.options
        if isinstance(message, JointState):
            previous, self._wheels = self._wheels, message
            if previous is None:
                return None
            left, right = wheel_speeds(previous, message, options.wheels.wheel_radius)
            way = 0.5 * (abs(left) + abs(right)) * (message.stamp - previous.stamp)
            self._way += way if isfinite(way) else 0.0
            yaw_rate = None if self._ekf is None else float(self._ekf.belief.mean[11])
            return from_wheels(previous, message, options.wheels, yaw_rate, self._speed_at(message.stamp))
        if isinstance(message, Imu):
            previous_imu = self._imu
            if options.imu.differential and previous_imu is None:
                self._imu = message
                return None
            measurement = from_imu(message, options.imu, previous_imu)
            self._imu = message
            return measurement
        measurement = from_gnss(message, options.datum, options.gnss)
        if self._ekf is None and self._imu is not None and measurement.usable:
            self._initialize(message, measurement, self._imu)
            return None
        return measurement

    def _speed_at(self, stamp: float) -> tuple[float, float] | None:
        """The speed ahead that was seen not long ago, and its standard deviation, m/s."""
        motion = self._seen_motion
        if motion is None or not motion.usable or stamp - motion.stamp > self.options.motion_s:
            return None
        std = float(np.sqrt(motion.covariance[0, 0]))
        return (float(motion.value[0]), std) if std <= self.options.motion_std else None

    def _initialize(self, fix: NavSatFix, measurement: Measurement, imu: Imu) -> None:
        attitude = from_imu(imu, ImuConfig(R_base_imu=self.options.imu.R_base_imu))
        mean, std = np.zeros(15), np.full(15, 0.1)
        mean[3:6] = attitude.value[:3]
        mean[:3] = base_position(fix, self.options.datum, self.options.gnss, mean[3:6])
        std[12:15] = 0.01
        std[3:6] = self.options.imu.tilt_std, self.options.imu.tilt_std, self.options.imu.yaw_std
        variance = std**2
        variance[:3] = 1.0
        variance[measurement.index] = np.diagonal(measurement.covariance) + 1e-4
        self._ekf = Ekf(fix.stamp, mean, np.diag(variance), self.options.filter)

    def _watch_fixes(self, fix: NavSatFix, verdict: Verdict) -> None:
        if verdict is Verdict.ACCEPTED:
            self._refused_fixes = 0.0
            if fix.status == "fix":  # a float solution does not show where wheels spun
                self._way = 0.0
        elif verdict is Verdict.GATED and fix.status == "fix":
            self._refused_fixes += 1.0 if self._way > self.options.still_way else self.options.still_share
        if self._refused_fixes >= self.options.relocate_after and self._ekf is not None:
            self._ekf.widen(np.array([0, 1, 2]), 1.0)
            self._refused_fixes = 0

    def _judge(self) -> None:
        self._ready = self._ekf is not None and self._is_believed(self._ekf.belief.covariance)

    def _is_believed(self, covariance: Array) -> bool:
        if self._refused_fixes >= self.options.doubt_after:
            return False
        position_std = float(np.sqrt(max(covariance[0, 0], covariance[1, 1])))
        yaw_std = float(np.sqrt(covariance[5, 5]))
        limits = np.array([self.options.ready_position_std, self.options.ready_yaw_std])
        return bool((np.array([position_std, yaw_std]) <= (1.0 if self._ready else self.options.again) * limits).all())


def _unknown(stamp: float) -> Odometry:
    return Odometry(
        stamp=stamp,
        frame_id="map",
        child_frame_id="base_link",
        pose=np.eye(4),
        linear=np.zeros(3),
        angular=np.zeros(3),
        pose_covariance=np.eye(6) * UNKNOWN_VARIANCE,
        twist_covariance=np.eye(6) * UNKNOWN_VARIANCE,
    )
