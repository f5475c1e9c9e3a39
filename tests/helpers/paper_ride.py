"""A robot that drives along a row on paper: its laser sees a map, wheels and IMU feed a filter, GNSS comes and goes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import SimpleNamespace
from typing import Any

import numpy as np

from grape.errors import StaleData
from grape.geodesy import geodetic_from_enu
from grape.localization import EstimatorOptions, GnssConfig, PoseEstimator, WheelConfig
from grape.mapping import compose, map_of_site, predicted_ranges
from grape.messages import Array, Imu, JointState, LaserScan, NavSatFix
from grape.mission.catalog import robot_description
from grape.mission.file import load_mission

SITE = load_mission("dispenser_deployment", ["world.vines_per_row=40"]).site
GRID = map_of_site(SITE)
DESCRIPTION = robot_description("husky_jaco2")
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


class PaperRide(ABC):
    """Everything but where the robot is and how far its wheels have turned.

    Args:
        mount: (3,) x y yaw of the scanner in base_link.
        angles: (n,) rad of its beams, at equal steps.
        gnss_s: s, until when GNSS is there.
    """

    listener: Any = None  # has `update(now, estimator)`

    def __init__(self, mount: Array, angles: Array, gnss_s: float) -> None:
        self.now, self.silent, self.gnss_s = 0.0, False, gnss_s
        self._mount, self._angles = mount, angles
        base = DESCRIPTION.base
        wheels = WheelConfig(wheel_radius=base.wheel_radius, effective_track=base.effective_track)
        options = EstimatorOptions(datum=SITE.datum, wheels=wheels, gnss=GnssConfig(antenna=np.zeros(3)))
        self.estimator = PoseEstimator(options)
        self.drivers: Any = SimpleNamespace(scans={"front_laser": self})

    @property
    @abstractmethod
    def pose(self) -> Array:
        """(3,) x y yaw in map, now."""

    @property
    @abstractmethod
    def rolled(self) -> float:
        """m that the wheels have turned until now."""

    def seen_from(self) -> Array:
        """(3,) x y yaw in map, where the laser sees the map from."""
        return self.pose

    def latest(self, max_age_s: float | None = None) -> LaserScan:
        """What the laser sees."""
        if self.silent:
            raise StaleData("nothing for a while")
        ranges = predicted_ranges(GRID, compose(self.seen_from(), self._mount)[None], self._angles, 20.0)[0]
        return LaserScan(
            stamp=self.now, angle_min=float(self._angles[0]), angle_increment=float(self._angles[1] - self._angles[0]),
            range_min=0.0, range_max=20.0, ranges=ranges,
        )  # fmt: skip

    def go(self, until: float) -> float:
        """Drive on; by how much the estimate is off in the end, m."""
        base, zeros = DESCRIPTION.base, np.zeros(4)
        while self.now < until:
            self.now = round(self.now + 0.05, 3)
            angle = np.full(4, self.rolled / base.wheel_radius)
            wheels = JointState(stamp=self.now, name=base.wheel_joints, position=angle, velocity=zeros, effort=zeros)
            at_rest = np.array([0.0, 0.0, 9.81])
            imu = Imu(stamp=self.now, orientation=LEVEL, angular_velocity=np.zeros(3), linear_acceleration=at_rest)
            self.estimator.advance(self.now, wheels=(wheels,), imu=(imu,), gnss=self._fixes())
            if self.listener is not None:
                self.listener.update(self.now, self.estimator)
        return float(np.hypot(*(self.estimator.odometry(self.now).pose[:2, 3] - self.pose[:2])))

    def _fixes(self) -> tuple[NavSatFix, ...]:
        if self.now > self.gnss_s or self.now % 1.0 > 1e-9:
            return ()
        latitude, longitude, altitude = geodetic_from_enu(SITE.datum, np.array([[*self.pose[:2], 0.13]]))[0]
        covariance = np.eye(3) * 1e-4
        return (
            NavSatFix(stamp=self.now, latitude=latitude, longitude=longitude, altitude=altitude, covariance=covariance),
        )
