"""A distance field of a perceived cloud: how far each place near the arm is from the nearest measured point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, frozen_array

Ball = tuple[Array, float]  # centre (3,) m, radius m


@dataclass(frozen=True, kw_only=True)
class DistanceFieldOptions:
    """How a field is built.

    Args:
        voxel_m: edge of a voxel.
        reach_m: distances are exact up to here and cut off beyond; outside of the stored box they are this large.
        lower, upper: corners of the region that matters, base frame, m; points outside are dropped.
    """

    voxel_m: float = 0.01
    reach_m: float = 0.15
    lower: tuple[float, float, float] = (-1.0, -1.0, -0.2)
    upper: tuple[float, float, float] = (1.5, 1.5, 1.9)

    def __post_init__(self) -> None:
        if not 0.0 < self.voxel_m < self.reach_m:
            raise InvalidInput(f"0 < voxel_m < reach_m must hold, got {self.voxel_m} and {self.reach_m}")


@dataclass(frozen=True, kw_only=True)
class DistanceField:
    """Distances at the centres of a grid of voxels.

    Attributes:
        distance: (nx, ny, nz) float32, m, at most `reach_m`.
        origin: (3,) m, centre of voxel (0, 0, 0) in the base frame.
        voxel_m, reach_m: see `DistanceFieldOptions`.
        point_count: how many points lay in the region.
    """

    distance: Array
    origin: Array
    voxel_m: float
    reach_m: float
    point_count: int

    def query(self, points: Array) -> Array:
        """(m,) distance in m of points (m, 3), base frame, to the cloud; trilinear, at most `reach_m`."""
        from grape.planning._field_kernels import query_field

        return query_field(np.ascontiguousarray(points, dtype=float), self.distance, self.grid)

    @property
    def grid(self) -> Array:
        """(5,) origin, voxel and reach: what the kernels need beside the distances."""
        return np.array([*self.origin, self.voxel_m, self.reach_m])


def empty_field(reach_m: float = 0.15) -> DistanceField:
    """The field of free space."""
    return DistanceField(
        distance=frozen_array(np.full((1, 1, 1), reach_m), np.float32),
        origin=frozen_array(np.zeros(3)),
        voxel_m=0.01,
        reach_m=reach_m,
        point_count=0,
    )


def build_distance_field(points: Array, options: DistanceFieldOptions | None = None) -> DistanceField:
    """Distance field of a cloud: occupied voxels, then an exact Euclidean distance transform around them.

    Args:
        points: (m, 3) m, base frame; rows that are not finite are dropped.
        options: voxel size, reach and region.

    Raises:
        InvalidInput: `points` has another shape.

    Source: Felzenszwalb and Huttenlocher, Distance transforms of sampled functions, 2012.
    """
    options = options or DistanceFieldOptions()
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidInput(f"points must have shape (m, 3), got {points.shape}")
    kept = points[_counts(points, options)]
    if len(kept) == 0:
        return empty_field(options.reach_m)
    margin = int(np.ceil(options.reach_m / options.voxel_m)) + 1
    low = np.floor(kept.min(axis=0) / options.voxel_m).astype(int) - margin
    high = np.floor(kept.max(axis=0) / options.voxel_m).astype(int) + margin
    index = np.floor(kept / options.voxel_m).astype(int) - low
    return DistanceField(
        distance=_transform(index, high - low + 1, options),
        origin=frozen_array((low + 0.5) * options.voxel_m),
        voxel_m=options.voxel_m,
        reach_m=options.reach_m,
        point_count=len(kept),
    )


def carve_distance_field(
    field: DistanceField,
    points: Array,
    balls: Sequence[Ball],
    options: DistanceFieldOptions | None = None,
) -> DistanceField:
    """The field as if the points inside some balls had not been seen; only the box around the balls is computed.

    Args:
        field: what `build_distance_field` made of the same `points` and `options`.
        points: (m, 3) m, base frame.
        balls: (centre (3,) m, radius m), such as the spur that is to be touched.
        options: those of the field.
    """
    options = options or DistanceFieldOptions()
    points = np.asarray(points, dtype=float)
    keep = _counts(points, options)
    if not len(balls):
        return field
    for center, radius in balls:
        keep = keep & (((points - np.asarray(center)) ** 2).sum(axis=1) > radius**2)
    low = np.round(field.origin / options.voxel_m - 0.5).astype(int)
    index = np.floor(points[keep] / options.voxel_m).astype(int) - low
    margin = int(np.ceil(options.reach_m / options.voxel_m)) + 1
    centers = np.array([center for center, _ in balls]) / options.voxel_m - low
    half = np.array([[radius] for _, radius in balls]) / options.voxel_m + margin
    begin = np.clip(np.floor((centers - half).min(axis=0)).astype(int), 0, field.distance.shape)
    end = np.clip(np.ceil((centers + half).max(axis=0)).astype(int) + 1, 0, field.distance.shape)
    if (begin >= end).any():
        return field
    first, last = begin - margin, end + margin
    near = index[((index >= first) & (index < last)).all(axis=1)] - first
    distance = field.distance.copy()
    changed = _transform(near, last - first, options)[(slice(margin, -margin),) * 3]
    distance[tuple(slice(a, b) for a, b in zip(begin, end, strict=True))] = changed
    distance.flags.writeable = False
    return replace(field, distance=distance, point_count=int(keep.sum()))


def _counts(points: Array, options: DistanceFieldOptions) -> Array:
    """Which points are finite and in the region, (m,) bool."""
    inside = ((points >= options.lower) & (points <= options.upper)).all(axis=1)
    return np.asarray(np.isfinite(points).all(axis=1)) & inside


def _transform(index: Array, shape: Array, options: DistanceFieldOptions) -> Array:
    """Distances (m, float32, cut at the reach) from occupied voxels `index` (m, 3) on a grid of `shape`."""
    from grape.planning._field_kernels import squared_distance_transform

    squared = np.full(tuple(shape), np.inf, dtype=np.float32)  # voxel^2
    squared[tuple(index.T)] = 0.0
    squared_distance_transform(squared)
    np.sqrt(squared, out=squared)
    squared *= np.float32(options.voxel_m)
    np.minimum(squared, np.float32(options.reach_m), out=squared)
    squared.flags.writeable = False
    return squared
