"""The vineyard on paper: what it judges, and how a base in it goes wrong."""

from __future__ import annotations

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.experiments import driving_bench
from grape.experiments import g5_local_planners as g5
from grape.experiments.bench_navigation.local_planners import SEED, costmap_update, planner_step
from grape.experiments.driving_bench import Outcome, driven, run_seed
from grape.experiments.driving_yard import Base, gap_to_circles, in_fence, scan_of, yard
from grape.experiments.g5_local_planners import turn_crosses_fence
from grape.navigation.costmap import PolygonLayer, layered_costmap
from grape.navigation.follower import Phase
from grape.navigation.grid import LETHAL, Footprint
from grape.navigation.monitor import speed_factor
from grape.navigation.planner import plan_path
from grape.navigation.teb import Teb

BOX = Footprint(front=0.5, rear=0.5, half_width=0.3)


def test_every_seed_has_its_own_yard_with_goals_that_can_be_reached():
    one, again, other = yard(3), yard(3), yard(4)
    assert np.array_equal(one.circles, again.circles) and not np.array_equal(one.start, other.start)
    for seed in (*range(30), 503, 504, 552):
        place = yard(seed)
        assert [goal.kind for goal in place.goals] == ["row entry", "plant", "obstacle", "row change"]
        for pose in (place.start, *(goal.pose for goal in place.goals)):
            assert gap_to_circles(pose, place.circles, Footprint()) > 0.05
            assert not in_fence(pose, place.fences, Footprint())


@pytest.mark.parametrize("seed", [53, 87, 94, 516])  # where the plant after the obstacle is too near to it
def test_no_goal_is_so_near_to_the_obstacle_that_the_collision_monitor_stops_short_of_it(seed):
    place = yard(seed)
    obstacle = place.circles[-1]
    for goal in place.goals:
        assert gap_to_circles(goal.pose, obstacle[None], Footprint()) > 0.25
        c, s = np.cos(goal.pose[2]), np.sin(goal.pose[2])
        x, y = np.array([[c, s], [-s, c]]) @ (obstacle[:2] - goal.pose[:2])
        around = np.array([x, y]) + obstacle[2] * np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 6.2, 60)])
        for creep in (0.05, -0.05):
            assert speed_factor(creep, 0.0, around) > 0.0


@pytest.mark.parametrize("x, y, gap", [(0.8, 0.0, 0.2), (0.0, 0.7, 0.3), (0.9, 0.6, 0.4), (0.2, 0.1, -0.1)])
def test_gap_between_footprint_and_circle(x, y, gap):
    assert gap_to_circles(np.zeros(3), np.array([[x, y, 0.1]]), BOX) == pytest.approx(gap)
    turned = np.array([1.0, 2.0, np.pi / 2])
    assert gap_to_circles(turned, np.array([[1.0 - y, 2.0 + x, 0.1]]), BOX) == pytest.approx(gap)


def test_fence_is_crossed_by_an_edge_without_any_corner_in_it():
    thin = np.array([[-0.01, -2.0], [0.01, -2.0], [0.01, 2.0], [-0.01, 2.0]])
    assert in_fence(np.zeros(3), (thin,), BOX)
    assert not in_fence(np.array([0.6, 0.0, 0.0]), (thin,), BOX)
    assert in_fence(np.array([0.55, 0.0, np.pi / 4]), (thin,), BOX)


def test_turning_base_drifts_and_its_estimate_learns_it_late():
    base = Base(np.zeros(3), np.random.default_rng(5), sigma=0.0)
    for _ in range(12):
        base.drive(0.0, 1.0, 0.1)
    drifted = float(np.hypot(*base.pose[:2]))
    assert drifted > 0.02 and np.hypot(*(base.estimate()[:2] - base.pose[:2])) > 0.3 * drifted
    for _ in range(80):
        base.drive(0.0, 0.0, 0.1)
    assert np.hypot(*(base.estimate()[:2] - base.pose[:2])) < 0.01


def test_turns_beside_a_row_cross_its_fence_unless_they_wait_for_room():
    assert any(turn_crosses_fence(seed, guarded=False) for seed in range(4))
    assert not any(turn_crosses_fence(seed, guarded=True) for seed in range(4))


