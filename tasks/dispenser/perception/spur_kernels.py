"""Compiled kernels of the spur extraction; imported only where they run, since numba is slow to load."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

BINS = 70
BIN_M = 0.006
BACK_M = 0.20  # the first bin lies this far behind the centre


@njit(cache=True)
def thin(image):  # type: ignore[no-untyped-def]
    """Zhang and Suen's thinning (1984), in place: image (h, w) uint8 of 0 and 1 with an empty border."""
    h, w = image.shape
    remove = np.zeros((h, w), np.uint8)
    changed = True
    ring = np.empty(8, np.int64)
    while changed:
        changed = False
        for phase in range(2):
            for i in range(1, h - 1):
                for j in range(1, w - 1):
                    if image[i, j] == 0:
                        continue
                    ring[0], ring[1], ring[2] = image[i - 1, j], image[i - 1, j + 1], image[i, j + 1]
                    ring[3], ring[4], ring[5] = image[i + 1, j + 1], image[i + 1, j], image[i + 1, j - 1]
                    ring[6], ring[7] = image[i, j - 1], image[i - 1, j - 1]
                    total, rises = 0, 0
                    for k in range(8):
                        total += ring[k]
                        rises += ring[k] == 0 and ring[(k + 1) % 8] == 1
                    if total < 2 or total > 6 or rises != 1:
                        continue
                    n, e, s, west = ring[0], ring[2], ring[4], ring[6]
                    if phase == 0:
                        remove[i, j] = n * e * s == 0 and e * s * west == 0
                    else:
                        remove[i, j] = n * e * west == 0 and n * s * west == 0
            for i in range(h):
                for j in range(w):
                    if remove[i, j]:
                        image[i, j] = 0
                        remove[i, j] = 0
                        changed = True
    return image


@njit(cache=True)
def walk(skeleton, degree, width, row, column, longest):  # type: ignore[no-untyped-def]
    """Follows a skeleton from an end: (k, 2) pixels; stops at a junction or where the part widens beyond 2.2 times."""
    path = np.empty((longest, 2), np.int64)
    path[0, 0], path[0, 1] = row, column
    seen = np.zeros(skeleton.shape, np.uint8)
    seen[row, column] = 1
    n = 1
    limit = np.inf
    while n < longest:
        best, bi, bj = 9, -1, -1
        for a in range(-1, 2):
            for b in range(-1, 2):
                i, j = row + a, column + b
                if skeleton[i, j] and not seen[i, j] and abs(a) + abs(b) < best:
                    best, bi, bj = abs(a) + abs(b), i, j
        if bi < 0 or (degree[bi, bj] >= 3 and n > 8):
            break
        row, column = bi, bj
        seen[row, column] = 1
        path[n, 0], path[n, 1] = row, column
        n += 1
        if n == 10:
            values = np.empty(8)
            for k in range(8):
                values[k] = width[path[k + 2, 0], path[k + 2, 1]]
            limit = 2.2 * middle(values, 8) + 1
        if n > 10 and width[row, column] > limit:
            break
    return path[:n]


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
            values = np.sort(grouped[start[b] : start[b + 1]])
            centre = values[n // 2]
            for i in range(n):
                values[i] = abs(values[i] - centre)
            widths[b] = 2.2 * np.sort(values)[min(int(0.85 * n), n - 1)]
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
    mean, n = np.zeros(3), 0
    for i in range(len(points)):
        if member[i]:
            n += 1
            for k in range(3):
                mean[k] += points[i, k]
    mean /= n
    spread = np.zeros((3, 3))
    for i in range(len(points)):
        if member[i]:
            for k in range(3):
                for m in range(3):
                    spread[k, m] += (points[i, k] - mean[k]) * (points[i, m] - mean[m])
    axis = guess.copy()
    for _ in range(50):
        turned = np.empty(3)
        for k in range(3):
            turned[k] = dot(spread[k], axis)
        axis = turned / math.sqrt(max(dot(turned, turned), 1e-300))
    if dot(axis, guess) < 0:
        axis = -axis
    return mean, axis


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
    bins, lateral, away = np.zeros(n, np.int64), np.zeros(n), np.zeros(3)
    centre = tip - 0.03 * direction
    for _ in range(iterations):
        lateral_axis, depth_axis = lateral_frame(direction, view)
        count = np.zeros(BINS)
        for i in range(n):
            for k in range(3):
                away[k] = points[i, k] - centre[k]
            bins[i] = math.floor((dot(away, direction) + BACK_M) / BIN_M)
            lateral[i], depth = dot(away, lateral_axis), abs(dot(away, depth_axis))
            ranged = bins[i] >= 0 and bins[i] < BINS
            member[i] = ranged and abs(lateral[i]) < lateral_m and depth < depth_m
            box[i] = ranged and abs(lateral[i]) < wide_m and depth < 1.5 * depth_m
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
                position[filled] = dot(points[i], axis) - origin
                filled += 1
        position.sort()
        result[0] = mean + axis * position[min(int(0.995 * total), total - 1)]
        result[1] = mean + axis * position[int(0.005 * total)]
        result[2] = axis
        direction, centre = axis, result[0] - 0.03 * axis
    return result, member
