"""Scans are matched, loops close, maps come out like the building they were taken in."""

from __future__ import annotations

import numpy as np
import pytest
from building import BEAMS, building, drifting, laser_scans, way_round

from grape.errors import InvalidInput
from grape.mapping import (
    GridOptions,
    OccupancyGrid,
    Reference,
    compose,
    grid_from_scans,
    match,
    predicted_ranges,
    run_slam,
    scan_ends,
    trajectory_error,
    transform_points,
)
from grape.mapping.match_kernels import search
from grape.messages import LaserScan
from grape.navigation.grid import GridSpec


@pytest.fixture(scope="module")
def house() -> OccupancyGrid:
    return building(0.05)


def test_beams_end_where_walls_are() -> None:
    spec = GridSpec(x_min=0, y_min=0, columns=100, rows=60, resolution=0.1)
    walls = np.zeros((60, 100), np.int8)
    walls[:, 80] = 100
    ranges = predicted_ranges(
        OccupancyGrid(spec=spec, occupancy=walls), np.array([[2.0, 3.0, 0.0]]), np.array([0.0, 0.3, np.pi]), 20.0
    )
    assert ranges[0, :2] == pytest.approx([6.0, 6.0 / np.cos(0.3)]) and ranges[0, 2] == np.inf


def test_ends_of_a_scan_are_those_of_beams_with_a_return_evenly_chosen() -> None:
    ranges = np.r_[0.05, np.inf, 9.0, np.linspace(1.0, 4.0, 10)]
    scan = LaserScan(
        stamp=0.0, frame_id="laser", angle_min=-1.0, angle_increment=0.2, range_min=0.1, range_max=30.0, ranges=ranges
    )
    angles = -1.0 + 0.2 * np.arange(3, 13)
    expected = ranges[3:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    np.testing.assert_allclose(scan_ends(scan, 9.0), expected, atol=1e-12)
    np.testing.assert_allclose(scan_ends(scan, 9.0, most=4), expected[[0, 3, 6, 9]], atol=1e-12)
    assert scan_ends(scan, 0.5).shape == (0, 2)
    mounted = scan_ends(scan, 9.0, mount=np.array([0.5, 0.0, np.pi / 2]))
    np.testing.assert_allclose(mounted, np.column_stack([0.5 - expected[:, 1], expected[:, 0]]), atol=1e-12)


def test_a_scan_is_found_again_from_a_wrong_guess(house: OccupancyGrid) -> None:
    rng = np.random.default_rng(0)
    true = np.array([3.0, 1.3, 0.1])
    poses = np.array([[2.0, 1.2, 0.0], [2.5, 1.2, 0.2], true])
    *before, last = (scan_ends(scan, 20.0) for scan in laser_scans(house, poses, rng))
    seen = np.vstack([transform_points(pose, points) for pose, points in zip(poses, before, strict=False)])
    found = match(Reference(seen), last, true + np.array([0.25, -0.2, 0.15]), 0.4, 0.25)
    assert np.hypot(*(found.pose - true)[:2]) < 0.03 and abs(found.pose[2] - true[2]) < 0.01
    assert found.inliers > 0.8 and np.linalg.eigvalsh(found.information).min() > 0


def test_along_a_bare_corridor_a_match_knows_little() -> None:
    x = np.arange(-5, 5, 0.05)
    walls = np.vstack([np.column_stack([x, np.full_like(x, y)]) for y in (-1.0, 1.0)])
    found = match(Reference(walls), walls[(np.abs(walls[:, 0]) < 3)], np.array([0.0, 0.05, 0.02]), 0.4, 0.1)
    assert abs(found.pose[1]) < 0.01 and abs(found.pose[2]) < 0.01
    assert found.information[0, 0] < 0.02 * found.information[1, 1]


def test_the_wide_search_with_bounds_finds_what_the_full_one_finds(house: OccupancyGrid) -> None:
    rng = np.random.default_rng(4)
    poses = np.array([[3.0, 1.3, 0.2], [3.5, 1.2, 0.0]])
    first, second = (scan_ends(scan, 20.0)[::6] for scan in laser_scans(house, poses, rng))
    reference = Reference(transform_points(poses[0], first), margin=4.0)
    guess, turns = poses[1] + [1.1, -0.9, 0.05], np.arange(-8, 9) * 0.0125
    spec = reference.spec
    fixed = (spec.origin, spec.resolution, second, guess, 18, turns, np.zeros(2))
    bounded = search(reference.field, reference.bound, 8, *fixed)
    full = search(reference.field, reference.field, 1, *fixed)
    assert bounded[3] == pytest.approx(full[3])


def test_a_map_from_true_poses_is_the_building(house: OccupancyGrid) -> None:
    true = way_round(1.0, 0.5)
    scans = laser_scans(house, true, np.random.default_rng(0), noise=0.005)
    drawn = grid_from_scans(scans, true)
    walls = house.spec.centres(np.argwhere(house.occupied()))
    free = np.argwhere(drawn.free())
    wrong = house.at(drawn.spec.centres(free)) == 100
    assert wrong.mean() < 0.02, "few walls are drawn as free"
    hits = drawn.spec.centres(np.argwhere(drawn.occupied()))
    distance = np.min(np.hypot(*(hits[::7, None] - walls[None]).transpose(2, 0, 1)), axis=1)
    assert np.percentile(distance, 95) < 0.11


def test_a_single_hit_in_the_open_is_no_obstacle_and_a_second_one_makes_it_one() -> None:
    def scan(*ends: float) -> LaserScan:
        return LaserScan(
            stamp=0.0, angle_min=0.0, angle_increment=0.5 * np.pi, range_min=0.0, range_max=20.0, ranges=np.array(ends)
        )

    once, twice = np.array([3.0, 0.0]), np.array([0.0, 2.0])
    poses = np.zeros((2, 3))
    drawn = grid_from_scans([scan(3.0, 2.0), scan(np.inf, 2.0)], poses)
    assert drawn.at(twice) > 65 and 25 < drawn.at(once) < 65
    assert grid_from_scans([scan(3.0, 2.0)] * 2, poses, options=GridOptions(least_hits=3)).occupied().sum() == 0
    assert grid_from_scans([scan(3.0, 2.0)], poses[:1], options=GridOptions(least_hits=1)).at(once) > 65


def test_slam_takes_the_drift_out_and_closes_the_loop(house: OccupancyGrid) -> None:
    rng = np.random.default_rng(1)
    mount = np.array([0.2, 0.0, 0.0])
    true = way_round(1.15, 0.35)
    odometry = drifting(true, rng)
    scans = laser_scans(house, true, rng, mount=mount)
    said = []
    result = run_slam(scans, odometry, mount, on_progress=lambda part, text: said.append((part, text)))
    before, after = trajectory_error(odometry, true), trajectory_error(result.poses, true)
    assert before.position_rmse > 0.8, "the test would not need SLAM"
    assert after.position_rmse < 0.10 and after.position_max < 0.25
    assert result.loops >= 3 and len(result.lost) == 0
    assert [part for part, _ in said] == sorted(part for part, _ in said) and "node" in said[-1][1]


def test_scans_between_nodes_follow_odometry(house: OccupancyGrid) -> None:
    true = np.array([[2.0 + 0.1 * k, 1.2, 0.0] for k in range(8)])
    result = run_slam(laser_scans(house, true, np.random.default_rng(0)), true)
    assert len(result.nodes) < 8 and len(result.poses) == 8
    np.testing.assert_allclose(result.poses, true, atol=0.03)


def test_blind_scans_leave_odometry() -> None:
    nothing = LaserScan(
        stamp=0.0, angle_min=float(BEAMS[0]), angle_increment=0.0175, range_min=0.0, range_max=20.0,
        ranges=np.full(181, np.inf),
    )  # fmt: skip
    odometry = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0.1]])
    result = run_slam([nothing] * 3, odometry)
    np.testing.assert_allclose(result.poses, odometry, atol=1e-6)
    assert result.lost.tolist() == [1, 2]


def test_wrong_input_is_refused(house: OccupancyGrid) -> None:
    scans = laser_scans(house, np.array([[2.0, 1.2, 0.0]]), np.random.default_rng(0))
    for odometry in (np.zeros((2, 3)), np.full((1, 3), np.nan)):
        with pytest.raises(InvalidInput, match="odometry"):
            run_slam(scans, odometry)
        with pytest.raises(InvalidInput, match="poses"):
            grid_from_scans(scans, odometry)
    with pytest.raises(InvalidInput, match="no beam"):
        grid_from_scans(scans, compose(np.zeros((1, 3)), np.zeros(3)), options=GridOptions(max_range=0.01))
