from __future__ import annotations

import numpy as np
import pytest

from grape.geometry import pose as make_pose
from grape.geometry import rotation_z
from grape.navigation.beams import beams_from_scan
from grape.navigation.costmap import Beams
from grape.navigation.newcomers import NewcomerOptions, NewcomerWatch, near_path, newcomers

T_BASE_LASER = make_pose(translation=(0.45, 0.0, 0.20))
POSTS = [[3.0, y, 0.1] for y in (-1.0, 0.0, 1.0)]
OPTIONS = NewcomerOptions()


@pytest.fixture
def look(scan):
    """Beams in map of what stands around, as circles x y radius, seen from a pose."""

    def beams(circles: list[list[float]], pose=(0.0, 0.0, 0.0), seed: int = 0) -> Beams:
        T = make_pose(rotation_z(pose[2]), (pose[0], pose[1], 0.132))
        found = scan(np.array([*circles, [90.0, 90.0, 0.1]]), np.array(pose), np.random.default_rng(seed), 0.01)
        return beams_from_scan(found, T, T_BASE_LASER)

    return beams


def test_who_stepped_in_is_new_and_what_stands_is_not(look):
    found = newcomers(look([*POSTS, [2.0, 0.5, 0.2]]), look(POSTS), OPTIONS)
    assert len(found) > OPTIONS.least_points
    assert np.hypot(*(found - [2.0, 0.5]).T).max() < 0.25


def test_what_comes_into_view_by_driving_past_is_not_new(look):
    hidden = [*POSTS, [4.0, 0.0, 0.1]]  # behind the middle post at first
    before, now = look(hidden), look(hidden, pose=(0.8, 0.6, -0.2), seed=1)
    assert len(newcomers(now, before, OPTIONS)) == 0


def test_who_leaves_is_not_new(look):
    assert len(newcomers(look(POSTS), look([*POSTS, [2.0, 0.5, 0.2]]), OPTIONS)) == 0


def test_where_nothing_was_known_nothing_is_new(look):
    before = look(POSTS)
    half = Beams(
        sensor=before.sensor, ends=before.ends[: len(before.ends) // 2], hit=before.hit[: len(before.hit) // 2]
    )
    nothing = Beams(sensor=np.zeros(2), ends=np.empty((0, 2)), hit=np.zeros(0, bool))
    left = [[2.0, 1.0, 0.2]]
    assert len(newcomers(look(left), before, OPTIONS)) > 0
    assert len(newcomers(look(left), half, OPTIONS)) == 0
    assert len(newcomers(look(left), nothing, OPTIONS)) == 0


def test_the_watch_notices_a_slow_walker_and_forgets_one_who_stands(look):
    watch, seen = NewcomerWatch(), []
    for k in range(60):
        walked = min(0.1 * k, 3.0)
        seen.append(len(watch.update(0.1 * k, look([*POSTS, [2.2, -1.5 + 0.5 * walked, 0.15]], seed=k))))
    assert seen[:10] == [0] * 10, "nothing is known before a second has passed"
    assert min(seen[12:30]) >= OPTIONS.least_points
    assert max(seen[45:]) == 0


def test_points_near_the_path_are_told_from_others():
    path = np.column_stack([np.arange(0.0, 2.0, 0.05), np.zeros(40), np.zeros(40)])
    points = np.array([[1.0, 0.5], [1.0, 1.1], [3.5, 0.0], [-0.5, 0.0]])
    assert near_path(points, path, 1.0).tolist() == [True, False, False, True]
    assert near_path(points[:0], path, 1.0).shape == (0,)
    assert not near_path(points, path[:0], 1.0).any()
