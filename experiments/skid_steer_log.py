"""A skid-steer base on vineyard rows with slip: truth, and the readings that its sensors give the filter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from grape.geodesy import Datum, geodetic_from_enu
from grape.geometry import pose, rotation_from_rpy
from grape.localization import EkfOptions, FusionOptions, Mount, Reading, SensorOptions, components, per_component
from grape.localization.state import GRAVITY
from grape.messages import Array, frozen_array

DATUM = Datum(latitude_deg=43.5, longitude_deg=10.6, altitude_m=120.0)
T_BASE_ANTENNA = pose(None, (-0.35, -0.20, 0.75))
T_BASE_IMU = pose(rotation_from_rpy(0.0, -pi / 2, pi), (0.19, 0.0, 0.149))
TRACK_M = 1.18  # effective, as the robot knows it
PERIOD_S = 0.02
SLOPE = 0.05
ROW_SPACING_M = 2.6
START = np.array([-3.0, -0.8, SLOPE * -3.0])  # m, in map
STAGE = ((0.5, 0.0, 6.0), (0.0, 0.0, 4.0))  # m/s, rad/s, s: on to the next plant, and stand beside it
STAGES = 25  # of a row
LOCAL_SENSORS = ("wheels", "imu")
WHEEL_COMPONENTS = frozen_array(np.array(components("vx", "vy", "vz", "wz")))
ACCELERATION_COMPONENTS = frozen_array(np.array(components("ax", "ay", "az")))
IMU_COMPONENTS = frozen_array(np.array(components("roll", "pitch", "yaw", "wx", "wy", "wz")))


@dataclass(frozen=True, kw_only=True)
class SkidSteerNoise:
    """How bad wheels and sensors are; slip and drift are slow, not white.

    Args:
        slip_std: of each side's wheel speed, relative, with the time constant `slip_s`.
        track_std: relative; how far the effective track of a drive is from `TRACK_M`.
        bend_loss: m/s lost sideways for each rad/s: where a skidding base really turns about.
        gyro_bias_std: rad/s, constant over a log.
        heading_drift: rad, amplitude of the slow error of the IMU's heading, with the period `heading_drift_s`.
    """

    slip_std: float = 0.04
    slip_s: float = 2.0
    track_std: float = 0.10
    bend_loss: float = 0.03
    gyro_std: float = 0.005
    gyro_bias_std: float = 0.0017
    tilt_std: float = 0.005
    heading_std: float = 0.005
    heading_drift: float = 0.01
    heading_drift_s: float = 90.0
    acceleration_std: float = 0.02  # m/s^2, of means over a period; and the standard deviation of their bias
    acceleration_bias_std: float = 0.005
    gnss_std: float = 0.015
    gnss_delay_s: float = 0.10


@dataclass(frozen=True, kw_only=True)
class SkidSteerLog:
    """Truth at 50 Hz: stamps (n,) s, poses (n, 3) x y yaw of base_link, antenna (n, 3) m; all readings as they came.

    The accelerations of the IMU, one with each of its readings, stand apart: few filters take them.
    """

    stamps: Array
    poses: Array
    antenna: Array
    readings: tuple[Reading, ...]
    accelerations: tuple[Reading, ...]
    noise: SkidSteerNoise
    seed: int

    def all_readings(self) -> Iterator[Reading]:
        """The readings, each of the IMU's followed by its accelerations."""
        accelerations = iter(self.accelerations)
        for reading in self.readings:
            yield reading
            if reading.sensor == "imu":
                yield next(accelerations)

    def index(self, stamp: float) -> int:
        """Which of the stamps is nearest."""
        return int(np.clip(round(stamp / PERIOD_S) - 1, 0, len(self.stamps) - 1))


def skid_steer_sensors() -> dict[str, SensorOptions]:
    """Wheels, IMU and GNSS of the base for one filter; without "gnss" for a local one."""
    return {
        "wheels": SensorOptions(
            components=components("vx", "vy", "vz", "wz"),
            std=per_component(vx=0.02, vy=0.02, vz=0.02, wz=0.05),
            std_per_speed=per_component(vx=0.05),
            std_per_turn=per_component(vx=0.05, vy=0.05, vz=0.05, wz=0.4),
            still_below=0.003,
        ),
        "imu": SensorOptions(
            components=components("roll", "pitch", "yaw", "wx", "wy", "wz"),
            mount=Mount(T_base_sensor=T_BASE_IMU),
            std=per_component(roll=0.01, pitch=0.01, yaw=0.5, wx=0.01, wy=0.01, wz=0.01),
            still_bias=components("wx", "wy", "wz"),
        ),
        "gnss": SensorOptions(
            components=components("x", "y", "z"),
            mount=Mount(T_base_sensor=T_BASE_ANTENNA),
            least_std=per_component(x=0.01, y=0.01, z=0.01),
            pose_gate=5.0,
            relocate_after=20,
        ),
    }


