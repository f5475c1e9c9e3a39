from __future__ import annotations

import numpy as np
import pytest

from grape.navigation.fence_guard import FenceGuard
from grape.navigation.grid import Footprint
from grape.navigation.monitor import arc_poses

PRINT = Footprint(front=0.5, rear=0.5, half_width=0.35)
WALL = np.array([[1.0, -3.0], [1.02, -3.0], [1.02, 3.0], [1.0, 3.0]])  # 2 cm thin


@pytest.fixture
def guard() -> FenceGuard:
    return FenceGuard([WALL], PRINT)


def test_command_that_stops_before_the_fence_goes_through(guard):
    assert guard.factor(0.4, 0.0, np.zeros(3)) == 1.0
    assert guard.factor(-0.8, 0.0, np.array([0.45, 0.0, 0.0])) == 1.0


def test_command_is_cut_the_nearer_the_fence_is(guard):
    factors = [guard.factor(0.8, 0.0, np.array([x, 0.0, 0.0])) for x in (-0.3, -0.1, 0.2, 0.49)]
    assert factors == sorted(factors, reverse=True) and factors[0] == 1.0 and factors[-1] == 0.0
    assert 0.0 < factors[2] < 1.0


def test_corner_is_not_turned_into_a_fence_beside(guard):
    beside = np.array([0.6, 0.0, np.pi / 2])  # 5 cm between its right side and the fence
    assert guard.factor(0.0, 0.5, beside) < 1.0
    assert guard.factor(0.5, 0.0, beside) == 1.0


def test_who_stands_in_a_fence_may_only_leave_it(guard):
    inside = np.array([0.6, 0.0, 0.0])
    assert guard.factor(0.2, 0.0, inside) == 0.0
    assert guard.factor(0.0, 0.4, inside) == 0.0
    assert guard.factor(-0.2, 0.0, inside) == 1.0
    assert guard.factor(-0.01, 0.0, inside) == 0.0, "would take too long"


@pytest.mark.parametrize("pose", np.where(np.eye(3, dtype=bool), np.nan, 0.0), ids=["x", "y", "yaw"])
def test_pose_that_is_no_number_stops_the_base(guard, pose):
    assert guard.factor(0.2, 0.0, pose) == 0.0
    assert guard.factor(-0.2, 0.1, pose) == 0.0


def test_robot_amid_a_large_polygon_is_inside():
    field = 10.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    assert FenceGuard([field], PRINT).factor(0.5, 0.0, np.zeros(3)) == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_no_driver_whatever_it_wishes_gets_a_corner_over_a_fence(seed):
    """Random commands for 7 s in a yard of 3 x 3 m; the truth is tested corner by corner and edge by edge."""
    rng = np.random.default_rng(seed)
    low, high = -1.5, 1.5
    yard = [
        np.array([[low - 0.1, -3], [low, -3], [low, 3], [low - 0.1, 3]]),
        np.array([[high, -3], [high + 0.1, -3], [high + 0.1, 3], [high, 3]]),
        np.array([[-3, low - 0.1], [3, low - 0.1], [3, low], [-3, low]]),
        np.array([[-3, high], [3, high], [3, high + 0.1], [-3, high + 0.1]]),
    ]
    guard, pose, stopped = FenceGuard(yard, PRINT), np.zeros(3), 0
    for _ in range(15):
        wish = rng.uniform([-0.4, -1.5], [1.0, 1.5])
        for _ in range(25):
            factor = guard.factor(wish[0], wish[1], pose)
            stopped += factor < 1.0
            x, y, yaw = arc_poses(factor * wish[0], factor * wish[1], np.array([0.02]))[0]
            c, s = np.cos(pose[2]), np.sin(pose[2])
            pose = pose + np.array([c * x - s * y, s * x + c * y, yaw])
            assert np.abs(PRINT.corners(pose)).max() < high
    assert stopped > 0, "it came to the fences"
