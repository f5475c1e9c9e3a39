"""Clouds from a moving 2-D LiDAR: assembly through stamped poses, smoothing over neighbouring beams, range bias."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import interpolate_many, is_pose
from grape.messages import Array, LaserScan, frozen_array
from grape.perception.checks import as_points


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Returns of a moving LiDAR in one fixed frame; row i of every array belongs to one return.

    points (n, 3) m; origins (n, 3) m, where the sensor was; ranges (n,) m; scan and beam (n,) indices.
    """

    points: Array
    origins: Array
    ranges: Array
    scan: Array
    beam: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            value = frozen_array(getattr(self, field.name))
            if len(value) != len(self.points):
                raise InvalidInput(f"Sweep.{field.name} has {len(value)} rows, points has {len(self.points)}")
            object.__setattr__(self, field.name, value)

    @property
    def directions(self) -> Array:
        """(n, 3) unit vectors along the beams."""
        return (self.points - self.origins) / self.ranges[:, None]

    def with_ranges(self, ranges: Array, keep: Array | None = None) -> Sweep:
        """The same beams with other ranges (n,), optionally only the rows in `keep` (n,) bool."""
        keep = np.ones(len(self.points), bool) if keep is None else keep
        points = self.origins + self.directions * ranges[:, None]
        values = (points, self.origins, ranges, self.scan, self.beam)
        return Sweep(**{f.name: v[keep] for f, v in zip(fields(self), values, strict=True)})


@dataclass(frozen=True, kw_only=True)
class AssembleOptions:
    """Which returns are kept: ranges in (near, far) m, and bearings in (low, high) rad of the sensor frame."""

    range_m: tuple[float, float] = (0.05, 1.5)
    bearing_rad: tuple[float, float] = (-np.pi, np.pi)

    def __post_init__(self) -> None:
        if not 0 <= self.range_m[0] < self.range_m[1] or not self.bearing_rad[0] < self.bearing_rad[1]:
            raise InvalidInput(f"ranges and bearings must rise, got {self.range_m} and {self.bearing_rad}")


def assemble(
    scans: Sequence[LaserScan],
    T_map_lidar: Sequence[Array],
    options: AssembleOptions | None = None,
    *,
    T_map_lidar_end: Sequence[Array] | None = None,
) -> Sweep:
    """Puts scans into one frame.

    Args:
        scans: in the order they were taken.
        T_map_lidar: pose of the sensor in the fixed frame at each scan's stamp (its first beam).
        T_map_lidar_end: pose at each scan's last beam; when given, every beam gets its own pose between the two
            (deskewing). None takes a scan as an instant.

    Raises:
        InvalidInput: as many poses as scans are needed, and each must be a pose.
    """
    options = options or AssembleOptions()
    ends = T_map_lidar if T_map_lidar_end is None else T_map_lidar_end
    if not len(scans) == len(T_map_lidar) == len(ends):
        raise InvalidInput(f"{len(scans)} scans need as many poses, got {len(T_map_lidar)} and {len(ends)}")
    parts = [_one_scan(k, s, a, b, options) for k, (s, a, b) in enumerate(zip(scans, T_map_lidar, ends, strict=True))]
    if not parts:
        parts = [(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0, int), np.empty(0, int))]
    joined = [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]
    return Sweep(**{f.name: v for f, v in zip(fields(Sweep), joined, strict=True)})


def _one_scan(k: int, scan: LaserScan, T_start: Array, T_end: Array, options: AssembleOptions) -> tuple[Array, ...]:
    if not (is_pose(T_start) and is_pose(T_end)):
        raise InvalidInput(f"the pose of scan {k} is not a 4 x 4 pose")
    ranges = np.asarray(scan.ranges, dtype=np.float64)
    if ranges.ndim != 1:
        raise InvalidInput(f"scan {k}: ranges must have shape (n,), got {ranges.shape}")
    bearing = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    near, far = max(options.range_m[0], scan.range_min), min(options.range_m[1], scan.range_max)
    with np.errstate(invalid="ignore"):
        keep = np.isfinite(ranges) & (ranges >= near) & (ranges <= far)
    beam = np.nonzero(keep & (bearing >= options.bearing_rad[0]) & (bearing <= options.bearing_rad[1]))[0]
    r, a = ranges[beam], bearing[beam]
    local = np.column_stack([r * np.cos(a), r * np.sin(a), np.zeros(len(r))])
    if T_end is T_start or np.array_equal(T_start, T_end):
        origins = np.tile(T_start[:3, 3], (len(r), 1))
        points = local @ T_start[:3, :3].T + T_start[:3, 3]
    else:
        T = interpolate_many(T_start, T_end, beam / max(len(ranges) - 1, 1))
        origins = T[:, :3, 3]
        points = np.einsum("nij,nj->ni", T[:, :3, :3], local) + origins
    return points, origins, r, np.full(len(r), k), beam


