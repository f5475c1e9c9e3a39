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
