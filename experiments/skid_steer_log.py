"""A skid-steer base on vineyard rows with slip: truth, and the readings that its sensors give the filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.geodesy import Datum, geodetic_from_enu
from grape.geometry import pose, rotation_from_rpy, rotation_to_rpy
from grape.localization import Mount, Reading, SensorOptions, components, per_component
from grape.messages import Array

DATUM = Datum(latitude_deg=43.5, longitude_deg=10.6, altitude_m=120.0)
T_BASE_ANTENNA = pose(None, (-0.35, -0.20, 0.75))
T_BASE_IMU = pose(rotation_from_rpy(0.0, -np.pi / 2, np.pi), (0.19, 0.0, 0.149))
PERIOD_S = 0.02


@dataclass(frozen=True, kw_only=True)
class SkidSteerNoise:
    """How bad the sensors are; slip and drift are slow, not white.

    Args:
        slip_std: of each side's wheel speed, relative, with the time constant `slip_s`.
        bend_loss: m/s lost sideways for each rad/s: where a skidding base really turns about.
        gyro_bias_std: rad/s, constant over a log.
        heading_drift: rad, amplitude of the slow error of the IMU's heading.
    """

    slip_std: float = 0.04
    slip_s: float = 2.0
    bend_loss: float = 0.03
    true_track: float = 1.18
    gyro_std: float = 0.005
    gyro_bias_std: float = 0.0017
    tilt_std: float = 0.005
    heading_std: float = 0.005
    heading_drift: float = 0.01
    gnss_std: float = 0.015
    gnss_delay_s: float = 0.10


@dataclass(frozen=True, kw_only=True)
class SkidSteerLog:
    """Truth at 50 Hz: stamps (n,) s, poses (n, 3) x y yaw; readings in the order in which they come."""

    stamps: Array
    poses: Array
    readings: tuple[Reading, ...]

    def pose_at(self, stamp: float) -> Array:
        """x, y (m), yaw (rad) at the nearest stamp."""
        return self.poses[int(np.clip(round(stamp / PERIOD_S) - 1, 0, len(self.poses) - 1))]


def skid_steer_sensors(track: float = 1.18) -> dict[str, SensorOptions]:
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
            std=per_component(roll=0.01, pitch=0.01, yaw=0.05, wx=0.01, wy=0.01, wz=0.01),
        ),
        "gnss": SensorOptions(
            components=components("x", "y", "z"),
            mount=Mount(T_base_sensor=T_BASE_ANTENNA),
            least_std=per_component(x=0.01, y=0.01, z=0.01),
            pose_gate=5.0,
            relocate_after=20,
        ),
    }


def commands(duration_s: float) -> Array:
    """(n, 2) m/s and rad/s at 50 Hz: rows with a stop beside a plant every 5 s, turns through the headland."""
    v, w = np.zeros(0), np.zeros(0)
    while len(v) * PERIOD_S < duration_s:
        for speed, rate, seconds in (*(((0.7, 0.0, 5.0), (0.0, 0.0, 4.0)) * 3), *_TURN):
            n = int(seconds / PERIOD_S)
            v, w = np.append(v, np.full(n, speed)), np.append(w, np.full(n, rate))
    profile = np.column_stack([v, w])[: int(duration_s / PERIOD_S)]
    profile[: int(3 / PERIOD_S)] = 0.0
    limit = np.array([1.0, 2.0]) * PERIOD_S
    for k in range(1, len(profile)):
        profile[k] = np.clip(profile[k], profile[k - 1] - limit, profile[k - 1] + limit)
    return profile


_TURN = ((0.0, np.pi / 6, 3.0), (0.5, 0.0, 5.0), (0.0, np.pi / 6, 3.0))


def simulate_skid_steer(seed: int, duration_s: float, noise: SkidSteerNoise | None = None) -> SkidSteerLog:
    """Drive the rows on a plane of 5 % slope with slipping wheels; GNSS comes once a second, late by its delay."""
    noise, rng = noise or SkidSteerNoise(), np.random.default_rng(seed)
    motion = commands(duration_s)
    n = len(motion)
    stamps = PERIOD_S * np.arange(1, n + 1)
    slip, keep = np.zeros((n, 2)), float(np.exp(-PERIOD_S / noise.slip_s))
    kicks = rng.normal(0, noise.slip_std * np.sqrt(1 - keep**2), (n, 2))
    slip[0] = rng.normal(0, noise.slip_std, 2)
    for k in range(1, n):
        slip[k] = keep * slip[k - 1] + kicks[k]
    yaw = np.cumsum(motion[:, 1]) * PERIOD_S
    sideways = -noise.bend_loss * motion[:, 1]
    x = -3.0 + np.cumsum(motion[:, 0] * np.cos(yaw) - sideways * np.sin(yaw)) * PERIOD_S
    y = -0.8 + np.cumsum(motion[:, 0] * np.sin(yaw) + sideways * np.cos(yaw)) * PERIOD_S
    poses = np.column_stack([x, y, yaw])
    half = 0.5 * noise.true_track * motion[:, 1]
    left, right = (motion[:, 0] - half) * (1 + slip[:, 0]), (motion[:, 0] + half) * (1 + slip[:, 1])
    drift = noise.heading_drift * np.sin(2 * np.pi * stamps / 90.0 + rng.uniform(0, 2 * np.pi))
    bias = rng.normal(0, noise.gyro_bias_std, 3)
    arrivals: list[tuple[float, Reading]] = []
    for k in range(n):
        R = on_slope(yaw[k])
        arrivals.append((stamps[k], _wheels(stamps[k], left[k], right[k], noise.true_track)))
        arrivals.append((stamps[k], _imu(stamps[k], R, motion[k, 1], drift[k], bias, noise, rng)))
        if k % 50 == 49:
            position = np.array([x[k], y[k], 0.05 * x[k]])
            arrivals.append((stamps[k] + noise.gnss_delay_s, gnss_reading(stamps[k], position, R, rng, noise.gnss_std)))
    arrivals.sort(key=lambda item: item[0])
    return SkidSteerLog(stamps=stamps, poses=poses, readings=tuple(reading for _, reading in arrivals))


def on_slope(yaw: float, slope: float = 0.05) -> Array:
    """R_map_base of a robot on the plane z = slope x."""
    up = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    forward = np.array([np.cos(yaw), np.sin(yaw), slope * np.cos(yaw)])
    forward /= np.linalg.norm(forward)
    return np.column_stack([forward, np.cross(up, forward), up])


def gnss_reading(stamp: float, p_map_base: Array, R: Array, rng: np.random.Generator, std: float) -> Reading:
    """What the antenna's receiver says."""
    sigma = np.array([std, std, 2 * std])
    covariance = np.zeros((15, 15))
    covariance[:3, :3] = np.diag(sigma**2)
    antenna = p_map_base + R @ T_BASE_ANTENNA[:3, 3] + rng.normal(0, sigma)
    given = np.arange(15) < 3
    place = geodetic_from_enu(DATUM, antenna)
    return Reading(stamp=stamp, sensor="gnss", values=np.zeros(15), given=given, covariance=covariance, geodetic=place)


def _wheels(stamp: float, left: float, right: float, track: float) -> Reading:
    values = np.zeros(15)
    values[6], values[11] = 0.5 * (left + right), (right - left) / track
    given = np.zeros(15, bool)
    given[[6, 7, 8, 11]] = True
    return Reading(stamp=stamp, sensor="wheels", values=values, given=given)


def _imu(
    stamp: float, R: Array, rate: float, drift: float, bias: Array, noise: SkidSteerNoise, rng: np.random.Generator
) -> Reading:
    R_base_imu = T_BASE_IMU[:3, :3]
    tilt, heading = rng.normal(0, noise.tilt_std, 2), rng.normal(0, noise.heading_std) + drift
    values = np.zeros(15)
    values[3:6] = rotation_to_rpy(rotation_from_rpy(*tilt, heading) @ R @ R_base_imu)
    values[9:12] = R_base_imu.T @ (R.T @ [0.0, 0.0, rate]) + rng.normal(0, noise.gyro_std, 3) + bias
    given = np.zeros(15, bool)
    given[3:6] = given[9:12] = True
    return Reading(stamp=stamp, sensor="imu", values=values, given=given)
