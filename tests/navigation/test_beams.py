from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grape.geometry import pose, rotation_y, rotation_z, transform
from grape.messages import LaserScan
from grape.navigation.beams import ScanOptions, beams_from_cloud, beams_from_scan, scan_points
from grape.navigation.ground import MeanGround

T_BASE_LASER = pose(translation=(0.45, 0.0, 0.20))
T_BASE_VELODYNE = pose(translation=(0.40, -0.20, 0.52))
GROUND = -0.132


def scan(ranges) -> LaserScan:
    """Beams at -90, 0 and +90 degrees."""
    return LaserScan(
        stamp=0.0,
        angle_min=-np.pi / 2,
        angle_increment=np.pi / 2,
        range_min=0.1,
        range_max=30.0,
        ranges=np.array(ranges, dtype=float),
    )


def seen(points_base) -> np.ndarray:
    """Distances (n,) from the sensor to the hits of a cloud given in base_link."""
    T_velodyne_base = np.linalg.inv(T_BASE_VELODYNE)
    beams = beams_from_cloud(transform(T_velodyne_base, np.array(points_base, float)), np.eye(4), T_BASE_VELODYNE)
    return np.hypot(*(beams.ends[beams.hit] - beams.sensor).T)


def ring(distance: float, height: float, n: int = 200) -> np.ndarray:
    """Points (n, 3) in base_link around the sensor, `height` m over the ground."""
    angle = np.linspace(-np.pi, np.pi, n)
    return np.column_stack(
        [0.4 + distance * np.cos(angle), -0.2 + distance * np.sin(angle), np.full(n, height + GROUND)]
    )


def test_what_gives_no_return_is_free_as_far_as_the_scanner_sees():
    short = replace(scan([np.inf] * 3), range_max=2.0)
    beams = beams_from_scan(short, np.eye(4), T_BASE_LASER)
    assert np.hypot(*(beams.ends - beams.sensor).T) == pytest.approx(2.0)


def test_hits_lie_where_the_robot_saw_them():
    T_map_base = pose(rotation_z(np.pi / 2), (10.0, 5.0, 0.0))
    beams = beams_from_scan(scan([2.0, 3.0, 1.0]), T_map_base, T_BASE_LASER)
    assert np.allclose(beams.sensor, [10.0, 5.45])
    assert np.allclose(beams.ends, [[12.0, 5.45], [10.0, 8.45], [9.0, 5.45]])
    assert beams.hit.all()


def test_no_return_clears_and_unknown_says_nothing():
    beams = beams_from_scan(scan([np.inf, np.nan, -np.inf]), np.eye(4), T_BASE_LASER, ScanOptions(clear_range=4.5))
    assert beams.hit.tolist() == [False]
    assert np.allclose(beams.ends, [[0.45, -4.5]])


def test_far_hits_do_not_mark_but_clear_on_the_way():
    options = ScanOptions(mark_range=4.0, clear_range=4.5)
    beams = beams_from_scan(scan([6.0, 6.0, 6.0]), np.eye(4), T_BASE_LASER, options)
    assert not beams.hit.any()
    assert np.allclose(np.hypot(*(beams.ends - beams.sensor).T), 4.5)


def test_a_scanner_pitched_by_a_bump_does_not_take_the_ground_for_an_obstacle():
    T_map_base = pose(rotation_y(0.11))  # nose down, as on a bump: the plane meets level ground 3 m ahead
    beams = beams_from_scan(scan([np.nan, 2.5, np.nan]), T_map_base, T_BASE_LASER)
    assert not beams.hit.any()
    assert beams_from_scan(scan([np.nan, 2.5, np.nan]), np.eye(4), T_BASE_LASER).hit.all()


