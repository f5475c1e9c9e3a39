"""Whole drives in a kinematic vineyard: slip, unknown turn ratio, noisy pose."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.navigation.costmap import PolygonLayer, layered_costmap
from grape.navigation.follower import FollowerState, Phase, PurePursuit
from grape.navigation.grid import Footprint, GridSpec
from grape.navigation.path import Path, in_frame_of, straight
from grape.navigation.route import parking_pose, row_zones

EAST, WEST = np.array([1.0, 0.0]), np.array([-1.0, 0.0])
SPEC = GridSpec(x_min=-5.0, y_min=-5.0, columns=300, rows=240)


def straight_path(length: float = 4.0) -> Path:
    points = straight(np.zeros(2), np.array([length, 0.0]), 0.05)
    return Path(poses=np.column_stack([points, np.zeros(len(points))]))


def crossings(robot, zones) -> int:
    costmap = layered_costmap(SPEC, [PolygonLayer(zones)])
    return int(costmap.blocked(np.array(robot.track), Footprint()).sum())


@pytest.mark.parametrize("seed, turn_ratio", [(1, 0.55), (2, 1.15)])
def test_four_plants_in_two_rows_are_reached_within_tolerance(vineyard, robot, drive_to, seed, turn_ratio):
    yard, rng = vineyard(seed), np.random.default_rng(seed)
    machine = robot(np.array([-3.0, -0.8, 0.0]), rng, turn_ratio=turn_ratio)
    goals = [
        parking_pose(yard.plants[0, 1], EAST, "fore"),
        parking_pose(yard.plants[0, 5], EAST, "aft"),
        parking_pose(yard.plants[1, 6], WEST, "fore"),
        parking_pose(yard.plants[1, 2], WEST, "aft"),
    ]
    for goal in goals:
        assert drive_to(yard, machine, goal) is Phase.REACHED
        along, across, yaw = in_frame_of(machine.pose, goal)
        # tolerance of the follower plus three sigma of the pose error
        assert abs(along) < 0.05 and abs(across) < 0.05 and abs(yaw) < np.radians(2.0)
    assert machine.time_s < 90.0
    assert crossings(machine, row_zones(yard.rows)) == 0
    assert max(abs(v) for v, _ in machine.commands) <= 0.8 + 1e-9


def test_obstacle_in_the_lane_is_driven_around(vineyard, robot, drive_to):
    yard, rng = vineyard(3), np.random.default_rng(3)
    yard.circles = np.vstack([yard.circles, [[3.0, -0.9, 0.15]]])
    machine = robot(np.array([-3.0, -0.8, 0.0]), rng)
    goal = parking_pose(yard.plants[0, 5], EAST, "fore")
    assert drive_to(yard, machine, goal) is Phase.REACHED
    track = np.array(machine.track)
    inside = [Footprint().contains(_seen_from(pose, np.array([3.0, -0.9]))) for pose in track]
    assert not np.any(inside)


def test_blocked_way_stops_the_robot_before_the_obstacle():
    costmap = layered_costmap(SPEC, [PolygonLayer([np.array([[2.0, -4.0], [2.2, -4.0], [2.2, 4.0], [2.0, 4.0]])])])
    follower, state, pose, v = PurePursuit(), FollowerState(), np.zeros(3), 0.0
    blocked = False
    for _ in range(200):
        step = follower.step(state, straight_path(), pose, np.array([v, 0.0]), costmap, 0.05)
        state, v, blocked = step.state, step.v, step.blocked
        pose = pose + np.array([v * 0.05, 0.0, 0.0])
    assert blocked and v == 0.0 and state.blocked_s > 1.0
    assert 1.0 < pose[0] < 2.0 - Footprint().front


def test_speed_and_yaw_rate_change_within_their_limits(vineyard, robot, drive_to):
    yard = vineyard(1)
    machine = robot(np.array([-3.0, -1.6, 0.7]), np.random.default_rng(1))
    drive_to(yard, machine, parking_pose(yard.plants[0, 1], EAST, "fore"))
    steps = np.diff(np.array(machine.commands), axis=0) / 0.05
    assert np.abs(steps[:, 0]).max() < 1.6 + 0.8  # the monitor may brake harder than the follower


def test_robot_facing_the_wrong_way_turns_on_the_spot_first():
    costmap = layered_costmap(SPEC, [])
    pose = np.array([0.0, 0.0, np.pi - 0.2])
    step = PurePursuit().step(FollowerState(), straight_path(), pose, np.zeros(2), costmap, 0.05)
    assert step.state.phase is Phase.TURN
    step = PurePursuit().step(step.state, straight_path(), pose, np.zeros(2), costmap, 0.05)
    assert step.v == 0.0 and step.w < 0.0


def test_turn_gain_learns_that_skidding_turns_less():
    costmap, state = layered_costmap(SPEC, []), FollowerState(phase=Phase.TURN, command=(0.0, 0.8))
    pose = np.array([0.0, 0.0, -2.5])
    for _ in range(100):
        step = PurePursuit().step(state, straight_path(), pose, np.array([0.0, 0.6 * state.command[1]]), costmap, 0.05)
        state = step.state
    assert state.turn_gain == pytest.approx(0.6, abs=0.05)


def test_overshoot_is_corrected_by_creeping_back():
    costmap = layered_costmap(SPEC, [])
    state, pose = FollowerState(phase=Phase.SETTLE, travelled=4.0), np.array([4.08, 0.0, 0.0])
    for _ in range(200):
        step = PurePursuit().step(state, straight_path(), pose, np.array(state.command), costmap, 0.05)
        state, pose = step.state, pose + np.array([step.v * 0.05, 0.0, 0.0])
    assert state.phase is Phase.REACHED
    assert abs(pose[0] - 4.0) < 0.02


def test_goal_missed_sideways_is_tried_again_from_further_back_and_taken_or_given_up_in_the_end():
    costs = layered_costmap(SPEC, [])
    follower, path = PurePursuit(), straight_path()
    beside = np.array([3.995, 0.05, 0.0])
    missed = FollowerState(phase=Phase.SETTLE, travelled=4.0)
    step = follower.step(missed, path, beside, np.zeros(2), costs, 0.05)
    assert step.state.phase is Phase.RETREAT and step.state.retreats == 1
    back = np.array([4.0 - 1.0, 0.0, 0.0])
    assert follower.step(step.state, path, back, np.zeros(2), costs, 0.05).state.phase is Phase.TRACK
    second = FollowerState(phase=Phase.RETREAT, travelled=4.0, retreats=2)
    assert follower.step(second, path, back, np.zeros(2), costs, 0.05).state.phase is Phase.RETREAT
    tired = FollowerState(phase=Phase.SETTLE, travelled=4.0, retreats=2)
    assert follower.step(tired, path, beside, np.zeros(2), costs, 0.05).state.phase is Phase.REACHED
    beside[1] = 0.12
    assert follower.step(tired, path, beside, np.zeros(2), costs, 0.05).state.phase is Phase.FAILED


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_last_metre_converges_to_the_goals_line_and_heading_both_ways(direction):
    follower, goal = PurePursuit(), np.array([1.0, 2.0, 0.7])
    along = np.array([np.cos(0.7), np.sin(0.7)])
    pose = np.array([*(goal[:2] - direction * 0.9 * along + 0.12 * np.array([-along[1], along[0]])), 0.7 + 0.15])
    for _ in range(500):
        v, w = follower._converge(pose, goal, 0.3, direction)
        assert v * direction > 0
        pose = pose + 0.01 * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), w])
        if direction * in_frame_of(pose, goal)[0] >= 0.0:
            break
    _, across, yaw = in_frame_of(pose, goal)
    assert abs(across) < 0.035 and abs(yaw) < 0.08


def test_pose_that_is_not_finite_is_refused():
    with pytest.raises(InvalidInput):
        PurePursuit().step(
            FollowerState(), straight_path(), np.full(3, np.nan), np.zeros(2), layered_costmap(SPEC, []), 0.05
        )


def _seen_from(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    return in_frame_of(np.array([*point, 0.0]), pose)[:2]
