"""AMCL beside a filter: it helps without GNSS, and where either of the two is wrong the estimate stays where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.localization import AmclInput, AmclInputOptions, AmclOptions, LikelihoodField
from grape.localization.amcl_input import Reckoning
from grape.mapping import OccupancyGrid, predicted_ranges
from grape.messages import Array, LaserScan, Odometry
from grape.navigation import GridSpec

SPACING = 1.15
ANGLES = np.radians(np.arange(-90.0, 91.0))
SPEED, STEP_S = 0.5, 0.5


def rows() -> OccupancyGrid:
    """Two rows of vines at y = 1 and y = 3.6, 20 m long, on 10 cm cells."""
    spec = GridSpec(x_min=-4.0, y_min=-2.0, columns=280, rows=80, resolution=0.1)
    occupancy = np.zeros((80, 280), np.int8)
    for vine in range(18):
        column = round((SPACING * vine + 4.0) / 0.1)
        for y in (1.0, 3.6):
            occupancy[round((y + 2.0) / 0.1), column] = 100
    return OccupancyGrid(spec=spec, occupancy=occupancy)


GRID = rows()


def odometry(stamp: float, x: float, std: float = 0.05) -> Odometry:
    T = np.eye(4)
    T[0, 3] = x
    return Odometry(
        stamp=stamp,
        frame_id="map",
        child_frame_id="base_link",
        pose=T,
        linear=np.array([SPEED, 0.0, 0.0]),
        angular=np.zeros(3),
        pose_covariance=np.diag([std**2] * 3 + [1e-4] * 3),
        twist_covariance=np.eye(6) * 1e-4,
    )


def scan(stamp: float, x: float) -> LaserScan:
    ranges = predicted_ranges(GRID, np.array([[x, 0.0, 0.0]]), ANGLES, 20.0)[0]
    return LaserScan(
        stamp=stamp, angle_min=float(ANGLES[0]), angle_increment=float(np.radians(1.0)), range_min=0.0,
        range_max=20.0, ranges=ranges,
    )  # fmt: skip


def amcl_input(restart_after_s: float = 5.0) -> AmclInput:
    options = AmclInputOptions(amcl=AmclOptions(least=200, most=400, max_range=20.0), restart_after_s=restart_after_s)
    return AmclInput(LikelihoodField(GRID), np.random.default_rng(3), options)


def drive(both: AmclInput, first: int, last: int, off: float = 0.0, std: float = 0.05) -> Array:
    """Steps of a robot that drives along x; the filter believes to be `off` (m) ahead, to `std` (m).

    Returns:
        (n, 2) of the poses for the filter: s, and by how much x is wrong.
    """
    found = []
    for k in range(first, last):
        stamp, x = k * STEP_S, k * STEP_S * SPEED
        now = odometry(stamp, x + off, std=std)
        both.advance(now)
        measurement = both.take(scan(stamp, x), now)
        if measurement is not None:
            found.append((stamp, measurement.value[0] - x))
    return np.array(found).reshape(-1, 2)


def test_it_gives_the_filter_poses_near_the_truth_with_room_for_lasting_errors() -> None:
    both = amcl_input()
    found = drive(both, 0, 16)
    assert len(found) >= 14 and np.abs(found[4:, 1]).max() < 0.12
    assert both.discord is None


@pytest.mark.parametrize("std", [0.02, 0.15], ids=["with GNSS", "after some time without"])
def test_one_vine_off_along_the_row_it_is_refused_told_and_begun_anew(std: float) -> None:
    both = amcl_input()
    drive(both, 0, 8)
    both.amcl.poses[:, 0] += SPACING
    assert not len(drive(both, 8, 13, std=std))
    discord = both.discord
    assert discord is not None and discord.source == "amcl"
    assert discord.since == 8 * STEP_S and discord.times >= 3 and discord.sigma > 4.0
    back = drive(both, 13, 26, std=std)
    assert both.discord is None
    assert len(back) and np.abs(back[:, 1]).max() < 0.3


def test_when_the_filter_jumps_amcl_does_not_follow_it() -> None:
    both = amcl_input(restart_after_s=1e3)
    drive(both, 0, 8)
    assert not len(drive(both, 8, 14, off=1.5))
    assert both.discord is not None and both.estimate is not None
    assert abs(both.estimate.pose[0] - 13 * STEP_S * SPEED) < 0.3
    assert len(drive(both, 14, 24))  # the filter is back
    assert both.discord is None


def test_it_does_not_begin_before_the_filter_knows_its_place() -> None:
    both = amcl_input()
    for k in range(3):
        lost = odometry(k * STEP_S, 0.0, std=1.0)
        both.advance(lost)
        assert both.take(scan(k * STEP_S, 0.0), lost) is None
    assert both.estimate is None


def test_reckoning_adds_velocities_up_and_ignores_poses() -> None:
    reckoning = Reckoning()
    for k, x in enumerate((0.0, 7.0, -3.0, 1.0, 9.0)):
        reckoning.advance(odometry(0.1 * k, x))
    np.testing.assert_allclose(reckoning.pose(0.5), [0.25, 0.0, 0.0], atol=1e-12)
    turning = Reckoning()
    for k in range(101):
        now = odometry(0.02 * k, 0.0)
        turning.advance(replace(now, angular=np.array([0.0, 0.0, np.pi / 2])))
    radius = SPEED / (np.pi / 2)
    np.testing.assert_allclose(turning.pose(2.0)[:2], [0.0, 2 * radius], atol=1e-3)


def test_wrong_options_are_refused() -> None:
    with pytest.raises(InvalidInput, match="positive"):
        AmclInputOptions(restart_after_s=0.0)
