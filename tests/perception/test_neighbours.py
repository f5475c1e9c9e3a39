"""Near points through a hashed grid, against a k-d tree."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from grape.perception.neighbour_kernels import crowded, nearest


@pytest.fixture
def points():
    rng = np.random.default_rng(0)
    return np.vstack([rng.uniform(-0.1, 0.1, (1500, 3)), rng.normal(0, 0.004, (300, 3)), [[5.0, -7.0, 2.0]]])


def test_the_nearest_points_are_those_of_a_tree(points):
    index, distance = nearest(points, 0.012, 6)
    expected, rows = cKDTree(points).query(points, k=7, distance_upper_bound=0.012)
    np.testing.assert_allclose(distance, expected[:, 1:], atol=1e-12)
    there = np.isfinite(distance)
    assert (index[~there] == -1).all() and there.any() and not there.all()
    np.testing.assert_array_equal(index[there], rows[:, 1:][there])


@pytest.mark.parametrize("neighbours", [1, 4, 30])
def test_crowded_points_have_as_many_others_in_the_radius(points, neighbours):
    counts = cKDTree(points).query_ball_point(points, 0.012, return_length=True) - 1
    np.testing.assert_array_equal(crowded(points, 0.012, neighbours), counts >= neighbours)
    assert not crowded(points, 0.012, neighbours)[-1]
