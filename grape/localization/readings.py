"""What a sensor said, as numbers in its own frames: the one input of `Fusion`, by hand, of messages or of a log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import quaternion_to_rotation, rotation_to_rpy
from grape.localization.state import STATE
from grape.messages import FIX_STATUS, Array, Imu, NavSatFix, Odometry, PoseStamped, Twist, frozen_array

POSE, TWIST, ACCELERATION = slice(0, 6), slice(6, 12), slice(12, 15)


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What one sensor said at one time.

    Args:
        stamp: s, when it was measured.
        sensor: name under which the filter knows the sensor.
        values: (15,) in the order of `STATE`. Position and attitude are the sensor's pose in its frame of the world
            (odom, map, …); velocities, rates and accelerations are along the sensor's axes.
        given: (15,) which of the values there are; the others are not looked at.
        covariance: (15, 15), or None where it is not known. A component whose variance is not positive is unknown.
        geodetic: (3,) WGS84 latitude and longitude (deg), altitude (m over the ellipsoid), in place of x, y, z.
        status: of a GNSS reading, one of `FIX_STATUS`.
    """

    stamp: float
    sensor: str
    values: Array
    given: Array
    covariance: Array | None = None
    geodetic: Array | None = None
    status: str = "fix"

    def __post_init__(self) -> None:
        n = len(STATE)
        for name, dtype, shape in (
            ("values", float, (n,)),
            ("given", bool, (n,)),
            ("covariance", float, (n, n)),
            ("geodetic", float, (3,)),
        ):
            value = getattr(self, name)
            if value is None:
                continue
            value = frozen_array(value, dtype)
            if value.shape != shape:
                raise InvalidInput(f"{self.sensor}: {name} must have the shape {shape}, got {value.shape}")
            object.__setattr__(self, name, value)
        if self.status not in FIX_STATUS:
            raise InvalidInput(f"{self.sensor}: status {self.status!r} is unknown; allowed: {', '.join(FIX_STATUS)}")


def reading_of_components(stamp: float, sensor: str, **values: float) -> Reading:
    """A reading of named components, as `reading_of_components(1.0, "wheels", vx=0.5, wz=0.1)`.

    Raises:
        InvalidInput: a name is not in `STATE`.
    """
    unknown = set(values) - set(STATE)
    if unknown:
        raise InvalidInput(f"unknown state components {sorted(unknown)}; allowed: {', '.join(STATE)}")
    return Reading(
        stamp=stamp,
        sensor=sensor,
        values=np.array([values.get(name, 0.0) for name in STATE]),
        given=np.array([name in values for name in STATE]),
    )


def reading_of_message(sensor: str, message: Imu | NavSatFix | Odometry | PoseStamped | Twist) -> Reading:
    """A message as a reading of the sensor of that name; covariances of zero are unknown.

    Raises:
        InvalidInput: the message is of another type, or its orientation is no rotation.
    """
    values, given, covariance = np.zeros(15), np.zeros(15, bool), None
    geodetic, status = None, "fix"
    if isinstance(message, Imu):
        values[3:6] = rotation_to_rpy(quaternion_to_rotation(message.orientation))
        values[9:12], values[12:15] = message.angular_velocity, message.linear_acceleration
        given[3:6] = given[9:15] = True
    elif isinstance(message, NavSatFix):
        geodetic, status = np.array([message.latitude, message.longitude, message.altitude]), message.status
        given[:3], covariance = True, np.zeros((15, 15))
        covariance[:3, :3] = message.covariance
    elif isinstance(message, Odometry | PoseStamped):
        values[:3], values[3:6] = message.pose[:3, 3], rotation_to_rpy(message.pose[:3, :3])
        given[POSE] = True
        if isinstance(message, Odometry):
            values[6:9], values[9:12] = message.linear, message.angular
            given[TWIST], covariance = True, np.zeros((15, 15))
            covariance[POSE, POSE], covariance[TWIST, TWIST] = message.pose_covariance, message.twist_covariance
    elif isinstance(message, Twist):
        values[6:9], values[9:12] = message.linear, message.angular
        given[TWIST] = True
    else:
        raise InvalidInput(
            f"{sensor}: {type(message).__name__} is no message of a pose, twist, IMU, odometry or GNSS sensor"
        )
    return Reading(
        stamp=message.stamp,
        sensor=sensor,
        values=values,
        given=given,
        covariance=covariance,
        geodetic=geodetic,
        status=status,
    )
