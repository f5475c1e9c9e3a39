"""Scans as points, scans that a map predicts, and maps from scans with known poses.

Source: Thrun, Burgard and Fox, Probabilistic Robotics, 2005, table 9.1 (log odds).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.mapping.occupancy import OccupancyGrid
from grape.mapping.planar import compose, transform_points
from grape.messages import Array, LaserScan
from grape.navigation.grid import GridSpec


@dataclass(frozen=True, kw_only=True)
class GridOptions:
    """How beams become occupancy.

    `hit` and `miss` are log odds a scan; a cell's log odds stay within `limit`. A cell that fewer than `least_hits`
    scans have hit is 50 per cent occupied at most: in open ground a single beam that ended at a weed or at somebody who
    walked by is cleared by no other. Hits beyond `max_range` m are not
    marked. Beams without return clear `clear_misses` m: 0 where black or glass surfaces return nothing.
    """

    resolution: float = 0.05
    max_range: float = 30.0
    clear_misses: float = 0.0
    hit: float = 0.9
    miss: float = 0.4
    limit: float = 5.0
    least_hits: int = 2
    margin: float = 1.0  # m around everything seen


def scan_ends(scan: LaserScan, max_range: float, mount: Array | None = None, most: int | None = None) -> Array:
    """Points (n, 2) m in the robot's frame where beams shorter than `max_range` end; `mount` (3,) is the laser's.

    Of more than `most` of them so many, evenly chosen.
    """
    from grape.mapping.beam_kernels import beam_ends

    most = len(scan.ranges) if most is None else most
    points = beam_ends(scan.ranges, scan.angle_min, scan.angle_increment, scan.range_min, max_range, most)
    return points if mount is None else transform_points(mount, points)


def thinned(points: Array, spacing: float) -> Array:
    """One of the points (n, 2) for each cell of `spacing` m, in their order."""
    if not len(points):
        return points
    _, first = np.unique(np.floor(points / spacing).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


def grid_from_scans(
    scans: Sequence[LaserScan], poses: Array, mount: Array | None = None, options: GridOptions | None = None
) -> OccupancyGrid:
    """The occupancy grid of scans taken by a robot at known poses (n, 3) x y yaw.

    Raises:
        InvalidInput: not as many poses as scans, or no scan sees anything.
    """
    from grape.mapping.beam_kernels import mark_scan

    options = options or GridOptions()
    poses = np.asarray(poses, float)
    if poses.shape != (len(scans), 3) or not np.isfinite(poses).all():
        raise InvalidInput(f"finite poses ({len(scans)}, 3) needed, got {poses.shape}")
    sensors = compose(poses, np.zeros(3) if mount is None else mount)
    beams = [_beams(scan, sensor, options) for scan, sensor in zip(scans, sensors, strict=True)]
    ends = np.vstack([end for end, _ in beams]) if beams else np.zeros((0, 2))
    if not len(ends):
        raise InvalidInput("no beam of any scan ends within max_range")
    spec = GridSpec.around(np.vstack([ends, sensors[:, :2]]), options.margin, options.resolution)
    log_odds = np.zeros((spec.rows, spec.columns), np.float32)
    hits, visited = np.zeros((2, spec.rows, spec.columns), np.int32)
    gains = (options.hit, options.miss, options.limit)
    for number, (sensor, (end, hit)) in enumerate(zip(sensors, beams, strict=True), 1):
        mark_scan(log_odds, hits, visited, number, spec.origin, spec.resolution, sensor[:2].copy(), end, hit, *gains)
    log_odds[hits < options.least_hits] = np.minimum(log_odds[hits < options.least_hits], 0.0)
    percent = np.rint(100.0 / (1.0 + np.exp(-log_odds))).astype(np.int8)
    return OccupancyGrid(spec=spec, occupancy=np.where(visited > 0, percent, -1).astype(np.int8))


def predicted_ranges(grid: OccupancyGrid, sensors: Array, angles: Array, max_range: float = 30.0) -> Array:
    """Ranges (n, m) m that lasers at (n, 3) x y yaw in map would read along angles (m,); inf where nothing is hit."""
    from grape.mapping.beam_kernels import cast_beams

    sensors = np.ascontiguousarray(np.atleast_2d(sensors), float)
    angles = np.ascontiguousarray(angles, float)
    return cast_beams(grid.occupied(), grid.spec.origin, grid.spec.resolution, sensors, angles, max_range)


def _beams(scan: LaserScan, sensor: Array, options: GridOptions) -> tuple[Array, Array]:
    angles = scan.angle_min + scan.angle_increment * np.arange(scan.ranges.size) + sensor[2]
    hit = np.isfinite(scan.ranges) & (scan.ranges > scan.range_min) & (scan.ranges < options.max_range)
    far = (scan.ranges >= options.max_range) & (options.clear_misses > 0.0)
    r = np.where(hit, scan.ranges, options.clear_misses)[hit | far]
    a = angles[hit | far]
    return sensor[:2] + np.column_stack([r * np.cos(a), r * np.sin(a)]), hit[hit | far]
