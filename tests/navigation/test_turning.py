"""Where a drifting base may turn on the spot, and that it goes there first."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.navigation.costmap import PolygonLayer, layered_costmap
from grape.navigation.follower import FollowerState, FollowerStep, Phase, PurePursuit
from grape.navigation.grid import Footprint, GridSpec
from grape.navigation.path import Path, straight
from grape.navigation.turning import RoomToTurn, TurnRoomOptions, may_turn, room_to_turn

SPEC = GridSpec(x_min=-5.0, y_min=-5.0, columns=200, rows=200)
BESIDE = np.array([0.0, -0.6, 0.0])  # 0.27 m from its left side to the fence


def fence(x0: float, x1: float, y0: float = 0.0, y1: float = 0.2) -> np.ndarray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def costmap_of(*polygons: np.ndarray):
    return layered_costmap(SPEC, [PolygonLayer(polygons)])


def test_turn_needs_the_disc_around_the_robot_and_its_drift():
    costmap = costmap_of(fence(-4.0, 4.0))
    reach = Footprint().circumscribed + TurnRoomOptions().drift * 0.7
    assert may_turn(costmap, [0.0, -reach - 0.06, 0.0], 0.7)
    assert not may_turn(costmap, [0.0, -reach + 0.06, 0.0], 0.7)
    assert may_turn(costmap, [0.0, -reach + 0.06, 0.0], 0.7, TurnRoomOptions(drift=0.0))


def test_small_correction_beside_a_fence_is_allowed_and_a_large_turn_is_not():
    costmap = costmap_of(fence(-4.0, 4.0))
    assert may_turn(costmap, BESIDE, 0.05) and may_turn(costmap, BESIDE, 0.0)
    assert not may_turn(costmap, BESIDE, 0.7) and not may_turn(costmap, BESIDE, -0.7)


def test_room_is_found_ahead_or_behind_whichever_is_nearer():
    ahead = room_to_turn(costmap_of(fence(-4.0, 1.0)), BESIDE, 1.5)
    behind = room_to_turn(costmap_of(fence(-1.0, 4.0)), BESIDE, 1.5)
    assert ahead is not None and behind is not None
    assert 1.0 < ahead < 2.0 and ahead == pytest.approx(-behind, abs=0.11)
    assert room_to_turn(costmap_of(fence(2.0, 4.0)), BESIDE, 1.5) == 0.0


def test_place_behind_a_fence_across_the_way_does_not_count():
    costmap = costmap_of(fence(-4.0, 1.0), fence(1.2, 1.4, -2.0, 0.0))
    away = room_to_turn(costmap, BESIDE, 1.5)
    assert away is None or away < 0.0


def test_what_stands_on_the_way_to_a_place_sends_the_base_to_another_one():
    fences, box = costmap_of(fence(-3.0, 1.0)), costmap_of(fence(1.2, 1.4, -1.0, -0.4))
    assert room_to_turn(fences, BESIDE, 1.5) > 1.0
    assert room_to_turn(fences, BESIDE, 1.5, way=box) < -2.0, "a box that a turn may be near, but no base may be at"

    class Turner:
        def step(self, state, path, pose, twist, costmap, dt):
            return FollowerStep(v=0.0, w=0.5, state=state, remaining=1.0)

    path = Path(poses=np.column_stack([straight(np.zeros(2), np.array([1.0, 0.0]), 0.1), np.zeros(11)]))
    step = RoomToTurn(Turner(), fences=fences).step(FollowerState(), path, BESIDE, np.zeros(2), box, 0.1)
    assert step.state.phase is Phase.MAKE_ROOM and step.state.straight_to[0] < -2.0


def test_nowhere_within_reach_is_none():
    assert room_to_turn(costmap_of(fence(-4.9, 4.9)), BESIDE, 1.5, TurnRoomOptions(reach=3.0)) is None


def test_pose_that_is_not_finite_is_refused():
    with pytest.raises(InvalidInput):
        may_turn(costmap_of(fence(0.0, 1.0)), [np.nan, 0.0, 0.0], 0.5)


def test_wrapped_planner_drives_straight_out_before_it_turns_back():
    costmap = costmap_of(fence(-4.0, 1.0))
    points = straight(np.array([0.0, -0.6]), np.array([-3.0, -2.5]), 0.05)
    yaw = np.arctan2(-1.9, -3.0)
    path = Path(poses=np.column_stack([points, np.full(len(points), yaw)]))
    planner, state, pose, twist = RoomToTurn(PurePursuit()), FollowerState(), BESIDE.copy(), np.zeros(2)
    turned_at = None
    for _ in range(150):
        step = planner.step(state, path, pose, twist, costmap, 0.1)
        state, twist = step.state, np.array([step.v, step.w])
        yaw = pose[2] + 0.05 * step.w
        pose = pose + 0.1 * np.array([step.v * np.cos(yaw), step.v * np.sin(yaw), step.w])
        if abs(pose[2]) > 0.1:
            turned_at = pose
            break
    assert turned_at is not None and turned_at[0] > 1.0
    assert may_turn(costmap, turned_at, 1.5, TurnRoomOptions(drift=0.2, most_drift=0.2))


def test_wrapped_planner_without_any_room_stands_and_says_blocked():
    class Turner:
        def step(self, state, path, pose, twist, costmap, dt):
            return FollowerStep(v=0.0, w=0.5, state=state, remaining=1.0)

    points = straight(np.zeros(2), np.array([1.0, 0.0]), 0.1)
    path = Path(poses=np.column_stack([points, np.zeros(len(points))]))
    planner, costmap = RoomToTurn(Turner(), TurnRoomOptions(reach=3.0)), costmap_of(fence(-4.9, 4.9))
    step = planner.step(FollowerState(), path, BESIDE, np.zeros(2), costmap, 0.1)
    assert step.blocked and step.w == 0.0 and step.state.phase is Phase.TRACK


def test_turn_that_slides_out_of_its_room_is_broken_off_and_goes_on_where_there_is_room():
    costmap = costmap_of(fence(1.6, 4.0, -4.0, 4.0))
    points = straight(np.zeros(2), np.array([-3.0, 0.0]), 0.05)
    path = Path(poses=np.column_stack([points, np.full(len(points), np.pi)]))

    def turned(planner) -> tuple[bool, bool]:
        """Whether the fence was entered, and whether the base, which slides while it turns, came round."""
        state, pose, twist = FollowerState(), np.zeros(3), np.zeros(2)
        for _ in range(400):
            step = planner.step(state, path, pose, twist, costmap, 0.1)
            state, twist = step.state, np.array([step.v, step.w])
            slide = 0.2 if abs(step.w) > 0.1 and abs(step.v) < 0.1 else 0.0
            ahead = step.v * np.array([np.cos(pose[2]), np.sin(pose[2])]) + [slide, 0.0]
            pose = pose + 0.1 * np.array([*ahead, 0.6 * step.w])
            if costmap.blocked(pose[None], Footprint()).any():
                return True, False
            if pose[0] < -2.0:
                break
        return False, bool(np.cos(pose[2]) < -0.9)

    assert turned(PurePursuit()) == (True, False)
    assert turned(RoomToTurn(PurePursuit())) == (False, True)