def with_accelerations() -> tuple[dict[str, SensorOptions], FusionOptions]:
    """The same sensors with the IMU's accelerations, which see slip between stops: wheels and motion are given room.

    Source: docs/filter.md.
    """
    sensors, noise, motion = skid_steer_sensors(), EkfOptions().noise.copy(), np.zeros(15)
    sensors["wheels"] = replace(sensors["wheels"], std_per_speed=per_component(vx=0.4))
    sensors["imu"] = replace(sensors["imu"], std=per_component(roll=0.2, pitch=0.2, yaw=0.5, wx=0.01, wy=0.01, wz=0.01))
    sensors["accelerometer"] = SensorOptions(
        components=components("ax", "ay", "az"),
        mount=Mount(T_base_sensor=T_BASE_IMU),
        std=per_component(ax=0.02, ay=0.02, az=0.02),
        still_bias=components("ax", "ay", "az"),
        delay_s=PERIOD_S,  # means over the last period
    )
    noise[3:5], noise[6:9], noise[12:15] = 1e-7, 1e-5, 50.0
    motion[5:] = EkfOptions().motion_noise[5:]
    turn = EkfOptions().turn_noise.copy()
    turn[3:5] = 0.0
    return sensors, FusionOptions(filter=EkfOptions(noise=noise, motion_noise=motion, turn_noise=turn))


def commands(duration_s: float) -> Array:
    """(n, 2) m/s and rad/s at 50 Hz: three rows with a stop beside each plant, changed at the headland; then stand."""
    row = STAGE * STAGES
    across = (0.5, 0.0, ROW_SPACING_M / 0.5)
    left, right = (0.0, pi / 6, 3.0), (0.0, -pi / 6, 3.0)
    legs = ((0.0, 0.0, 3.0), *row, left, across, left, *row, right, across, right, *row, (0.0, 0.0, duration_s))
    counts = [round(seconds / PERIOD_S) for _, _, seconds in legs]
    profile = np.repeat([leg[:2] for leg in legs], counts, axis=0)[: round(duration_s / PERIOD_S)]
    limit = np.array([1.0, 2.0]) * PERIOD_S
    for k in range(1, len(profile)):
        profile[k] = np.clip(profile[k], profile[k - 1] - limit, profile[k - 1] + limit)
    return profile


def simulate_skid_steer(seed: int, duration_s: float, noise: SkidSteerNoise | None = None) -> SkidSteerLog:
    """Drive the rows on a plane of 5 % slope with slipping wheels; GNSS comes once a second, late by its delay."""
    noise, rng = noise or SkidSteerNoise(), np.random.default_rng(seed)
    v, w = commands(duration_s).T
    stamps = PERIOD_S * np.arange(1, len(v) + 1)
    yaw, sideways = np.cumsum(w) * PERIOD_S, -noise.bend_loss * w
    R = on_slope(yaw)
    places = START + np.cumsum(v[:, None] * R[:, :, 0] + sideways[:, None] * R[:, :, 1], axis=0) * PERIOD_S
    antenna = places + R @ T_BASE_ANTENNA[:3, 3]
    wheels = _wheel_rates(v, w, noise, rng)
    about_up = w * np.hypot(SLOPE, 1.0) / (1.0 + (SLOPE * np.cos(yaw)) ** 2)  # a heading turns, the base about its z
    imu = _imu_values(stamps, R, about_up, noise, rng)
    arrivals: list[tuple[float, Reading]] = []
    for k, stamp in enumerate(stamps.tolist()):
        arrivals.append((stamp, Reading(stamp=stamp, sensor="wheels", values=wheels[k], given=WHEEL_COMPONENTS)))
        arrivals.append((stamp, Reading(stamp=stamp, sensor="imu", values=imu[k], given=IMU_COMPONENTS)))
        if k % 50 == 49:
            arrivals.append((stamp + noise.gnss_delay_s, _gnss_reading(stamp, antenna[k], rng, noise.gnss_std)))
    arrivals.sort(key=lambda item: item[0])
    forces = _forces(v[:, None] * R[:, :, 0] + sideways[:, None] * R[:, :, 1], about_up, R, noise, seed)
    return SkidSteerLog(
        stamps=stamps,
        poses=np.column_stack([places[:, :2], yaw]),
        antenna=antenna,
        readings=tuple(reading for _, reading in arrivals),
        accelerations=tuple(
            Reading(stamp=stamp, sensor="accelerometer", values=forces[k], given=ACCELERATION_COMPONENTS)
            for k, stamp in enumerate(stamps.tolist())
        ),
        noise=noise,
        seed=seed,
    )