def test_the_mean_of_a_slope_is_learnt_over_bumps_and_holds_where_one_levels_the_robot():
    """Uphill at 0.1: the ground comes into the plane of the scanner 3.3 m ahead, a third of a metre higher."""
    rng, ground = np.random.default_rng(0), MeanGround()
    for x in np.arange(0.0, 6.0, 0.05):
        bump = 0.06 * np.sin(2.0 * np.pi * x / 0.6) + rng.normal(0.0, 0.01)
        normal = ground.update(pose(rotation_y(-0.1 + bump), (x, 0.0, 0.1 * x)))
    assert np.arctan2(normal[0], normal[2]) == pytest.approx(-0.1, abs=0.025)
    level = pose(None, (6.0, 0.0, 0.6))
    assert beams_from_scan(scan([np.nan, 2.9, np.nan]), level, T_BASE_LASER).hit.all(), "as an obstacle, without it"
    assert not beams_from_scan(scan([np.nan, 2.9, np.nan]), level, T_BASE_LASER, normal=normal).hit.any()
    assert beams_from_scan(scan([np.nan, 0.5, np.nan]), level, T_BASE_LASER, normal=normal).hit.all(), "too near for it"
    steep = [0.0, 0.0, 1.0] + 1.5 * (normal - [0.0, 0.0, 1.0])
    rise = transform(np.linalg.inv(T_BASE_VELODYNE), [[x, 0.0, 0.15 * x + GROUND] for x in np.arange(4.0, 5.0, 0.05)])
    assert beams_from_cloud(rise, level, T_BASE_VELODYNE).hit.any()
    assert not beams_from_cloud(rise, level, T_BASE_VELODYNE, normal=steep).hit.any()


def test_turning_on_the_spot_does_not_wear_the_mean_ground_out():
    ground = MeanGround()
    first = ground.update(pose(rotation_y(0.1)))
    for _ in range(100):
        last = ground.update(pose(rotation_y(-0.1)))
    np.testing.assert_array_equal(first, last)


def test_a_cloud_of_level_ground_seen_from_a_bump_is_no_obstacle_and_a_post_still_is():
    T_base_level = pose(rotation_y(-0.13))
    ground = transform(T_base_level, np.vstack([ring(d, 0.0) for d in (1.5, 2.5, 3.5, 4.5)]))
    post = transform(T_base_level, [[2.4, -0.2, z + GROUND] for z in np.linspace(0.0, 1.5, 20)])
    T_velodyne_base = np.linalg.inv(T_BASE_VELODYNE)

    def hits(points):
        beams = beams_from_cloud(transform(T_velodyne_base, points), np.linalg.inv(T_base_level), T_BASE_VELODYNE)
        return beams.hit.sum()

    assert hits(ground) == 0
    assert hits(np.vstack([ground, post])) > 0


def test_the_robot_does_not_see_itself():
    assert len(scan_points(scan([0.2, 0.12, 0.2]), T_BASE_LASER)) == 0
    assert len(scan_points(scan([0.2, 2.0, 0.2]), T_BASE_LASER)) == 1


def test_flat_ground_is_no_obstacle():
    assert len(seen(np.vstack([ring(d, 0.0) for d in (1.5, 2.5, 3.5, 4.5)]))) == 0


def test_ground_that_bends_up_by_five_percent_is_no_obstacle():
    assert len(seen(np.vstack([ring(d, 0.05 * d) for d in (1.5, 2.5, 3.5, 4.5)]))) == 0


def test_a_pitched_robot_does_not_take_the_ground_for_an_obstacle():
    T = pose(rotation_y(0.05))
    ground = np.vstack([ring(d, 0.0) for d in (1.5, 2.5, 3.5, 4.5)])
    assert len(seen(transform(T, ground))) == 0


def test_low_weeds_are_no_obstacle():
    assert len(seen(ring(2.0, 0.25))) == 0


def test_a_post_is_an_obstacle_at_its_distance():
    post = np.column_stack([np.full(20, 2.4), np.full(20, -0.2), np.linspace(0.0, 1.5, 20) + GROUND])
    assert np.allclose(seen(post), 2.0, atol=0.02)


def test_what_hangs_over_the_robot_is_no_obstacle():
    assert len(seen(ring(2.0, 2.5))) == 0


def test_ground_returns_clear_up_to_where_they_are():
    beams = beams_from_cloud(transform(np.linalg.inv(T_BASE_VELODYNE), ring(2.5, 0.0)), np.eye(4), T_BASE_VELODYNE)
    reach = np.hypot(*(beams.ends - beams.sensor).T)
    assert not beams.hit.any() and np.allclose(reach, 2.5)
