"""Pose graphs: derivatives, a loop that closes, a loop that is taken for wrong; planar poses, errors of ways."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.mapping import Edge, between, chained, compose, optimise, relation_error, rigid_fit, trajectory_error
from grape.mapping.pose_graph import _linearised
from grape.messages import Array

STRONG, WEAK = np.diag([400.0, 400.0, 2000.0]), np.diag([1000.0, 1000.0, 4000.0])


def square(side: int = 10) -> Array:
    """A way round a square, back to its start."""
    steps = [[1.0, 0.0, 0.5 * np.pi if (k + 1) % side == 0 else 0.0] for k in range(4 * side)]
    return chained(np.array(steps))


def odometry_edges(true: Array, rng: np.random.Generator) -> tuple[list[Edge], Array]:
    steps = between(true[:-1], true[1:]) + rng.standard_normal((len(true) - 1, 3)) * [0.02, 0.02, 0.01] + [0, 0, 0.01]
    edges = [Edge(first=k, second=k + 1, relative=step, information=STRONG) for k, step in enumerate(steps)]
    return edges, chained(steps)


def test_poses_compose_and_part() -> None:
    rng = np.random.default_rng(0)
    a, b, c = rng.uniform(-3, 3, (3, 50, 3))
    np.testing.assert_allclose(between(a, compose(a, b))[:, :2], b[:, :2], atol=1e-12)
    np.testing.assert_allclose(compose(compose(a, b), c)[:, :2], compose(a, compose(b, c))[:, :2], atol=1e-12)
    assert np.abs(compose(a, b)[:, 2]).max() <= np.pi


def test_derivatives_are_those_of_finite_differences() -> None:
    rng = np.random.default_rng(1)
    xi, xj, z = rng.uniform(-1, 1, (3, 5, 3))
    error, A, B = _linearised(xi, xj, z)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-6
        np.testing.assert_allclose(A[:, :, k], (_linearised(xi + step, xj, z)[0] - error) / 1e-6, atol=1e-5)
        np.testing.assert_allclose(B[:, :, k], (_linearised(xi, xj + step, z)[0] - error) / 1e-6, atol=1e-5)


def test_a_closed_loop_takes_the_drift_out() -> None:
    true = square()
    edges, drifted = odometry_edges(true, np.random.default_rng(2))
    loop = Edge(first=0, second=40, relative=between(true[0], true[40]), information=WEAK, doubtful=True)
    solution = optimise(drifted, [*edges, loop])
    before, after = trajectory_error(drifted, true, fit=False), trajectory_error(solution.poses, true, fit=False)
    assert after.position_rmse < 0.35 * before.position_rmse
    np.testing.assert_array_equal(solution.poses[0], drifted[0])


def test_a_wrong_loop_among_right_ones_counts_little() -> None:
    true = np.vstack([square(), square()[1:]])
    edges, drifted = odometry_edges(true, np.random.default_rng(3))
    right = [
        Edge(first=k, second=k + 40, relative=between(true[k], true[k + 40]), information=WEAK, doubtful=True)
        for k in range(0, 40, 4)
    ]
    wrong = Edge(first=5, second=60, relative=np.array([0.5, 0.0, 0.2]), information=WEAK, doubtful=True)
    without = trajectory_error(optimise(drifted, [*edges, *right]).poses, true)
    solution = optimise(drifted, [*edges, *right, wrong])
    assert solution.weight[-1] < 0.1 and solution.weight[len(edges) : -1].min() > 0.25
    assert trajectory_error(solution.poses, true).position_rmse < 1.3 * without.position_rmse


def test_edges_to_nowhere_are_refused() -> None:
    with pytest.raises(InvalidInput, match="outside 0 to 1"):
        optimise(np.zeros((2, 3)), [Edge(first=0, second=2, relative=np.zeros(3), information=np.eye(3))])
    with pytest.raises(InvalidInput, match="joins two nodes"):
        Edge(first=1, second=1, relative=np.zeros(3), information=np.eye(3))


def test_errors_are_free_of_the_frame() -> None:
    true = square()
    frame = np.array([3.0, -2.0, 1.0])
    moved = compose(frame, true)
    np.testing.assert_allclose(rigid_fit(true, moved), frame, atol=1e-9)
    assert trajectory_error(true, moved).position_max == pytest.approx(0.0, abs=1e-9)
    assert trajectory_error(true, moved, fit=False).position_rmse > 3.0
    assert relation_error(true, moved).translation == pytest.approx(0.0, abs=1e-9)
    longer = chained(between(true[:-1], true[1:]) * [1.1, 1.0, 1.0])
    assert relation_error(longer, true).translation == pytest.approx(0.1)


@pytest.mark.parametrize("other", [np.zeros((3, 3)), np.full((4, 3), np.nan), np.zeros((4, 2))])
def test_ways_that_cannot_be_compared_are_refused(other: Array) -> None:
    with pytest.raises(InvalidInput):
        trajectory_error(np.zeros((4, 3)), other)