def on_slope(yaw: Array) -> Array:
    """R_map_base (n, 3, 3) of a robot on the plane z = `SLOPE` x that heads towards yaw (n,)."""
    up = np.broadcast_to(np.array([-SLOPE, 0.0, 1.0]) / np.hypot(SLOPE, 1.0), (len(yaw), 3))
    forward = np.column_stack([np.cos(yaw), np.sin(yaw), SLOPE * np.cos(yaw)])
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    return np.stack([forward, np.cross(up, forward), up], axis=-1)


def _wheel_rates(v: Array, w: Array, noise: SkidSteerNoise, rng: np.random.Generator) -> Array:
    """(n, 15): vx and wz as the encoders have them; both sides slip on their own."""
    from scipy.signal import lfilter

    n, keep = len(v), float(np.exp(-PERIOD_S / noise.slip_s))
    kicks = rng.normal(0, noise.slip_std * np.sqrt(1 - keep**2), (n, 2))
    kicks[0] = rng.normal(0, noise.slip_std, 2)
    slip = lfilter([1.0], [1.0, -keep], kicks, axis=0)
    half = 0.5 * TRACK_M * (1.0 + rng.normal(0, noise.track_std)) * w
    left, right = (v - half) * (1 + slip[:, 0]), (v + half) * (1 + slip[:, 1])
    values = np.zeros((n, 15))
    values[:, 6], values[:, 11] = 0.5 * (left + right), (right - left) / TRACK_M
    return values


def _imu_values(stamps: Array, R: Array, w: Array, noise: SkidSteerNoise, rng: np.random.Generator) -> Array:
    """(n, 15): attitude in map and rates along the axes of the IMU; w (n,) rad/s about the base's z."""
    n, R_base_imu = len(stamps), T_BASE_IMU[:3, :3]
    drift = noise.heading_drift * np.sin(2 * pi * stamps / noise.heading_drift_s + rng.uniform(0, 2 * pi))
    errors = np.column_stack([rng.normal(0, noise.tilt_std, (n, 2)), rng.normal(0, noise.heading_std, n) + drift])
    M = np.array([rotation_from_rpy(*error) for error in errors]) @ R @ R_base_imu
    values = np.zeros((n, 15))
    values[:, 3] = np.arctan2(M[:, 2, 1], M[:, 2, 2])
    values[:, 4] = np.arcsin(np.clip(-M[:, 2, 0], -1.0, 1.0))
    values[:, 5] = np.arctan2(M[:, 1, 0], M[:, 0, 0])
    values[:, 9:12] = w[:, None] * R_base_imu[2] + rng.normal(0, noise.gyro_std, (n, 3))
    values[:, 9:12] += rng.normal(0, noise.gyro_bias_std, 3)
    return values


def _forces(velocities: Array, about_up: Array, R: Array, noise: SkidSteerNoise, seed: int) -> Array:
    """(n, 15): specific force along the axes of the IMU, its mean since the reading before.

    Args:
        velocities: (n, 3) m/s of base_link in map.
        about_up: (n,) rad/s about the base's z.
        R: (n, 3, 3) R_map_base.
    """
    rng, n = np.random.default_rng([seed, 9]), len(R)
    moving = velocities + np.cross(about_up[:, None] * R[:, :, 2], R @ T_BASE_IMU[:3, 3])
    forces = np.diff(moving, axis=0, prepend=np.zeros((1, 3))) / PERIOD_S + [0.0, 0.0, GRAVITY]
    values = np.zeros((n, 15))
    values[:, 12:] = np.einsum("nji,nj->ni", R @ T_BASE_IMU[:3, :3], forces)
    values[:, 12:] += rng.normal(0, noise.acceleration_std, (n, 3)) + rng.normal(0, noise.acceleration_bias_std, 3)
    return values


def _gnss_reading(stamp: float, antenna: Array, rng: np.random.Generator, std: float) -> Reading:
    """What the antenna's receiver says."""
    sigma = np.array([std, std, 2 * std])
    covariance = np.zeros((15, 15))
    covariance[:3, :3] = np.diag(sigma**2)
    return Reading(
        stamp=stamp,
        sensor="gnss",
        values=np.zeros(15),
        given=np.arange(15) < 3,
        covariance=covariance,
        geodetic=geodetic_from_enu(DATUM, antenna + rng.normal(0, sigma)),
    )
