"""What each sensor says about the filter's state: messages in, measurements out.

Every sensor has a configuration vector (`ekf.components`) and its pose on the robot.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np

from grape.errors import InvalidInput
from grape.geodesy import Datum, enu_from_geodetic
from grape.geometry import quaternion_to_rotation, rotation_from_rpy, rotation_log, rotation_to_rpy
from grape.localization.state import GRAVITY, Measurement, components
from grape.messages import FIX_STATUS, Array, Imu, JointState, NavSatFix


@dataclass(frozen=True, kw_only=True)
class WheelConfig:
    """Wheel odometry of a skid-steer base.

    Wheels whose name contains "left" or "right" count for that side. `effective_track` (m) is what turns a speed
    difference into a yaw rate; for skid steering it is 1.5 to 1.9 times the geometric one and only roughly known,
    hence `turn_slip`. Standard deviations: vx = speed_std + slip |vx| + skid |wz|, vy = side_std + skid |wz|,
    wz = rate_std + turn_slip |wz|. Where the base turns less or more than even `turn_slip` allows, or does not move as
    they say, wheels spin or are dragged: vx, vy and wz get `spin` times the speed at which they must slip. It is large
    because the error is the same in every message for as long as that lasts.
    """

    components: tuple[bool, ...] = components("vx", "vy", "vz", "wz")
    wheel_radius: float = 0.1651
    effective_track: float = 1.0
    speed_std: float = 0.02
    slip: float = 0.05
    skid: float = 0.05
    side_std: float = 0.02
    rate_std: float = 0.05
    turn_slip: float = 0.4
    spin: float = 10.0
    beside: float = 10.0
    still_speed: float = 0.003  # m/s, below it on both sides the base stands
    still_std: float = 0.002  # m/s and rad/s while it stands
    gate: float = inf


@dataclass(frozen=True, kw_only=True)
class ImuConfig:
    """Attitude, rates and accelerations of an IMU mounted with rotation `R_base_imu`.

    The yaw error is slow (drift), not white, so `yaw_std` is far larger than the heading noise of the data sheet.
    With `differential` the attitude enters as its change between two messages.
    """

    components: tuple[bool, ...] = components("roll", "pitch", "yaw", "wx", "wy", "wz")
    R_base_imu: Array = field(default_factory=lambda: np.eye(3))
    tilt_std: float = 0.01
    yaw_std: float = 0.05
    rate_std: float = 0.01
    acceleration_std: float = 0.3
    differential: bool = False
    gate: float = inf


@dataclass(frozen=True, kw_only=True)
class GnssConfig:
    """A GNSS receiver whose antenna is at `antenna` (3,) m in base_link.

    The covariance of the receiver is used, but never below `least_std`, and inflated by `float_factor` (on the
    standard deviation) without an RTK fix: float errors are constant over many fixes, not white.
    """

    components: tuple[bool, ...] = components("x", "y", "z")
    antenna: Array = field(default_factory=lambda: np.array([-0.35, -0.20, 0.75]))
    least_std: float = 0.01
    float_factor: float = 3.0
    gate: float = 5.0


def wheel_speeds(previous: JointState, now: JointState, wheel_radius: float) -> tuple[float, float]:
    """Mean ground speeds (m/s) of the left and right wheels between two encoder readings.

    Raises:
        InvalidInput: the wheel names differ or name no side, or the stamps do not increase.
    """
    if now.name != previous.name:
        raise InvalidInput(f"wheel names changed from {previous.name} to {now.name}")
    dt = now.stamp - previous.stamp
    if not dt > 0:
        raise InvalidInput(f"wheel stamps must increase, got {previous.stamp} then {now.stamp}")
    speed = (now.position - previous.position) * (wheel_radius / dt)
    left = [s for s, name in zip(speed, now.name, strict=True) if "left" in name]
    right = [s for s, name in zip(speed, now.name, strict=True) if "right" in name]
    if not left or not right:
        raise InvalidInput(f"wheel names must contain 'left' or 'right', got {now.name}")
    return float(np.mean(left)), float(np.mean(right))


def from_wheels(
    previous: JointState,
    now: JointState,
    config: WheelConfig,
    yaw_rate: float | None = None,
    speed: tuple[float, float] | None = None,
) -> Measurement:
    """Body velocity (vx, vy = vz = 0) and yaw rate from the wheels; all rates are zero while they stand.

    Args:
        yaw_rate: rad/s of base_link by other sensors, which shows wheels that spin.
        speed: m/s ahead by other sensors, and its standard deviation; it shows wheels that spin straight on.
    """
    left, right = wheel_speeds(previous, now, config.wheel_radius)
    if max(abs(left), abs(right)) < config.still_speed:
        index = np.arange(6, 12)
        return Measurement(
            stamp=now.stamp,
            source="wheels",
            index=index,
            value=np.zeros(6),
            covariance=np.eye(6) * config.still_std**2,
            gate=config.gate,
        )
    vx, wz = 0.5 * (left + right), (right - left) / config.effective_track
    skid, spin = config.skid * abs(wz), 0.0
    if yaw_rate is not None:
        unexplained = max(0.0, abs(wz - yaw_rate) - config.turn_slip * abs(wz) - 2.0 * config.rate_std)
        spin = config.spin * 0.5 * config.effective_track * unexplained
    own = config.speed_std + config.slip * abs(vx) + skid
    if speed is not None:
        allowed, own = own + config.speed_std + 2.0 * speed[1], config.beside * own
        spin += config.spin * max(0.0, abs(vx - speed[0]) - allowed)
    std = np.ones(15)
    std[6] = own + spin
    std[7] = std[8] = config.side_std + skid + spin
    std[11] = config.rate_std + config.turn_slip * abs(wz) + spin
    value = np.zeros(15)
    value[6], value[11] = vx, wz
    return _selected(now.stamp, "wheels", config.components, value, std, gate=config.gate)


def from_imu(imu: Imu, config: ImuConfig, previous: Imu | None = None) -> Measurement:
    """Attitude, rates and gravity-free accelerations of base_link.

    Args:
        imu: the newest message.
        config: its mounting and noise.
        previous: the message before; needed for `differential`, where roll, pitch and yaw are left out and the
            rates come from the change of orientation.

    Raises:
        InvalidInput: `differential` without the message before, or that one is not older.
    """
    R_map_base = quaternion_to_rotation(imu.orientation) @ config.R_base_imu.T
    value, std = np.zeros(15), np.ones(15)
    flags = list(config.components)
    value[3:6] = rotation_to_rpy(R_map_base)
    std[3:5], std[5] = config.tilt_std, config.yaw_std
    value[9:12] = config.R_base_imu @ imu.angular_velocity
    std[9:12] = config.rate_std
    if config.differential:
        if previous is None or not imu.stamp > previous.stamp:
            raise InvalidInput("a differential attitude needs the message before, with an earlier stamp")
        R_map_before = quaternion_to_rotation(previous.orientation) @ config.R_base_imu.T
        value[9:12] = rotation_log(R_map_before.T @ R_map_base) / (imu.stamp - previous.stamp)
        flags[9:12] = [a or b for a, b in zip(flags[3:6], flags[9:12], strict=True)]
        flags[3:6] = [False] * 3
    gravity_base = R_map_base.T @ np.array([0.0, 0.0, GRAVITY])
    value[12:15] = config.R_base_imu @ imu.linear_acceleration - gravity_base
    std[12:15] = config.acceleration_std
    return _selected(imu.stamp, "imu", tuple(flags), value, std, gate=config.gate)


def from_gnss(fix: NavSatFix, datum: Datum, config: GnssConfig) -> Measurement:
    """Position of the antenna in map, with the receiver's covariance.

    Raises:
        InvalidInput: there is no fix or the status is unknown.
    """
    if fix.status not in FIX_STATUS or fix.status == "none":
        raise InvalidInput(f"GNSS status {fix.status!r} gives no position; usable: {', '.join(FIX_STATUS[1:])}")
    value = np.zeros(15)
    value[:3] = enu_from_geodetic(datum, fix.latitude, fix.longitude, fix.altitude)
    chosen = np.flatnonzero(config.components)
    factor = 1.0 if fix.status == "fix" else config.float_factor
    covariance = np.array(fix.covariance[np.ix_(chosen, chosen)]) * factor**2
    diagonal = np.diag_indices(chosen.size)
    covariance[diagonal] = np.maximum(covariance[diagonal], config.least_std**2)
    return Measurement(
        stamp=fix.stamp,
        source="gnss",
        index=chosen,
        value=value[chosen],
        covariance=covariance,
        lever=config.antenna,
        gate=config.gate,
    )


def base_position(fix: NavSatFix, datum: Datum, config: GnssConfig, rpy: Array) -> Array:
    """Position (3,) m of base_link in map when its attitude is `rpy` and the antenna gave `fix`."""
    antenna = enu_from_geodetic(datum, fix.latitude, fix.longitude, fix.altitude)
    return antenna - rotation_from_rpy(*rpy) @ config.antenna


def _selected(
    stamp: float, source: str, flags: tuple[bool, ...], value: Array, std: Array, *, gate: float
) -> Measurement:
    index = np.flatnonzero(flags)
    return Measurement(
        stamp=stamp,
        source=source,
        index=index,
        value=value[index],
        covariance=np.diag(std[index] ** 2),
        gate=gate,
    )
