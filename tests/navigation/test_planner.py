from __future__ import annotations

import numpy as np
import pytest

from grape.errors import ActionFailed, InvalidInput, Reason
from grape.navigation.costmap import PolygonLayer, layered_costmap
from grape.navigation.grid import Costmap, Footprint, GridSpec
from grape.navigation.path import Path, in_frame_of, rounded
from grape.navigation.planner import path_blocked, plan_path, plan_route


def box(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def world(*boxes: np.ndarray) -> Costmap:
    return layered_costmap(GridSpec(x_min=-5.0, y_min=-5.0, columns=300, rows=200), [PolygonLayer(boxes)])


def test_free_line_ahead_is_driven_straight():
    path = plan_path(world(), np.array([0.0, 0.05, 0.02]), np.array([3.0, 0.0, 0.0]))
    assert not path.reverse
    assert path.length == pytest.approx(3.0, abs=0.01)
    assert np.allclose(path.poses[:, 1], 0.0)


def test_goal_a_little_behind_on_the_line_is_reached_backwards():
    path = plan_path(world(), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0]))
    assert path.reverse
    assert np.allclose(path.poses[:, 2], 0.0)


def test_path_ends_straight_along_the_heading_of_the_goal():
    goal = np.array([3.0, 2.0, np.pi / 2])
    path = plan_path(world(), np.array([0.0, 0.0, 0.0]), goal)
    last = path.poses[path.distance > path.length - 0.7]
    assert np.allclose(last[:, 0], 3.0, atol=1e-6) and np.allclose(last[:, 2], np.pi / 2)
    assert np.allclose(path.goal, goal)


def test_wall_is_driven_around_with_the_whole_footprint():
    wall = world(box(2.0, -2.0, 2.3, 1.5))
    path = plan_path(wall, np.array([0.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0]))
    assert not wall.blocked(path.poses, Footprint()).any()
    assert path.length < 8.5


def test_closed_wall_gives_no_path():
    with pytest.raises(ActionFailed) as failure:
        plan_path(world(box(2.0, -9.0, 2.3, 9.0)), np.array([0.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0]))
    assert failure.value.reason is Reason.NO_PATH


def test_gap_narrower_than_the_robot_gives_no_path():
    narrow = world(box(2.0, -9.0, 2.3, -0.25), box(2.0, 0.25, 2.3, 9.0))
    with pytest.raises(ActionFailed):
        plan_path(narrow, np.array([0.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0]))


def test_occupied_goal_gives_no_path():
    with pytest.raises(ActionFailed, match="occupied"):
        plan_path(world(box(2.9, -0.1, 3.1, 0.1)), np.array([0.0, 0.0, 0.0]), np.array([3.0, 0.0, 0.0]))


def test_start_inside_the_inscribed_zone_can_leave_it():
    near = world(box(-1.0, 0.6, 1.0, 0.9))
    path = plan_path(near, np.array([0.0, 0.3, 0.0]), np.array([4.0, -1.0, 0.0]))
    assert path.length > 3.0


def test_goal_outside_the_grid_gives_no_path():
    with pytest.raises(ActionFailed, match="leaves"):
        plan_path(world(), np.array([0.0, 0.0, 0.0]), np.array([60.0, 3.0, 0.0]))


def test_goal_straight_ahead_outside_the_grid_gives_no_path():
    with pytest.raises(ActionFailed, match="leaves"):
        plan_path(world(), np.array([0.0, 0.0, 0.0]), np.array([1000.0, 0.0, 0.0]))


@pytest.mark.parametrize("yaw", [1.57, -2.0])
def test_a_robot_that_stands_where_the_approach_begins_only_turns(yaw):
    path = plan_path(world(), np.array([0.0, 0.0, yaw]), np.array([1.5, 0.0, 0.0]))
    assert path.length == pytest.approx(1.5) and np.allclose(path.poses[:, 1:], 0.0)


def test_pose_that_is_not_finite_is_refused():
    with pytest.raises(InvalidInput):
        plan_path(world(), np.array([0.0, np.nan, 0.0]), np.array([1.0, 0.0, 0.0]))


def test_route_passes_its_waypoints_with_rounded_corners():
    stops = np.array([[4.0, 0.0, 0.0], [4.0, 3.0, np.pi], [0.0, 3.0, np.pi]])
    path = plan_route(world(), np.array([0.0, 0.0, 0.0]), stops)
    assert np.hypot(*(path.poses[:, :2] - [4.0, 0.0]).T).min() < 0.4
    assert np.abs(np.diff(np.unwrap(path.poses[:, 2]))).max() < 0.2


def test_blocked_waypoint_is_left_out():
    path = plan_route(
        world(box(1.8, -0.2, 2.2, 0.2)), np.array([0.0, 0.0, 0.0]), np.array([[2.0, 0.0, 0.0], [4.5, 0.0, 0.0]])
    )
    assert path.goal[0] == 4.5


def test_obstacle_on_the_path_is_noticed_only_within_the_window():
    path = plan_path(world(), np.array([0.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0]))
    blocked = world(box(3.9, -0.2, 4.1, 0.2))
    assert path_blocked(blocked, path, 2.0, 5.0, Footprint())
    assert not path_blocked(blocked, path, 0.0, 2.0, Footprint())


def test_rounded_corner_keeps_its_radius():
    points = rounded(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]), 0.7, 0.05)
    centre = np.array([2.3, 0.7])
    arc = points[(points[:, 0] > 2.31) & (points[:, 1] < 0.69)]
    assert len(arc) > 5 and np.allclose(np.hypot(*(arc - centre).T), 0.7, atol=0.002)


def test_projection_moves_forward_only():
    path = Path(poses=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    assert path.project(np.array([0.4, 0.3]), 0.0, 1.0) == pytest.approx(0.4)
    assert path.project(np.array([0.4, 0.3]), 0.9, 1.0) == pytest.approx(0.9)


def test_path_goes_on_straight_beyond_its_goal():
    path = Path(poses=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    assert np.allclose(path.at(1.5), [1.5, 0.0, 0.0])


@pytest.mark.parametrize("poses", [[[0, 0, 0]], [[0, 0, 0], [0, 0, 0]], [[0, 0, 0], [np.nan, 0, 0]]])
def test_broken_path_is_refused(poses):
    with pytest.raises(InvalidInput):
        Path(poses=np.array(poses, dtype=float))


def test_pose_in_the_frame_of_another():
    assert np.allclose(in_frame_of(np.array([1.0, 2.0, np.pi]), np.array([1.0, 1.0, np.pi / 2])), [1.0, 0.0, np.pi / 2])
