"""Compiled kernels of the spur extraction; imported only where they run, since numba is slow to load."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

BINS = 70
BIN_M = 0.006
BACK_M = 0.20  # the first bin lies this far behind the centre


@njit(cache=True)
def lateral_frame(direction, view):  # type: ignore[no-untyped-def]
    """Unit vectors across the axis: lateral (across the view) and depth (along the view)."""
    along = dot(view, direction)
    depth = view - along * direction
    if dot(depth, depth) < 0.0025:  # looking along the axis: any direction across it will do
        depth = np.array([0.0, direction[2], -direction[1]])
    depth /= math.sqrt(dot(depth, depth))
    lateral = np.empty(3)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        lateral[k] = direction[i] * depth[j] - direction[j] * depth[i]
    return lateral, depth


@njit(cache=True)
def dot(a, b):  # type: ignore[no-untyped-def]
    """Scalar product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def middle(values, n):  # type: ignore[no-untyped-def]
    """Upper median of the positive ones among the first n values; 0 when there are none."""
    ordered = np.sort(values[:n])
    first = 0
    while first < n and ordered[first] <= 0:
        first += 1
    return ordered[(first + n) // 2] if first < n else 0.0


@njit(cache=True)
def put_in_order(values):  # type: ignore[no-untyped-def]
    """Sorts (n,) in place; by insertion, which is quicker than numba's sort up to some hundred values."""
    if len(values) > 200:
        values.sort()
        return
    for i in range(1, len(values)):
        value, at = values[i], i
        while at > 0 and values[at - 1] > value:
            values[at] = values[at - 1]
            at -= 1
        values[at] = value


@njit(cache=True)
def bin_widths(lateral, bins, inside):  # type: ignore[no-untyped-def]
    """(BINS,) width of the points `inside` of each bin: 2.2 times the 85th percentile about their median."""
    widths = np.zeros(BINS)
    count = np.zeros(BINS, np.int64)
    for i in range(len(bins)):
        if inside[i]:
            count[bins[i]] += 1
    start = np.zeros(BINS + 1, np.int64)
    for b in range(BINS):
        start[b + 1] = start[b] + count[b]
        count[b] = 0
    grouped = np.empty(start[BINS])
    for i in range(len(bins)):
        if inside[i]:
            grouped[start[bins[i]] + count[bins[i]]] = lateral[i]
            count[bins[i]] += 1
    for b in range(BINS):
        n = count[b]
        if n >= 4:
            values = grouped[start[b] : start[b + 1]]
            put_in_order(values)
            centre = values[n // 2]
            for i in range(n):
                values[i] = abs(values[i] - centre)
            put_in_order(values)
            widths[b] = 2.2 * values[min(int(0.85 * n), n - 1)]
    return widths


@njit(cache=True)
def extent(count, widths):  # type: ignore[no-untyped-def]
    """(lowest, highest) bin of the stem: up until it thins out, down until a gap or until it turns much wider."""
    centre = int(BACK_M / BIN_M)
    start, reach = -1, 99
    for i in range(centre - 3, centre + 4):
        if count[i] > 0 and abs(i - centre) < reach:
            start, reach = i, abs(i - centre)
    if start < 0:
        return -1, -1
    floor = max(2.0, 0.2 * middle(count[start - 4 :], 7))
    top, missed = start, 0
    for i in range(start + 1, BINS - 1):
        if count[i] >= floor:
            top, missed = i, 0
        else:
            missed += 1
            if missed >= 2:
                break
    stem = middle(widths[max(top - 8, 0) :], min(top, 8) + 1)
    if stem == 0.0:
        stem = 0.01
    bottom, missed, wide = start, 0, 0
    for i in range(start, 0, -1):
        if count[i] == 0:
            missed += 1
            if missed >= 3:
                break
            continue
        missed = 0
        if widths[i] > max(1.75 * stem, stem + 0.006):
            wide += 1
            if wide >= 4:
                bottom = i + 4
                break
        else:
            wide, bottom = 0, i
    return min(bottom, top), top


@njit(cache=True)
def main_axis(points, member, guess):  # type: ignore[no-untyped-def]
    """Mean and main axis (3,) of the member points, the axis by power iteration from a guess that points along it."""
    x, y, z, n = 0.0, 0.0, 0.0, 0
    for i in range(len(points)):
        if member[i]:
            n += 1
            x, y, z = x + points[i, 0], y + points[i, 1], z + points[i, 2]
    x, y, z = x / n, y / n, z / n
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(points)):
        if member[i]:
            a, b, c = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
            xx, xy, xz, yy, yz, zz = xx + a * a, xy + a * b, xz + a * c, yy + b * b, yz + b * c, zz + c * c
    a, b, c = guess[0], guess[1], guess[2]
    for _ in range(50):
        u, v, w = xx * a + xy * b + xz * c, xy * a + yy * b + yz * c, xz * a + yz * b + zz * c
        length = math.sqrt(max(u * u + v * v + w * w, 1e-300))
        a, b, c = u / length, v / length, w / length
    axis = np.array([a, b, c])
    if dot(axis, guess) < 0:
        axis = -axis
    return np.array([x, y, z]), axis


@njit(cache=True)
def grow(points, tip, direction, view, lateral_m, depth_m, wide_m, iterations):  # type: ignore[no-untyped-def]
    """Refits the axis of the stem at a tip guess.

    Args:
        points: (n, 3) m around the tip.
        tip, direction, view: (3,), direction and view of length 1.
        lateral_m, depth_m: a point belongs to the stem when it is this near to its axis across and along the view.
        wide_m: lateral half-width in which the stem's width is measured.

    Returns:
        rows tip, base, direction (3, 3), members (n,) bool; no member where the fit failed.
    """
    n = len(points)
    result = np.zeros((3, 3))
    member, box, none = np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    bins, lateral = np.zeros(n, np.int64), np.zeros(n)
    centre, widest = tip - 0.03 * direction, max(lateral_m, wide_m)
    for _ in range(iterations):
        lateral_axis, depth_axis = lateral_frame(direction, view)
        count = np.zeros(BINS)
        (ax, ay, az), (lx, ly, lz), (dx, dy, dz) = direction, lateral_axis, depth_axis
        cx, cy, cz = centre
        for i in range(n):
            x, y, z = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
            member[i] = box[i] = False
            lateral[i], depth = x * lx + y * ly + z * lz, abs(x * dx + y * dy + z * dz)
            if abs(lateral[i]) >= widest or depth >= 1.5 * depth_m:
                continue
            bins[i] = math.floor((x * ax + y * ay + z * az + BACK_M) / BIN_M)
            if bins[i] < 0 or bins[i] >= BINS:
                continue
            box[i] = abs(lateral[i]) < wide_m
            member[i] = abs(lateral[i]) < lateral_m and depth < depth_m
            if member[i]:
                count[bins[i]] += 1
        bottom, top = extent(count, bin_widths(lateral, bins, box))
        total = 0
        for i in range(n):
            member[i] = member[i] and bins[i] >= bottom and bins[i] <= top
            total += member[i]
        if top < 0 or total < 10:
            return result, none
        mean, axis = main_axis(points, member, direction)
        position, filled, origin = np.empty(total), 0, dot(mean, axis)
        for i in range(n):
            if member[i]:
                position[filled] = points[i, 0] * axis[0] + points[i, 1] * axis[1] + points[i, 2] * axis[2] - origin
                filled += 1
        position.sort()
        result[0] = mean + axis * position[min(int(0.995 * total), total - 1)]
        result[1] = mean + axis * position[int(0.005 * total)]
        result[2] = axis
        direction, centre = axis, result[0] - 0.03 * axis
    return result, member


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
