"""Point clouds as plain (n, 3) arrays: from a depth image, thinned, cropped, cleaned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, RgbdImage
from grape.perception.checks import as_depth, as_intrinsics, as_points, as_vector


@dataclass(frozen=True, kw_only=True)
class DepthOptions:
    """Which pixels of a depth image become points.

    Args:
        range_m: (near, far) along the optical axis.
        jump_m, jump_ratio: two neighbouring pixels lie on one surface when their depths differ by less than
            jump_m + jump_ratio * depth.
        neighbours: of its 8 neighbours, how many must lie on a pixel's surface; pixels that the sensor smears between
            fore- and background (flying pixels) have fewer, the true edge of a thin stem has at least 3. 0: no filter.
        step: take every `step`-th row and column.
    """

    range_m: tuple[float, float] = (0.2, 1.2)
    jump_m: float = 0.006
    jump_ratio: float = 0.01
    neighbours: int = 3
    step: int = 1

    def __post_init__(self) -> None:
        if not 0 <= self.range_m[0] < self.range_m[1]:
            raise InvalidInput(f"range_m must rise from 0 or more, got {self.range_m}")
        if not 0 <= self.neighbours <= 8 or self.step < 1 or self.jump_m < 0 or self.jump_ratio < 0:
            raise InvalidInput(f"neighbours must be 0...8, step at least 1, jumps not negative, got {self}")


def surface_mask(depth: Array, options: DepthOptions) -> Array:
    """(h, w) bool: pixels in range whose neighbourhood shows the same surface.

    Args:
        depth: (h, w) m, 0 where nothing was measured.
    """
    depth = as_depth(depth)
    valid = (depth >= options.range_m[0]) & (depth <= options.range_m[1]) & (depth > 0)
    if options.neighbours == 0:
        return valid
    limit = options.jump_m + options.jump_ratio * depth
    count = np.zeros(depth.shape, np.int8)
    for dv, du in ((0, 1), (1, 0), (1, 1), (1, -1)):  # each pair of neighbours once
        here, there = _shifted(dv, du)
        same = valid[here] & valid[there] & (np.abs(depth[here] - depth[there]) <= limit[here])
        count[here] += same
        count[there] += same
    return valid & (count >= options.neighbours)


def _shifted(dv: int, du: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Index pairs that lay an image over itself moved by (dv, du)."""
    rows = (slice(0, -dv or None), slice(dv, None))
    columns = (slice(max(-du, 0), -du if du > 0 else None), slice(max(du, 0), du if du < 0 else None))
    return (rows[0], columns[0]), (rows[1], columns[1])


def depth_to_points(depth: Array, K: Array, options: DepthOptions | None = None) -> Array:
    """(n, 3) m in the optical frame: the pixels that `surface_mask` keeps, row by row.

    Args:
        depth: (h, w) m; 0, NaN and infinite mean no measurement.
        K: (3, 3) camera matrix.

    Raises:
        InvalidInput: a depth image or matrix of another shape.
    """
    options = options or DepthOptions()
    K = as_intrinsics(K)
    depth = as_depth(depth)
    mask = surface_mask(depth, options)
    if options.step > 1:
        coarse = np.zeros_like(mask)
        coarse[:: options.step, :: options.step] = True
        mask &= coarse
    v, u = np.nonzero(mask)
    z = depth[v, u].astype(np.float64)
    return np.column_stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z])


def image_to_points(image: RgbdImage, options: DepthOptions | None = None) -> Array:
    """(n, 3) m in the image's optical frame, see `depth_to_points`."""
    return depth_to_points(image.depth, image.info.K, options)


def voxel_grid(points: Array, voxel_m: float, min_points: int = 1) -> Array:
    """(m, 3) centroids of the occupied cells of a grid, in the order in which the cells are first met.

    Args:
        points: (n, 3) m.
        voxel_m: edge of a cell.
        min_points: cells with fewer points are dropped.

    Raises:
        InvalidInput: points of another shape, or a cell size that is not positive.
    """
    points = as_points(points)
    if not (np.isfinite(voxel_m) and voxel_m > 0):
        raise InvalidInput(f"voxel_m must be positive metres, got {voxel_m}")
    if len(points) == 0:
        return points.copy()
    from grape.perception.voxel_kernel import accumulate

    sums, counts = accumulate(np.ascontiguousarray(points), float(voxel_m))
    keep = counts >= min_points
    return sums[keep] / counts[keep, None]


def crop_mask(points: Array, low: Any, high: Any) -> Array:
    """(n,) bool: points inside the box from `low` to `high` (3,) m, same frame; infinite limits are allowed.

    Raises:
        InvalidInput: points or limits of another shape, or low above high.
    """
    points = as_points(points)
    low, high = (np.asarray(v, dtype=np.float64) for v in (low, high))
    if low.shape != (3,) or high.shape != (3,) or not (low <= high).all():
        raise InvalidInput(f"a box needs low <= high, (3,) each, got {low} and {high}")
    return ((points >= low) & (points <= high)).all(axis=1)


def crop_box(points: Array, low: Any, high: Any) -> Array:
    """The points inside a box, see `crop_mask`."""
    return as_points(points)[crop_mask(points, low, high)]


def crop_sphere(points: Array, centre: Any, radius_m: float) -> Array:
    """The points within `radius_m` of `centre` (3,).

    Raises:
        InvalidInput: another shape, or a radius that is not positive.
    """
    points, centre = as_points(points), as_vector(centre, 3, "centre")
    if not radius_m > 0:
        raise InvalidInput(f"radius_m must be positive, got {radius_m}")
    return points[np.sum((points - centre) ** 2, axis=1) <= radius_m**2]


def outlier_mask(points: Array, radius_m: float, neighbours: int) -> Array:
    """(n,) bool: points with at least `neighbours` others within `radius_m`.

    Raises:
        InvalidInput: points of another shape, or limits that are not positive.
    """
    points = as_points(points)
    if not radius_m > 0 or neighbours < 1:
        raise InvalidInput(f"radius_m and neighbours must be positive, got {radius_m} and {neighbours}")
    if len(points) <= neighbours:
        return np.zeros(len(points), bool)
    from grape.perception.neighbour_kernels import crowded

    return crowded(np.ascontiguousarray(points), radius_m, neighbours)


def remove_outliers(points: Array, radius_m: float, neighbours: int) -> Array:
    """The points that `outlier_mask` keeps."""
    return as_points(points)[outlier_mask(points, radius_m, neighbours)]
