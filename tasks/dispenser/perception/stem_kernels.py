"""Compiled kernels that measure a fitted stem and what is about it; imported only where they run."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from grape.tasks.dispenser.perception.spur_kernels import BIN_M, BINS, dot


@njit(cache=True)
def within(points, centre, radius_m):  # type: ignore[no-untyped-def]
    """The points (n, 3) within a radius of `centre`."""
    keep, total = np.empty(len(points), np.int64), 0
    for i in range(len(points)):
        x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
        if x * x + y * y + z * z <= radius_m * radius_m:
            keep[total] = i
            total += 1
    return points[keep[:total]]


@njit(cache=True)
def beside_line(points, place, direction, radius_m):  # type: ignore[no-untyped-def]
    """The points (n, 3) within a radius of the line through `place` along `direction`."""
    keep, total = np.empty(len(points), np.int64), 0
    offset = np.empty(3)
    for i in range(len(points)):
        for k in range(3):
            offset[k] = points[i, k] - place[k]
        along = dot(offset, direction)
        if dot(offset, offset) - along * along <= radius_m * radius_m:
            keep[total] = i
            total += 1
    return points[keep[:total]]


@njit(cache=True)
def stem_width(points, tip, length_m, axes, depth_m, gap_m):  # type: ignore[no-untyped-def]
    """35th percentile over slices of the contiguous width round the axis: buds and knobs are left out; 0 without any.

    Args: tip: (3,) m, `length_m` over the base; axes: (3, 3) rows direction, lateral, depth; depth_m: of points
        that count, along the view; gap_m: a lateral gap this wide ends the stem.
    """
    n = len(points)
    slices, lateral, offset = np.full(n, -1, np.int64), np.empty(n), np.empty(3)
    for i in range(n):
        for k in range(3):
            offset[k] = points[i, k] - tip[k]
        along = -dot(offset, axes[0])
        lateral[i] = dot(offset, axes[1])
        if (
            along > 0.004
            and along < length_m - BIN_M
            and abs(lateral[i]) < 0.035
            and abs(dot(offset, axes[2])) < depth_m
        ):
            slices[i] = int(along / BIN_M)
    widths, total = np.empty(BINS), 0
    for b in range(min(BINS, int(length_m / BIN_M) + 1)):
        values = np.sort(lateral[slices == b])
        if len(values) < 4:
            continue
        low = int(np.argmin(np.abs(values)))
        high = low
        while low > 0 and values[low] - values[low - 1] <= gap_m:
            low -= 1
        while high < len(values) - 1 and values[high + 1] - values[high] <= gap_m:
            high += 1
        if values[high] > values[low]:
            widths[total] = values[high] - values[low]
            total += 1
    return np.percentile(widths[:total], 35) if total > 0 else 0.0


@njit(cache=True)
def thickness_below(points, base, axes, depth_m):  # type: ignore[no-untyped-def]
    """Width (m) of what is round the spur's base: twice the 85th percentile of the lateral distance."""
    values, total, offset = np.empty(len(points)), 0, np.empty(3)
    for i in range(len(points)):
        for k in range(3):
            offset[k] = points[i, k] - base[k]
        along, lateral = dot(offset, axes[0]), abs(dot(offset, axes[1]))
        if along > -0.035 and along < 0.012 and lateral < 0.05 and abs(dot(offset, axes[2])) < depth_m:
            values[total] = lateral
            total += 1
    return 2.0 * np.percentile(values[:total], 85) if total > 4 else 0.0


@njit(cache=True)
def count_around(points, tip, base, direction):  # type: ignore[no-untyped-def]
    """Points beyond the tip, below the base and beside the upper spur."""
    beyond, below, beside = 0, 0, 0
    length = math.sqrt(dot(tip - base, tip - base))
    from_tip, from_base = np.empty(3), np.empty(3)
    for i in range(len(points)):
        for k in range(3):
            from_tip[k], from_base[k] = points[i, k] - tip[k], points[i, k] - base[k]
        s, s_base = dot(from_tip, direction), dot(from_base, direction)
        radius = math.sqrt(max(dot(from_tip, from_tip) - s * s, 0.0))
        radius_base = math.sqrt(max(dot(from_base, from_base) - s_base * s_base, 0.0))
        beyond += s > 0.008 and s < 0.05 and radius < 0.015 + 0.2 * s
        below += s_base < -0.002 and s_base > -0.035 and radius_base < 0.04
        beside += s < 0 and s > -0.6 * length and radius > 0.016 and radius < 0.045
    return beyond, below, beside


@njit(cache=True)
def count_in_way(points, tip, approach, radius_m):  # type: ignore[no-untyped-def]
    """Points in a cylinder from 30 to 180 mm from the tip along `approach`."""
    total, offset = 0, np.empty(3)
    for i in range(len(points)):
        for k in range(3):
            offset[k] = points[i, k] - tip[k]
        s = dot(offset, approach)
        total += s > 0.03 and s < 0.18 and dot(offset, offset) - s * s < radius_m * radius_m
    return total
