from __future__ import annotations

import numpy as np
import pytest

from grape.navigation.grid import Footprint
from grape.navigation.monitor import MonitorOptions, arc_poses, speed_factor, time_to_contact

OPTIONS = MonitorOptions(footprint=Footprint(front=0.5, rear=0.5, half_width=0.335))


def cluster(x: float, y: float) -> np.ndarray:
    """Five points (5, 2) within a centimetre."""
    return np.array([x, y]) + 0.01 * np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0.5]])


def test_free_way_keeps_the_speed():
    assert speed_factor(0.8, 0.0, cluster(5.0, 0.0), OPTIONS) == 1.0


def test_obstacle_right_ahead_stops():
    assert speed_factor(0.8, 0.0, cluster(0.9, 0.0), OPTIONS) == 0.0


def test_obstacle_farther_ahead_slows_down():
    assert 0.0 < speed_factor(0.8, 0.0, cluster(1.7, 0.0), OPTIONS) < 1.0


def test_vines_beside_the_robot_do_not_stop_it():
    beside = np.vstack([cluster(x, 0.40) for x in np.arange(-1.0, 3.0, 0.2)])
    assert speed_factor(0.8, 0.0, beside, OPTIONS) == 1.0


def test_obstacle_behind_stops_only_when_reversing():
    assert speed_factor(0.3, 0.0, cluster(-0.7, 0.0), OPTIONS) == 1.0
    assert speed_factor(-0.3, 0.0, cluster(-0.7, 0.0), OPTIONS) == 0.0


def test_turning_into_an_obstacle_beside_stops():
    assert speed_factor(0.0, 0.6, cluster(0.40, 0.40), OPTIONS) == 0.0


def test_two_stray_points_are_noise():
    assert speed_factor(0.8, 0.0, cluster(0.9, 0.0)[:2], OPTIONS) == 1.0


def test_standing_has_no_contact():
    assert time_to_contact(0.0, 0.0, cluster(0.6, 0.0), OPTIONS) == np.inf


def test_arc_closes_after_a_full_turn():
    assert arc_poses(0.5, 1.0, np.array([2 * np.pi]))[0, :2] == pytest.approx([0.0, 0.0], abs=1e-12)
