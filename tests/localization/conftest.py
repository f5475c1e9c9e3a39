"""A seeded drive along three rows with slip, and the messages its sensors give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import pytest

from grape.geodesy import Datum, geodetic_from_enu
from grape.geometry import rotation_from_rpy, rotation_to_quaternion
from grape.messages import Array, Imu, JointState, NavSatFix

DATUM = Datum(latitude_deg=43.5, longitude_deg=10.6, altitude_m=120.0)
ANTENNA = np.array([-0.35, -0.20, 0.75])
WHEELS = ("front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel")


@dataclass
class Drive:
    """Truth at 50 Hz (stamps; poses (n, 3) x y yaw) and what the sensors said."""

    stamps: Array
    poses: Array
    wheels: list[JointState] = field(default_factory=list)
    imu: list[Imu] = field(default_factory=list)
    gnss: list[NavSatFix] = field(default_factory=list)


def commands(duration_s: float, dt: float) -> Array:
    """(n, 2) m/s and rad/s: stand, rows of 12 m, U-turns through the headland, a stop every 4 s."""
    v, w = [], []
    while len(v) * dt < duration_s:
        for _ in range(3):
            v += [0.7] * int(5 / dt) + [0.0] * int(4 / dt)
            w += [0.0] * int(9 / dt)
        v += [0.0] * int(3 / dt) + [0.5] * int(5 / dt) + [0.0] * int(3 / dt)
        w += [np.pi / 6] * int(3 / dt) + [0.0] * int(5 / dt) + [np.pi / 6] * int(3 / dt)
    n = int(duration_s / dt)
    profile = np.column_stack([v, w])[:n]
    profile[: int(3 / dt)] = 0.0
    limit = np.array([1.0, 2.0]) * dt
    for k in range(1, n):
        profile[k] = np.clip(profile[k], profile[k - 1] - limit, profile[k - 1] + limit)
    return profile


@lru_cache(maxsize=4)
def simulate(seed: int, duration_s: float = 120.0, *, true_track: float = 1.0, slope: float = 0.05) -> Drive:
    """Skid-steer drive on a plane inclined along x, with correlated wheel slip, IMU drift and RTK fixes."""
    rng = np.random.default_rng(seed)
    dt, radius = 0.02, 0.1651
    motion = commands(duration_s, dt)
    n = len(motion)
    stamps, poses = np.arange(1, n + 1) * dt, np.zeros((n, 3))
    drive = Drive(stamps, poses)
    x, y, yaw, slip = -3.0, -0.8, 0.0, np.zeros(2)
    angle = np.zeros(4)
    drift = 0.01 * np.sin(2 * np.pi * stamps / 90.0 + rng.uniform(0, 6))
    bias = rng.normal(0, 0.0017, 3)
    for k in range(n):
        v, w = motion[k]
        slip = 0.99 * slip + np.sqrt(1 - 0.99**2) * rng.normal(0, 0.04, 2)
        left, right = v - 0.5 * w * true_track, v + 0.5 * w * true_track
        x, y = x + v * np.cos(yaw) * dt, y + v * np.sin(yaw) * dt
        yaw += w * dt
        poses[k] = x, y, yaw
        speed = np.array([left * (1 + slip[0]), right * (1 + slip[1])] * 2)
        angle = angle + speed / radius * dt
        drive.wheels.append(
            JointState(stamp=stamps[k], name=WHEELS, position=angle, velocity=speed / radius, effort=np.zeros(4))
        )
        R = tilted(yaw, slope)
        noisy = rotation_from_rpy(*rng.normal(0, 0.005, 2), rng.normal(0, 0.005) + drift[k]) @ R
        drive.imu.append(
            Imu(
                stamp=stamps[k],
                orientation=rotation_to_quaternion(noisy),
                angular_velocity=R.T @ [0, 0, w] + rng.normal(0, 0.005, 3) + bias,
                linear_acceleration=R.T @ [0, 0, 9.80665] + rng.normal(0, 0.01, 3),
            )
        )
        if k % 50 == 49:
            drive.gnss.append(fix_at(stamps[k], position(poses[k], slope), R, rng.normal(0, 1, 3)))
    return drive


def tilted(yaw: float, slope: float) -> Array:
    """R_map_base of a robot that stands on the inclined plane z = slope x with its heading `yaw`."""
    up = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    forward = np.array([np.cos(yaw), np.sin(yaw), slope * np.cos(yaw)])
    forward /= np.linalg.norm(forward)
    return np.column_stack([forward, np.cross(up, forward), up])


def position(pose: Array, slope: float) -> Array:
    """Position (3,) of base_link on the plane."""
    return np.array([pose[0], pose[1], slope * pose[0] + 0.132])


def fix_at(
    stamp: float, p_map_base: Array, R: Array, noise: Array, status: str = "fix", std: float = 0.015
) -> NavSatFix:
    """An RTK fix of the antenna with `noise` (3,) in standard deviations."""
    sigma = np.array([std, std, 2 * std])
    lat, lon, alt = geodetic_from_enu(DATUM, p_map_base + R @ ANTENNA + sigma * noise)
    return NavSatFix(
        stamp=stamp,
        latitude=float(lat),
        longitude=float(lon),
        altitude=float(alt),
        covariance=np.diag(sigma**2),
        status=status,
    )


@pytest.fixture
def drive() -> Callable[..., Drive]:
    """`simulate(seed, duration_s)`."""
    return simulate


@pytest.fixture
def fix() -> Callable[..., NavSatFix]:
    return fix_at


@pytest.fixture
def datum() -> Datum:
    return DATUM
