"""Horizontal beams from laser scans and point clouds, without the ground and low weeds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grape.geometry import transform
from grape.messages import Array, LaserScan
from grape.navigation.costmap import Beams
from grape.navigation.grid import Footprint


@dataclass(frozen=True, kw_only=True)
class ScanOptions:
    """How far a horizontal scanner is believed.

    A plane 0.33 m above the ground meets it a few metres ahead where the ground bulges or the robot is pitched, so
    hits beyond `mark_range` do not count, nor do hits lower than `lowest` plus `rise` per metre over the level, or the
    mean ground, through the robot's feet; beams clear up to `clear_range`. Hits inside `own` are the robot itself.
    """

    mark_range: float = 4.0
    clear_range: float = 4.5
    lowest: float = 0.10
    rise: float = 0.05
    ground: float = -0.132  # z of the ground in base_link
    own: Footprint = field(default_factory=lambda: Footprint(front=0.60, rear=0.60, half_width=0.40))


@dataclass(frozen=True, kw_only=True)
class SliceOptions:
    """Which part of a cloud is an obstacle, by its height over the ground, all in metres.

    Ground is between the plane the robot stands on (right on a slope), the level through its feet (right where a bump
    tilts the robot) and the mean ground (right on the bumps of a slope): what counts is the height over the highest.
    The lowest height grows with distance by `rise` per metre, for ground that bends away from all of them.
    """

    lowest: float = 0.30
    highest: float = 1.80
    rise: float = 0.06
    ground: float = -0.132  # z of the ground in base_link
    mark_range: float = 5.0
    clear_range: float = 5.0
    bins: int = 720
    own: Footprint = field(default_factory=lambda: Footprint(front=0.65, rear=0.65, half_width=0.50))


def scan_points(scan: LaserScan, T_base_scan: Array, options: ScanOptions | None = None) -> Array:
    """Hits (n, 3) m in base_link of a scan, without the robot itself; all ranges that are valid (REP-117)."""
    options = options or ScanOptions()
    angles = scan.angle_min + scan.angle_increment * np.arange(scan.ranges.size)
    valid = np.isfinite(scan.ranges) & (scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max)
    r, a = scan.ranges[valid], angles[valid]
    points = transform(T_base_scan, np.column_stack([r * np.cos(a), r * np.sin(a), np.zeros_like(r)]))
    return points[~options.own.contains(points[:, :2])]


def beams_from_scan(
    scan: LaserScan,
    T_map_base: Array,
    T_base_scan: Array,
    options: ScanOptions | None = None,
    normal: Array | None = None,
) -> Beams:
    """Beams in map of a horizontal scan; +inf (no return) clears, NaN and -inf say nothing.

    Args:
        normal: (3,) of the mean ground in map, as of `MeanGround`.
    """
    options = options or ScanOptions()
    angles = scan.angle_min + scan.angle_increment * np.arange(scan.ranges.size)
    known = ~np.isnan(scan.ranges) & (scan.ranges >= scan.range_min)
    r, a = scan.ranges[known], angles[known]
    hit = r <= min(options.mark_range, scan.range_max)
    r = np.where(hit, r, np.minimum(r, min(options.clear_range, scan.range_max)))
    points = transform(T_base_scan, np.column_stack([r * np.cos(a), r * np.sin(a), np.zeros_like(r)]))
    floor = options.lowest + options.rise * np.hypot(points[:, 0], points[:, 1])
    ground = _height_over_feet(points, T_map_base, options.ground, normal) < floor
    keep = ~(hit & (ground | options.own.contains(points[:, :2])))
    ends = transform(T_map_base, points[keep])[:, :2]
    sensor = (T_map_base @ T_base_scan)[:2, 3]
    return Beams(sensor=sensor, ends=ends, hit=hit[keep])


def beams_from_cloud(
    points: Array,
    T_map_base: Array,
    T_base_sensor: Array,
    options: SliceOptions | None = None,
    normal: Array | None = None,
) -> Beams:
    """Beams in map of a 3-D scan: per direction the nearest thing that stands out of the ground.

    Args:
        points: (n, 3) m in the sensor frame.
        normal: (3,) of the mean ground in map, as of `MeanGround`.
    """
    options = options or SliceOptions()
    p = transform(T_base_sensor, points[np.isfinite(points).all(axis=1)])
    offset = p[:, :2] - T_base_sensor[:2, 3]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    height = np.minimum(p[:, 2] - options.ground, _height_over_feet(p, T_map_base, options.ground, normal))
    low = options.lowest + options.rise * distance
    own = options.own.contains(p[:, :2])
    stands = (height >= low) & (height <= options.highest) & ~own & (distance <= options.mark_range)
    bins = ((np.arctan2(offset[:, 1], offset[:, 0]) / (2 * np.pi) % 1.0) * options.bins).astype(int) % options.bins
    nearest = np.full(options.bins, np.inf)
    np.minimum.at(nearest, bins[stands], distance[stands])
    reach = np.full(options.bins, 0.0)
    seen = ~own
    np.maximum.at(reach, bins[seen], np.minimum(distance[seen], options.clear_range))
    hit = np.isfinite(nearest)
    used = hit | (reach > 0.0)
    r = np.where(hit, nearest, reach)[used]
    angle = (np.flatnonzero(used) + 0.5) * (2 * np.pi / options.bins)
    flat = np.column_stack([r * np.cos(angle), r * np.sin(angle), np.zeros_like(r)]) + T_base_sensor[:3, 3]
    return Beams(sensor=(T_map_base @ T_base_sensor)[:2, 3], ends=transform(T_map_base, flat)[:, :2], hit=hit[used])


def _height_over_feet(points: Array, T_map_base: Array, ground: float, normal: Array | None) -> Array:
    """(n,) m, heights of points (n, 3) in base_link over the higher of two grounds through the robot's feet: the level
    one, and the mean one, if that is known."""
    offset = points - [0.0, 0.0, ground]
    level = offset @ T_map_base[2, :3]
    return level if normal is None else np.minimum(level, offset @ (T_map_base[:3, :3].T @ normal))
