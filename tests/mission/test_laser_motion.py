"""Laser odometry in a mission: wheels that slip do not carry the estimate away, and it needs a scanner."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.errors import InvalidInput, StaleData
from grape.geodesy import geodetic_from_enu
from grape.localization import EstimatorOptions, GnssConfig, PoseEstimator, WheelConfig
from grape.mapping import compose, map_of_site, predicted_ranges
from grape.messages import Array, Imu, JointState, LaserScan, NavSatFix
from grape.mission.catalog import robot_description
from grape.mission.file import load_mission
from grape.mission.laser_motion import LaserMotion

SITE = load_mission("dispenser_deployment", ["world.vines_per_row=40"]).site
GRID = map_of_site(SITE)
DESCRIPTION = robot_description("husky_jaco2")
MOUNT = np.array([*DESCRIPTION.mounts["front_laser"].T_parent_sensor[:2, 3], 0.0])
ANGLES = np.radians(np.arange(-135.0, 135.1, 0.5))
START = np.array([6.0, -1.2, 0.0])


class Ride:
    """A robot in the first row whose wheels say 0.5 m/s; GNSS is there for the first two seconds.

    Args:
        speed: m/s that it really moves with.
    """

    def __init__(self, speed: float, *, laser: bool = True) -> None:
        self.speed, self.now, self.silent = speed, 0.0, False
        base = DESCRIPTION.base
        wheels = WheelConfig(wheel_radius=base.wheel_radius, effective_track=base.effective_track)
        gnss = GnssConfig(antenna=np.zeros(3))
        self.estimator = PoseEstimator(EstimatorOptions(datum=SITE.datum, wheels=wheels, gnss=gnss))
        drivers: Any = SimpleNamespace(scans={"front_laser": self})
        self.motion = LaserMotion(drivers, DESCRIPTION) if laser else None

    @property
    def pose(self) -> Array:
        return START + np.array([self.speed * max(0.0, self.now - 2.0), 0.0, 0.0])

    def latest(self, max_age_s: float | None = None) -> LaserScan:
        """What the laser sees."""
        if self.silent:
            raise StaleData("nothing for a while")
        ranges = predicted_ranges(GRID, compose(self.pose, MOUNT)[None], ANGLES, 20.0)[0]
        return LaserScan(
            stamp=self.now, angle_min=float(ANGLES[0]), angle_increment=float(np.radians(0.5)), range_min=0.0,
            range_max=20.0, ranges=ranges,
        )  # fmt: skip

    def go(self, until: float) -> float:
        """Drive on; by how much the estimate is off in the end, m."""
        base = DESCRIPTION.base
        while self.now < until:
            self.now = round(self.now + 0.05, 3)
            angle = np.full(4, 0.5 * max(0.0, self.now - 2.0) / base.wheel_radius)
            wheels = JointState(
                stamp=self.now, name=base.wheel_joints, position=angle, velocity=np.zeros(4), effort=np.zeros(4)
            )
            imu = Imu(
                stamp=self.now, orientation=np.array([1.0, 0.0, 0.0, 0.0]), angular_velocity=np.zeros(3),
                linear_acceleration=np.array([0.0, 0.0, 9.81]),
            )  # fmt: skip
            self.estimator.advance(self.now, wheels=(wheels,), imu=(imu,), gnss=self.fixes())
            if self.motion is not None:
                self.motion.update(self.now, self.estimator)
        return float(np.hypot(*(self.estimator.odometry(self.now).pose[:2, 3] - self.pose[:2])))

    def fixes(self) -> tuple[NavSatFix, ...]:
        if self.now > 2.0 or self.now % 1.0 > 1e-9:
            return ()
        latitude, longitude, altitude = geodetic_from_enu(SITE.datum, np.array([[*self.pose[:2], 0.13]]))[0]
        covariance = np.eye(3) * 1e-4
        return (
            NavSatFix(stamp=self.now, latitude=latitude, longitude=longitude, altitude=altitude, covariance=covariance),
        )


@pytest.mark.parametrize("speed", [0.0, 0.25, 0.5])
def test_the_estimate_moves_as_the_base_does_and_not_as_its_wheels(speed: float) -> None:
    ride = Ride(speed)
    assert ride.go(12.0) < 0.25
    assert ride.estimator.verdicts["laser", "accepted"] > 30
    assert Ride(speed, laser=False).go(12.0) > (3.5 if speed == 0.0 else -1.0)


def test_without_a_scan_nothing_happens() -> None:
    ride = Ride(0.5)
    ride.motion.update(0.0, PoseEstimator(EstimatorOptions(datum=SITE.datum)))
    ride.silent = True
    assert ride.go(4.0) < 0.1 and ride.estimator.verdicts["laser", "accepted"] == 0


def test_a_robot_without_a_laser_on_its_base_is_refused() -> None:
    drivers: Any = SimpleNamespace(scans={"wrist_lidar": None})
    with pytest.raises(InvalidInput, match="laser scanner on the base"):
        LaserMotion(drivers, DESCRIPTION)
