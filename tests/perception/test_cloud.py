"""Clouds: depth images, voxels, boxes, outliers."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.perception.cloud import (
    DepthOptions,
    crop_box,
    crop_sphere,
    depth_to_points,
    outlier_mask,
    remove_outliers,
    surface_mask,
    voxel_grid,
)

K = np.array([[466.0, 0, 319.5], [0, 466.0, 239.5], [0, 0, 1]])


def test_a_flat_depth_image_becomes_a_plane_with_the_right_rays():
    depth = np.full((480, 640), 0.5, np.float32)
    points = depth_to_points(depth, K)
    assert len(points) == 480 * 640
    np.testing.assert_allclose(points[0], [-319.5 / 466 * 0.5, -239.5 / 466 * 0.5, 0.5], atol=1e-9)
    np.testing.assert_allclose(points[:, 2], 0.5)


def test_missing_too_near_and_too_far_depths_give_no_points():
    depth = np.zeros((8, 8), np.float32)
    depth[0], depth[1], depth[2], depth[3] = np.nan, np.inf, 0.1, 5.0
    assert depth_to_points(depth, K).shape == (0, 3)


def test_flying_pixels_at_an_edge_are_dropped_and_the_thin_stem_stays_whole():
    depth = np.full((40, 40), 0.8, np.float32)
    depth[:, 15:21] = 0.4
    depth[:, 21] = np.linspace(0.45, 0.75, 40)[np.random.default_rng(1).permutation(40)]
    mask = surface_mask(depth, DepthOptions())
    assert mask[:, 15:21].all()
    assert mask[:, 21].mean() < 0.1
    assert surface_mask(depth, DepthOptions(neighbours=0)).all()


def test_a_step_thins_rows_and_columns():
    depth = np.full((40, 40), 0.5, np.float32)
    assert len(depth_to_points(depth, K, DepthOptions(step=4))) == 100


def test_voxels_are_centroids_and_may_need_several_points():
    points = np.array([[0.001, 0, 0], [0.003, 0, 0], [-0.001, 0.001, 0.001], [1.0, 1.0, 1.0]])
    np.testing.assert_allclose(voxel_grid(points, 0.01), [[0.002, 0, 0], [-0.001, 0.001, 0.001], [1, 1, 1]])
    np.testing.assert_allclose(voxel_grid(points, 0.01, min_points=2), [[0.002, 0, 0]])


def test_voxels_keep_every_point_and_agree_with_a_plain_grouping():
    points = np.random.default_rng(2).uniform(-1, 1, (5000, 3))
    cells = np.unique(np.floor(points / 0.2).astype(int), axis=0)
    grid = voxel_grid(points, 0.2)
    assert len(grid) == len(cells)
    assert {tuple(c) for c in np.floor(grid / 0.2).astype(int)} == {tuple(c) for c in cells}


def test_boxes_and_spheres_cut():
    points = np.array([[0.0, 0, 0], [0.5, 0, 0], [2.0, 0, 0]])
    assert len(crop_box(points, (-1, -1, -1), (1, 1, 1))) == 2
    assert len(crop_box(points, (-np.inf,) * 3, (np.inf,) * 3)) == 3
    assert len(crop_sphere(points, (0.5, 0, 0), 0.6)) == 2


def test_lonely_points_are_outliers():
    rng = np.random.default_rng(3)
    dense = rng.uniform(0, 0.05, (300, 3))
    lonely = np.array([[1.0, 1, 1], [2.0, 2, 2]])
    mask = outlier_mask(np.vstack([dense, lonely]), 0.02, 4)
    assert mask[:300].mean() > 0.9 and not mask[300:].any()


@pytest.mark.parametrize("far", [(0.0, 0.0, 20e3), (6e5, 4.8e6, 100.0), (0.0, -12e3, 0.0), (0.0, 0.0, 9437.184)])
def test_outliers_are_the_same_far_from_the_origin(far):
    points = np.random.default_rng(0).uniform(0, 0.1, (2000, 3))
    assert np.mean(outlier_mask(points + far, 0.01, 5) != outlier_mask(points, 0.01, 5)) < 1e-3


def test_points_whose_cells_share_a_key_are_not_neighbours():
    apart = np.array([[0.0, 0.0, 0.0], [2.0**21, 0.0, 0.0]])
    assert not outlier_mask(np.vstack([apart, apart + 1e-3]), 1.0, 2).any()
    assert outlier_mask(np.vstack([apart, apart + 1e-3]), 1.0, 1).all()


def test_empty_clouds_stay_empty():
    empty = np.empty((0, 3))
    for result in (voxel_grid(empty, 0.01), remove_outliers(empty, 0.1, 3), crop_box(empty, (0, 0, 0), (1, 1, 1))):
        assert result.shape == (0, 3)


@pytest.mark.parametrize("bad", [np.zeros(3), np.zeros((2, 2)), np.full((2, 3), np.nan), np.full((1, 3), np.inf)])
def test_clouds_of_another_shape_or_not_finite_are_refused(bad):
    for function in (
        lambda p: voxel_grid(p, 0.01),
        lambda p: remove_outliers(p, 0.1, 3),
        lambda p: crop_sphere(p, (0, 0, 0), 1),
    ):
        with pytest.raises(InvalidInput, match="points"):
            function(bad)


def test_limits_that_make_no_sense_are_refused():
    points = np.zeros((4, 3))
    with pytest.raises(InvalidInput, match="voxel_m"):
        voxel_grid(points, 0.0)
    with pytest.raises(InvalidInput, match="box"):
        crop_box(points, (1, 0, 0), (0, 1, 1))
    with pytest.raises(InvalidInput, match="radius"):
        outlier_mask(points, -1.0, 3)
    with pytest.raises(InvalidInput, match="radius"):
        crop_sphere(points, (0, 0, 0), 0.0)
    with pytest.raises(InvalidInput, match="range_m"):
        DepthOptions(range_m=(1.0, 0.5))
    with pytest.raises(InvalidInput, match="neighbours"):
        DepthOptions(neighbours=9)
    with pytest.raises(InvalidInput, match="depth image"):
        depth_to_points(np.zeros((2, 2, 2)), K)