def test_drives_of_a_seed_are_judged_by_truth_and_driven_once(tmp_path, monkeypatch):
    drives = driven(tmp_path, "pure_pursuit", 0)
    assert [drive.kind for drive in drives] == ["row entry", "plant", "obstacle", "row change"]
    place = yard(0)
    for drive, goal in zip(drives, place.goals, strict=True):
        assert drive.success and drive.off_m <= 0.05 and 0.0 < drive.least_gap_m < 0.6
        assert np.hypot(*(np.array(drive.track[-1]) - goal.pose)[:2]) < 0.3
        assert drive.driven_m > np.hypot(*(np.array(drive.track[-1]) - drive.track[0])[:2]) - 0.1
    monkeypatch.setattr(driving_bench, "run_seed", None)
    assert driven(tmp_path, "pure_pursuit", 0) == drives


@pytest.mark.parametrize("change", [{"off_m": 0.051}, {"off_rad": 0.036}, {"contact": True}, {"fence": True}])
def test_drive_that_ends_beside_its_goal_or_touches_something_is_no_success(change):
    good = outcome("teb", 500, "plant")
    assert good.success and not replace(good, **change).success and not replace(good, reached=False).success
    assert "FAILED" in replace(good, **change).line() and "there" in good.line()


def test_scanner_sees_the_nearest_circle_in_each_direction():
    circles = np.array([[3.45, 0.0, 0.5], [5.0, 0.0, 0.5], [0.45, 2.0, 0.2], [-3.0, 0.0, 0.5]])
    scan = scan_of(circles, np.zeros(3), np.random.default_rng(1), sigma=0.0)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    assert scan.ranges[240] == pytest.approx(2.5) and scan.ranges[360] == pytest.approx(1.8)
    seen = np.isfinite(scan.ranges)
    assert scan.ranges[0] == pytest.approx(2.95)
    ahead = angles[seen & (np.abs(angles) < 1.0)]
    assert np.abs(ahead).max() == pytest.approx(np.arcsin(0.5 / 3.0), abs=scan.angle_increment)
    turned = scan_of(circles, np.array([0.0, 0.0, np.pi]), np.random.default_rng(1), sigma=0.0)
    assert turned.ranges[240] == pytest.approx(2.05)


def test_planner_that_is_not_there_is_refused():
    with pytest.raises(InvalidInput, match="mppi"):
        run_seed(0, "unknown")


def test_row_tells_what_each_planner_did_and_goes_on_from_the_folder(tmp_path, monkeypatch):
    calls = []

    def run_paper_seed(seed, name):
        calls.append((seed, name))
        if (name, seed) == ("teb", 501):
            os.kill(os.getpid(), signal.SIGINT)  # Ctrl-C: these drives end, no others begin
        drives = [outcome(name, seed, kind) for kind in g5.KINDS]
        return [replace(drives[0], fence=True, stuck=2), *drives[1:]] if name == "dwa" else drives

    monkeypatch.setattr(driving_bench, "run_seed", run_paper_seed)
    proof = g5.run([500, 501], tmp_path, lambda share, text: None)
    found = {quantity.name: quantity for quantity in proof.quantities}
    assert not proof.complete and calls[-1] == (501, "teb") and len(calls) == 9
    assert found["mppi: drives that succeeded"].n == 4 and found["teb: drives that succeeded"].n == 8
    assert found["dwa: drives that succeeded"].value == 0.75 and found["dwa: drives that succeeded"].met is False
    assert found["dwa: drives that entered a fence"].value == 2.0 and found["dwa: times stuck"].value == 4.0
    assert found["teb: time, median"].n == 3  # those in which all succeeded
    assert len(proof.figures) == 2 and "polyline" in proof.figures[1].svg


def test_what_the_bench_times_is_a_search_in_a_lane_that_was_seen():
    place = yard(SEED)
    pose, goal = place.goals[1].pose, place.goals[2].pose
    costmap = costmap_update(place, pose)()
    fences = layered_costmap(costmap.spec, [PolygonLayer(place.fences)])
    assert (costmap.cost == LETHAL).sum() > (fences.cost == LETHAL).sum() + 3
    step = planner_step(Teb(), plan_path(costmap, pose, goal), pose, costmap)()
    assert step.state.phase is Phase.TRACK and step.v > 0.2 and step.state.memory is not None and not step.blocked


def outcome(name: str, seed: int, kind: str) -> Outcome:
    return Outcome(
        seed=seed,
        kind=kind,
        planner=name,
        reached=True,
        time_s=8.0,
        driven_m=4.0,
        least_gap_m=0.2,
        contact=False,
        fence=False,
        stuck=0,
        off_m=0.02,
        off_rad=0.01,
        track=[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
    )
