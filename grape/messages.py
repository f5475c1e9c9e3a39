"""Stamped values that travel between drivers, actions and algorithms.

Names and fields follow the ROS messages for the same thing (sensor_msgs, geometry_msgs, nav_msgs); units are SI,
angles radians, frames REP-103/105, ranges REP-117. All are frozen; arrays are copied at construction and read-only.
Poses are 4 x 4 homogeneous matrices `T_A_B`: the pose of frame B in frame A.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grape.errors import InvalidInput

Array = NDArray[Any]


def frozen_array(value: Any, dtype: Any = None) -> Array:
    """A read-only copy of `value`; a read-only array that owns its data is handed on as it is."""
    if (
        isinstance(value, np.ndarray)
        and not value.flags.writeable
        and value.flags.owndata
        and (dtype is None or value.dtype == np.dtype(dtype))
    ):
        return value
    array = np.array(value, dtype=dtype)
    array.flags.writeable = False
    return array


@dataclass(frozen=True, kw_only=True)
class Message:
    """Base of every message: `stamp` in seconds of the clock at which it was measured, and the frame it is given in."""

    stamp: float
    frame_id: str = ""

    def __post_init__(self) -> None:
        if not np.isfinite(self.stamp):
            raise InvalidInput(f"{type(self).__name__}.stamp must be finite, got {self.stamp}")
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, field.name, frozen_array(value))


@dataclass(frozen=True, kw_only=True)
class Imu(Message):
    """sensor_msgs/Imu. `orientation` is a quaternion wxyz of the sensor frame in ENU (yaw 0 = east)."""

    orientation: Array  # (4,) wxyz
    angular_velocity: Array  # (3,) rad/s, sensor frame
    linear_acceleration: Array  # (3,) m/s^2, sensor frame, gravity included (+9.81 upwards at rest)


@dataclass(frozen=True, kw_only=True)
class NavSatFix(Message):
    """sensor_msgs/NavSatFix in WGS84. `covariance` is the ENU position covariance in m^2; status: see `FIX_STATUS`."""

    latitude: float  # deg
    longitude: float  # deg
    altitude: float  # m over the ellipsoid
    covariance: Array  # (3, 3) m^2, ENU
    status: str = "fix"  # one of FIX_STATUS


FIX_STATUS = ("none", "single", "float", "fix")


@dataclass(frozen=True, kw_only=True)
class JointState(Message):
    """sensor_msgs/JointState. Absolute angles: continuous joints are never wrapped, cables wind."""

    name: tuple[str, ...]
    position: Array  # (n,) rad (wheels: rad turned)
    velocity: Array  # (n,) rad/s
    effort: Array  # (n,) N m that the motors apply, against gravity too; zeros where they are not measured


@dataclass(frozen=True, kw_only=True)
class Twist(Message):
    """geometry_msgs/TwistStamped in `frame_id` (base_link for base commands)."""

    linear: Array  # (3,) m/s
    angular: Array  # (3,) rad/s


@dataclass(frozen=True, kw_only=True)
class Odometry(Message):
    """nav_msgs/Odometry: pose of `child_frame_id` in `frame_id`, twist in the child frame.

    Covariances are 6 x 6, ordered x y z roll pitch yaw; a zero matrix means unknown.
    """

    child_frame_id: str
    pose: Array  # (4, 4) T_frame_child
    linear: Array  # (3,) m/s
    angular: Array  # (3,) rad/s
    pose_covariance: Array  # (6, 6)
    twist_covariance: Array  # (6, 6)


@dataclass(frozen=True, kw_only=True)
class PoseStamped(Message):
    """geometry_msgs/PoseStamped with the pose as `T_frame_thing`."""

    pose: Array  # (4, 4)


@dataclass(frozen=True, kw_only=True)
class LaserScan(Message):
    """sensor_msgs/LaserScan in the x-y plane of the sensor frame, counter-clockwise.

    REP-117: +inf is no return, -inf too near.
    """

    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    ranges: Array  # (n,) m
    scan_time: float = 0.0  # s between scans


@dataclass(frozen=True, kw_only=True)
class PointCloud(Message):
    """sensor_msgs/PointCloud2 as points in `frame_id`; rows that carry no return are left out."""

    points: Array  # (n, 3) m


@dataclass(frozen=True, kw_only=True)
class CameraInfo(Message):
    """sensor_msgs/CameraInfo of an undistorted (rectified) camera; optical frame z forward, x right, y down."""

    width: int
    height: int
    K: Array  # (3, 3) px


@dataclass(frozen=True, kw_only=True)
class RgbdImage(Message):
    """A colour image and the depth image registered to it (REP-118), taken at the same instant.

    `frame_id` is an optical frame. Depth 0 means no measurement.
    """

    bgr: Array  # (h, w, 3) uint8
    depth: Array  # (h, w) float32 m along z
    info: CameraInfo


@dataclass(frozen=True, kw_only=True)
class GripperState(Message):
    """Angles of the proximal finger joints: 0 is open, larger is closed (Jaco2: fingers 1 thumb, 2, 3)."""

    position: Array  # (fingers,) rad
    velocity: Array  # (fingers,) rad/s


@dataclass(frozen=True, kw_only=True)
class Refilled(Message):
    """What a person says after refilling the feeder: the how manieth refill since the start, and how many went in."""

    number: int  # 1, 2, …
    added: int
