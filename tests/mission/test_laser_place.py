"""AMCL in a mission: it holds the estimate where GNSS is lost, says when the two part, and needs a scanner."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.errors import InvalidInput, StaleData
from grape.geodesy import geodetic_from_enu
from grape.localization import EstimatorOptions, GnssConfig, PoseEstimator, WheelConfig
from grape.mapping import map_of_site, plants_in_scan, predicted_ranges
from grape.messages import Array, Imu, JointState, LaserScan, NavSatFix
from grape.mission.catalog import robot_description
from grape.mission.file import load_mission
from grape.mission.laser_place import LaserPlace

SITE = load_mission("dispenser_deployment", ["world.vines_per_row=40"]).site
GRID = map_of_site(SITE)
DESCRIPTION = robot_description("husky_jaco2")
MOUNT = np.array([0.45, 0.0, 0.0])
ANGLES = np.radians(np.arange(-120.0, 121.0, 2.0))
SPEED = 0.5
SLIP = 1.05  # so much more than the robot moves its wheels turn
START = np.array([2.0, -1.2, 0.0])


class Ride:
    """A robot that drives along the first row; its wheels slip, and GNSS is there for as long as it is told.

    Args:
        apart: m by which everything stands further to the west than on the map.
    """

    def __init__(self, gnss_s: float, *, placed: bool = True, apart: float = 0.0) -> None:
        self.gnss_s, self.apart, self.now = gnss_s, apart, 0.0
        base = DESCRIPTION.base
        self.estimator = PoseEstimator(
            EstimatorOptions(
                datum=SITE.datum,
                wheels=WheelConfig(wheel_radius=base.wheel_radius, effective_track=base.effective_track),
                gnss=GnssConfig(antenna=np.zeros(3)),
            )
        )
        self.events: list[dict[str, Any]] = []
        log: Any = SimpleNamespace(event=lambda kind, **fields: self.events.append({"kind": kind, **fields}))
        drivers: Any = SimpleNamespace(scans={"front_laser": self, "elsewhere": None})
        self.place = LaserPlace(GRID, drivers, DESCRIPTION, np.random.default_rng(4), log) if placed else None

    @property
    def pose(self) -> Array:
        return START + np.array([SPEED * self.now, 0.0, 0.0])

    def latest(self, max_age_s: float | None = None) -> LaserScan:
        """What the laser sees."""
        x, y, yaw = self.pose
        ranges = predicted_ranges(GRID, np.array([[x + self.apart, y, yaw]]) + MOUNT, ANGLES, 20.0)[0]
        return LaserScan(
            stamp=self.now, angle_min=float(ANGLES[0]), angle_increment=float(np.radians(2.0)), range_min=0.0,
            range_max=20.0, ranges=ranges,
        )  # fmt: skip

    def go(self, until: float) -> float:
        """Drive on; by how much the estimate is off in the end, m."""
        radius = DESCRIPTION.base.wheel_radius
        while self.now < until:
            self.now = round(self.now + 0.05, 3)
            angle = np.full(4, SLIP * SPEED * self.now / radius)
            wheels = JointState(
                stamp=self.now, name=DESCRIPTION.base.wheel_joints, position=angle, velocity=np.zeros(4),
                effort=np.zeros(4),
            )  # fmt: skip
            imu = Imu(
                stamp=self.now, orientation=np.array([1.0, 0.0, 0.0, 0.0]), angular_velocity=np.zeros(3),
                linear_acceleration=np.array([0.0, 0.0, 9.81]),
            )  # fmt: skip
            self.estimator.advance(self.now, wheels=(wheels,), imu=(imu,), gnss=self.fixes())
            if self.place is not None:
                self.place.update(self.now, self.estimator)
        return float(np.hypot(*(self.estimator.odometry(self.now).pose[:2, 3] - self.pose[:2])))

    def fixes(self) -> tuple[NavSatFix, ...]:
        if self.now > self.gnss_s or self.now % 1.0 > 1e-9:
            return ()
        latitude, longitude, altitude = geodetic_from_enu(SITE.datum, np.array([[*self.pose[:2], 0.13]]))[0]
        covariance = np.eye(3) * 1e-4
        return (
            NavSatFix(stamp=self.now, latitude=latitude, longitude=longitude, altitude=altitude, covariance=covariance),
        )


def test_where_gnss_is_lost_the_map_holds_the_estimate() -> None:
    alone, placed = Ride(5.0, placed=False), Ride(5.0)
    assert alone.go(45.0) > 0.5, "slipping wheels lead astray"
    assert placed.go(45.0) < 0.15
    assert placed.estimator.verdicts["amcl", "accepted"] > 50
    assert np.hypot(*(placed.place.pose[:2] - placed.pose[:2])) < 0.3 and placed.events == []


def test_where_the_map_is_not_what_stands_there_the_two_part_and_it_is_told() -> None:
    ride = Ride(100.0)
    ride.go(10.0)
    ride.apart = 0.45
    assert ride.go(40.0) < 0.10, "GNSS holds the estimate"
    apart = [event for event in ride.events if event["apart"]]
    assert apart and apart[0]["source"] == "amcl" and apart[0]["since"] > 10.0


def test_without_a_pose_or_a_scan_nothing_happens() -> None:
    ride = Ride(100.0)
    ride.place.update(0.0, ride.estimator)
    assert ride.place.pose is None
    ride.go(3.0)

    def silent(max_age_s: float | None = None) -> LaserScan:
        raise StaleData("nothing for a while")

    ride.latest = silent
    before = ride.place.pose.copy()
    ride.go(6.0)
    np.testing.assert_array_equal(ride.place.pose, before)


def test_a_robot_without_a_laser_on_its_base_is_refused() -> None:
    drivers: Any = SimpleNamespace(scans={"wrist_lidar": None})
    with pytest.raises(InvalidInput, match="laser scanner on the base"):
        LaserPlace(GRID, drivers, DESCRIPTION, np.random.default_rng(0), SimpleNamespace())


def test_a_map_of_a_site_has_a_cell_for_each_plant_and_room_around() -> None:
    assert GRID.occupied().sum() == len({tuple(GRID.spec.cells(plant.position)) for plant in SITE.plants})
    assert (GRID.at(np.array([plant.position for plant in SITE.plants])) == 100).all()
    assert GRID.at(SITE.start[None])[0] == 0


def test_of_a_scan_narrow_things_are_kept_as_far_as_their_middles() -> None:
    ranges = np.full(40, np.inf)
    ranges[3:5] = 2.0  # a trunk of 7 cm
    ranges[8:30] = np.linspace(4.0, 3.5, 22)  # ground, seen slantwise
    ranges[30:32] = 1.0  # a post before it
    ranges[35], ranges[36], ranges[38] = np.nan, 30.0, 0.05
    scan = LaserScan(
        stamp=1.0, angle_min=0.0, angle_increment=0.035, range_min=0.1, range_max=25.0, ranges=ranges,
    )  # fmt: skip
    plants = plants_in_scan(scan)
    assert np.flatnonzero(np.isfinite(plants.ranges)).tolist() == [3, 4, 30, 31]
    assert plants.ranges[[3, 30]] == pytest.approx([2.04, 1.04]) and plants.stamp == 1.0
