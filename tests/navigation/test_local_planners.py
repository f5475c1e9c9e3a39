"""DWA, TEB and MPPI on small costmaps with an ideal base."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.navigation.costmap import PolygonLayer, layered_costmap
from grape.navigation.dwa import CLASSIC, Dwa, DwaOptions
from grape.navigation.follower import FollowerState, Phase
from grape.navigation.grid import Costmap, Footprint, GridSpec
from grape.navigation.mppi import Mppi, MppiOptions
from grape.navigation.path import Path, in_frame_of, straight
from grape.navigation.teb import Teb, TebOptions
from grape.plugins import LOCAL_PLANNERS, find, load

SPEC = GridSpec(x_min=-2.0, y_min=-3.0, columns=160, rows=120)
DT = 0.1
PLANNERS = {"dwa": Dwa, "teb": Teb, "mppi": lambda: Mppi(options=MppiOptions(samples=500))}
planners = pytest.mark.parametrize("name", PLANNERS)


def box(x: float, y: float, half: float = 0.15) -> np.ndarray:
    return np.array([[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]])


def lane() -> list[np.ndarray]:
    return [np.array([[-2, y], [6, y], [6, y + 0.2], [-2, y + 0.2]], dtype=float) for y in (-1.3, 1.1)]


def along_x(start: float = 0.0, end: float = 4.0, reverse: bool = False) -> Path:
    points = straight(np.array([start, 0.0]), np.array([end, 0.0]), 0.05)
    return Path(poses=np.column_stack([points, np.zeros(len(points))]), reverse=reverse)


def drive(planner, path: Path, pose, costmap: Costmap, steps: int = 300):
    """The track (n, 3) of an ideal base, its commands (n, 2), and the last step."""
    state, pose, twist = FollowerState(), np.array(pose, dtype=float), np.zeros(2)
    track, commands = [pose], []
    for _ in range(steps):
        step = planner.step(state, path, pose, twist, costmap, DT)
        state, twist = step.state, np.array([step.v, step.w])
        yaw = pose[2] + 0.5 * DT * step.w
        pose = pose + DT * np.array([step.v * np.cos(yaw), step.v * np.sin(yaw), step.w])
        track.append(pose)
        commands.append(twist)
        if state.phase in (Phase.REACHED, Phase.FAILED):
            break
    return np.array(track), np.array(commands), step


@planners
def test_goal_at_the_end_of_a_lane_is_reached_within_5_cm_and_2_degrees(name):
    costmap = layered_costmap(SPEC, [PolygonLayer(lane())])
    track, commands, step = drive(PLANNERS[name](), along_x(), [0.0, 0.2, 0.3], costmap)
    assert step.state.phase is Phase.REACHED
    off = in_frame_of(track[-1], np.array([4.0, 0.0, 0.0]))
    assert np.hypot(*off[:2]) < 0.05 and abs(off[2]) < np.radians(2.0)
    assert not costmap.blocked(track, Footprint()).any()
    change = np.diff(commands, axis=0) / DT
    assert np.abs(commands[:, 0]).max() <= 0.8 + 1e-9 and change[:, 0].max() <= 0.7 + 1e-6
    assert np.abs(change[:, 1]).max() <= 1.6 / 0.9  # the turn gain of an ideal base stays near 1


@planners
def test_nothing_is_touched_where_a_box_stands_on_the_path(name):
    costmap = layered_costmap(SPEC, [PolygonLayer([box(2.5, 0.0)])])
    track, _, step = drive(PLANNERS[name](), along_x(), [0.0, 0.0, 0.0], costmap, steps=120)
    assert not costmap.blocked(track, Footprint()).any()
    assert step.state.phase is Phase.REACHED or track[-1, 0] > 1.0


@pytest.mark.parametrize("name", ["teb", "mppi"])
def test_box_beside_the_path_is_passed_with_a_bend(name):
    costmap = layered_costmap(SPEC, [PolygonLayer([box(2.0, 0.40)])])
    track, _, step = drive(PLANNERS[name](), along_x(), [0.0, 0.0, 0.0], costmap)
    assert not costmap.blocked(track, Footprint()).any()
    assert track[:, 1].min() < -0.05
    assert step.state.phase is Phase.REACHED


@planners
def test_wall_across_the_lane_stops_the_robot_before_it(name):
    wall = np.array([[2.0, -3.0], [2.3, -3.0], [2.3, 3.0], [2.0, 3.0]])
    costmap = layered_costmap(SPEC, [PolygonLayer([wall])])
    track, _, step = drive(PLANNERS[name](), along_x(), [0.0, 0.0, 0.0], costmap, steps=100)
    assert not costmap.blocked(track, Footprint()).any()
    assert step.state.phase is not Phase.REACHED and track[-1, 0] > 0.3


@planners
def test_path_that_is_driven_backwards_is_driven_backwards(name):
    costmap = layered_costmap(SPEC, [PolygonLayer(lane())])
    track, commands, step = drive(PLANNERS[name](), along_x(3.0, 0.0, reverse=True), [3.0, 0.05, 0.0], costmap)
    assert step.state.phase is Phase.REACHED
    assert commands[:20, 0].max() <= 0.0 and -0.3 - 1e-9 <= commands[:, 0].min() < -0.2
    assert np.abs(track[:, 2]).max() < 0.3


@planners
def test_same_state_gives_the_same_command(name):
    costmap = layered_costmap(SPEC, [PolygonLayer([*lane(), box(2.0, 0.5)])])
    one = drive(PLANNERS[name](), along_x(), [0.0, 0.1, 0.1], costmap, steps=10)[1]
    two = drive(PLANNERS[name](), along_x(), [0.0, 0.1, 0.1], costmap, steps=10)[1]
    assert np.array_equal(one, two)


def test_another_generator_gives_other_noise():
    costmap = layered_costmap(SPEC, [])
    options = MppiOptions(samples=50)
    one = drive(Mppi(options=options, rng=np.random.default_rng(1)), along_x(), [0.0, 0.1, 0.1], costmap, 3)[1]
    two = drive(Mppi(options=options, rng=np.random.default_rng(2)), along_x(), [0.0, 0.1, 0.1], costmap, 3)[1]
    assert not np.array_equal(one, two)


@planners
def test_robot_facing_the_wrong_way_turns_on_the_spot_first(name):
    costmap = layered_costmap(SPEC, [])
    step = PLANNERS[name]().step(FollowerState(), along_x(), np.array([0.0, 0.0, 2.9]), np.zeros(2), costmap, DT)
    assert step.state.phase is Phase.TURN and step.v == 0.0


@planners
def test_estimate_that_leaps_to_the_goal_is_driven_on_from_there(name):
    costmap, path = layered_costmap(SPEC, []), along_x(end=1.0)
    step = PLANNERS[name]().step(FollowerState(travelled=0.3), path, [0.995, 0.1, 0.0], np.zeros(2), costmap, DT)
    assert np.isfinite([step.v, step.w]).all() and step.state.phase is not Phase.FAILED
    assert abs(step.v) <= 0.8 and step.state.travelled == pytest.approx(0.995)


@planners
def test_pose_that_is_not_finite_is_refused(name):
    with pytest.raises(InvalidInput):
        PLANNERS[name]().step(
            FollowerState(), along_x(), np.full(3, np.nan), np.zeros(2), layered_costmap(SPEC, []), DT
        )


@pytest.mark.parametrize(
    "make",
    [
        lambda: MppiOptions(samples=1),
        lambda: MppiOptions(correlation=1.0),
        lambda: TebOptions(bulges=()),
        lambda: DwaOptions(period=0.0),
    ],
)
def test_search_without_samples_is_refused(make):
    with pytest.raises(InvalidInput):
        make()


def test_classic_window_holds_only_what_one_period_can_reach():
    costmap = layered_costmap(SPEC, [])
    step = Dwa(options=CLASSIC).step(FollowerState(), along_x(), np.zeros(3), np.zeros(2), costmap, DT)
    assert 0.0 < step.v <= 0.7 * DT + 1e-9


def test_planners_are_found_by_name():
    assert {"pure_pursuit", "dwa", "teb", "mppi"} <= set(find(LOCAL_PLANNERS))
    assert load(LOCAL_PLANNERS, "teb") is Teb
