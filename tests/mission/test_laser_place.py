"""AMCL in a mission: it holds the estimate where GNSS is lost, says when the two part, and needs a scanner."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_ride import DESCRIPTION, GRID, SITE, PaperRide

from grape.errors import InvalidInput
from grape.mapping import plants_in_scan
from grape.messages import Array, LaserScan
from grape.mission.laser_place import LaserPlace

MOUNT = np.array([0.45, 0.0, 0.0])
ANGLES = np.radians(np.arange(-120.0, 121.0, 2.0))
SPEED = 0.5
SLIP = 1.05  # so much more than the robot moves its wheels turn
START = np.array([2.0, -1.2, 0.0])


class Ride(PaperRide):
    """A robot that drives along the first row; its wheels slip, and GNSS is there for as long as it is told.

    Args:
        apart: m by which everything stands further to the west than on the map.
    """

    def __init__(self, gnss_s: float, *, placed: bool = True, apart: float = 0.0) -> None:
        super().__init__(MOUNT, ANGLES, gnss_s)
        self.apart = apart
        self.drivers.scans["elsewhere"] = None
        self.events: list[dict[str, Any]] = []
        log: Any = SimpleNamespace(event=lambda kind, **fields: self.events.append({"kind": kind, **fields}))
        self.place = LaserPlace(GRID, self.drivers, DESCRIPTION, np.random.default_rng(4), log) if placed else None
        self.listener = self.place

    @property
    def pose(self) -> Array:
        return START + np.array([SPEED * self.now, 0.0, 0.0])

    @property
    def rolled(self) -> float:
        return SLIP * SPEED * self.now

    def seen_from(self) -> Array:
        return self.pose + np.array([self.apart, 0.0, 0.0])


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
    ride.silent = True
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
