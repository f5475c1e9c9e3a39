"""The vineyard on paper: what it judges, and how a base in it goes wrong."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.experiments.driving_bench import run_seed, summary, turning_trial
from grape.experiments.driving_yard import Base, gap_to_circles, in_fence, yard
from grape.navigation.grid import Footprint

BOX = Footprint(front=0.5, rear=0.5, half_width=0.3)


def test_every_seed_has_its_own_yard_with_goals_that_can_be_reached():
    one, again, other = yard(3), yard(3), yard(4)
    assert np.array_equal(one.circles, again.circles) and not np.array_equal(one.start, other.start)
    for seed in range(30):
        place = yard(seed)
        assert [goal.kind for goal in place.goals] == ["row entry", "plant", "obstacle", "row change"]
        for pose in (place.start, *(goal.pose for goal in place.goals)):
            assert gap_to_circles(pose, place.circles, Footprint()) > 0.05
            assert not in_fence(pose, place.fences, Footprint())


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
    assert any(turning_trial(seed, guarded=False) for seed in range(4))
    assert not any(turning_trial(seed, guarded=True) for seed in range(4))


def test_drive_is_judged_by_truth():
    (outcome, *_) = run_seed(0, "pure_pursuit", limit_s=60.0)[:1]
    assert outcome.kind == "row entry" and outcome.time_s <= 60.1
    sums = summary([outcome])
    assert sums["drives"] == 1 and sums["success"] == float(outcome.success)


def test_planner_that_is_not_there_is_refused():
    with pytest.raises(InvalidInput, match="mppi"):
        run_seed(0, "unknown")
    with pytest.raises(InvalidInput):
        summary([])