@dataclass(frozen=True, kw_only=True)
class SmoothOptions:
    """Averaging of a sweep over neighbouring scans and beams.

    Args:
        scans, beams: half-size of the window.
        gate_m: returns whose ranges differ by more belong to another surface; noise and slanting surfaces need room.
        neighbours: returns with fewer neighbours (3 x 5 window, 0.6 of the gate) are dropped as mixed pixels.
    """

    scans: int = 1
    beams: int = 2
    gate_m: float = 0.03
    neighbours: int = 4

    def __post_init__(self) -> None:
        if self.scans < 0 or self.beams < 0 or self.gate_m <= 0 or self.neighbours < 0:
            raise InvalidInput(f"windows must not be negative and the gate positive, got {self}")


def smooth_sweep(sweep: Sweep, options: SmoothOptions | None = None) -> Sweep:
    """The sweep with ranges averaged over neighbours on the same surface, lone returns dropped.

    Thin stems keep their outline: only ranges change, never directions.
    """
    options = options or SmoothOptions()
    if len(sweep.points) == 0:
        return sweep
    scan, beam = sweep.scan - sweep.scan.min(), sweep.beam - sweep.beam.min()
    grid = np.full((scan.max() + 1, beam.max() + 1), np.nan)
    grid[scan, beam] = sweep.ranges
    smooth = grid
    for _ in range(2):  # the second pass gates on the first average, which is less noisy
        smooth = _windowed_mean(grid, smooth, options)
    count = _neighbours(smooth, 1, 2, 0.6 * options.gate_m)
    return sweep.with_ranges(smooth[scan, beam], (count >= options.neighbours)[scan, beam])


def _offsets(grid: Array, rows: int, columns: int) -> list[Array]:
    """The grid moved by every offset of a window, NaN where nothing is."""
    padded = np.pad(grid, ((rows, rows), (columns, columns)), constant_values=np.nan)
    h, w = grid.shape
    return [padded[i : i + h, j : j + w] for i in range(2 * rows + 1) for j in range(2 * columns + 1)]


def _windowed_mean(values: Array, reference: Array, options: SmoothOptions) -> Array:
    total, count = np.zeros(values.shape), np.zeros(values.shape)
    windows = (_offsets(array, options.scans, options.beams) for array in (values, reference))
    for value, other in zip(*windows, strict=True):
        near = np.abs(other - reference) < options.gate_m  # NaN compares as false
        total += np.where(near, value, 0.0)
        count += near
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _neighbours(grid: Array, rows: int, columns: int, gate_m: float) -> Array:
    return sum(np.abs(other - grid) < gate_m for other in _offsets(grid, rows, columns)) - np.isfinite(grid).astype(int)


@dataclass(frozen=True, kw_only=True)
class BiasOptions:
    """How a LiDAR's constant range error is found against a cloud of another sensor.

    Args:
        search_m: largest error that is looked for.
        step_m: step of the search.
        gate_m: a return matches when a cloud point is this near.
        samples: returns that are used, evenly spread.
        min_matches: fewer matching returns are no estimate.
    """

    search_m: float = 0.10
    step_m: float = 0.005
    gate_m: float = 0.015
    samples: int = 3000
    min_matches: int = 50

    def __post_init__(self) -> None:
        if min(self.search_m, self.step_m, self.gate_m) <= 0 or self.samples < 1 or self.min_matches < 1:
            raise InvalidInput(f"bias options must be positive, got {self}")


def range_bias(sweep: Sweep, cloud: Array, options: BiasOptions | None = None) -> float | None:
    """The constant to subtract from the sweep's ranges so that it lies on `cloud`; None without enough overlap.

    A coarse search takes the shift along the beams with which most returns meet the cloud; the median of their
    remaining along-beam differences refines it.

    Args:
        sweep: LiDAR returns.
        cloud: (n, 3) m of a sensor without that error (depth camera), same frame.

    Raises:
        InvalidInput: a cloud of another shape.
    """
    options = options or BiasOptions()
    cloud = as_points(cloud, "cloud")
    if len(cloud) == 0 or len(sweep.points) == 0:
        return None
    from scipy.spatial import cKDTree

    tree = cKDTree(cloud)
    pick = np.linspace(0, len(sweep.points) - 1, min(options.samples, len(sweep.points))).astype(int)
    points, rays = sweep.points[pick], sweep.directions[pick]

    def matches(bias: float) -> tuple[Array, Array]:
        return tree.query(points - bias * rays, distance_upper_bound=options.gate_m)

    shifts = np.arange(-options.search_m, options.search_m + options.step_m / 2, options.step_m)
    scores = [np.maximum(0.0, 1.0 - matches(float(b))[0] / options.gate_m).sum() for b in shifts]
    bias = float(shifts[int(np.argmax(scores))])
    for _ in range(3):
        distance, index = matches(bias)
        hit = np.isfinite(distance)
        if hit.sum() < options.min_matches:
            return None
        bias += float(np.median(np.sum((points[hit] - bias * rays[hit] - cloud[index[hit]]) * rays[hit], axis=1)))
    return bias


def debias(sweep: Sweep, bias_m: float) -> Sweep:
    """The sweep with `bias_m` taken off every range; returns that end at or behind the sensor are dropped."""
    ranges = sweep.ranges - bias_m
    return sweep.with_ranges(ranges, ranges > 0)
