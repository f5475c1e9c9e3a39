"""Inverse kinematics finds the pose again, respects limits and ranks its solutions."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import interpolate, pose, pose_error
from grape.kinematics import ArmModel, IkOptions, inverse, inverse_all, inverse_path
from grape.robots.husky_jaco2 import DESCRIPTION

HOME = DESCRIPTION.arm.poses["home"]


@pytest.fixture(scope="module")
def arm():
    return ArmModel.from_mjcf(DESCRIPTION.mjcf)


@pytest.mark.parametrize("seed", range(10))
def test_a_pose_near_the_seed_is_found_again(arm, seed):
    q = HOME + np.random.default_rng(seed).uniform(-0.3, 0.3, 6)
    result = inverse(arm, arm.fk(q), HOME)
    assert result.converged
    assert np.abs(pose_error(arm.fk(q), arm.fk(result.q))[:3]).max() < 1e-5
    assert arm.within_limits(result.q)


def test_a_pose_out_of_reach_is_reported_with_its_error(arm):
    result = inverse(arm, pose(translation=(3.0, 0.0, 0.0)), HOME)
    assert not result.converged
    assert result.position_error > 1.5
    assert inverse_all(arm, pose(translation=(3.0, 0.0, 0.0)), HOME, options=IkOptions(seeds=3, iterations=20)) == ()


def test_a_matrix_that_is_no_pose_is_refused(arm):
    with pytest.raises(InvalidInput, match="rigid pose"):
        inverse(arm, np.zeros((4, 4)), HOME)


def test_several_distinct_solutions_come_best_first(arm):
    T = arm.fk(HOME)
    solutions = inverse_all(arm, T, HOME)
    assert len(solutions) >= 4
    scores = [solution.score for solution in solutions]
    assert scores == sorted(scores, reverse=True)
    for solution in solutions:
        assert np.abs(pose_error(T, arm.fk(solution.q))).max() < 2e-4
        assert arm.within_limits(solution.q)
        assert np.abs(solution.q - HOME)[[0, 3, 4, 5]].max() <= np.pi + 1e-9
        assert solution.sigma_min == pytest.approx(arm.sigma_min(solution.q))


def test_solutions_follow_the_winding_of_the_reference(arm):
    wound = HOME + np.array([0, 0, 0, 0, 0, 4 * np.pi])
    best = min(inverse_all(arm, arm.fk(HOME), wound), key=lambda solution: solution.travel)
    np.testing.assert_allclose(best.q, wound, atol=1e-3)


def test_without_a_generator_the_search_is_repeatable_and_a_generator_changes_it(arm):
    T = arm.fk(HOME)
    first, again = inverse_all(arm, T, HOME), inverse_all(arm, T, HOME)
    assert [tuple(s.q) for s in first] == [tuple(s.q) for s in again]
    scattered = inverse_all(arm, T, HOME, rng=np.random.default_rng(1))
    np.testing.assert_allclose(arm.fk(scattered[0].q), T, atol=2e-4)


def test_a_straight_path_stays_in_one_branch(arm):
    start = arm.fk(HOME)
    goal = start.copy()
    goal[:3, 3] += (0.0, 0.0, 0.10)
    path = inverse_path(arm, np.array([interpolate(start, goal, s) for s in np.linspace(0, 1, 11)]), HOME)
    assert path is not None
    assert np.abs(np.diff(path, axis=0)).max() < 0.2
    np.testing.assert_allclose(arm.fk(path[-1]), goal, atol=2e-4)


def test_a_jump_breaks_the_path(arm):
    there = arm.fk(HOME + np.array([2.0, 0, 0, 0, 0, 0]))
    assert inverse_path(arm, np.array([there]), HOME, step_max=0.5) is None
