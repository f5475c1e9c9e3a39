"""Compiled kernels of the spur extraction; imported only where they run, since numba is slow to load."""

from __future__ import annotations

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
            limit = 2.2 * np.median(values) + 1
        if n > 10 and width[row, column] > limit:
            break
    return path[:n]


@njit(cache=True)
def lateral_frame(direction, view):  # type: ignore[no-untyped-def]
    """Unit vectors across the axis: lateral (across the view) and depth (along the view)."""
    depth = view - direction * np.dot(view, direction)
    if np.linalg.norm(depth) < 0.05:
        depth = np.cross(direction, np.array([1.0, 0.0, 0.0]))
    depth /= np.linalg.norm(depth)
    return np.cross(direction, depth), depth


@njit(cache=True)
def bin_widths(lateral, bins):  # type: ignore[no-untyped-def]
    """(BINS,) width of the points of each bin: 2.2 times the 85th percentile about their median, 0 below 4 points."""
    widths = np.zeros(BINS)
    order = np.argsort(bins)
    k = 0
    while k < len(order):
        b = bins[order[k]]
        end = k
        while end < len(order) and bins[order[end]] == b:
            end += 1
        if end - k >= 4:
            values = lateral[order[k:end]].copy()
            spread = np.sort(np.abs(values - np.median(values)))
            widths[b] = 2.2 * spread[min(int(0.85 * len(spread)), len(spread) - 1)]
        k = end
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
    near = count[start - 4 : start + 3]
    floor = max(2.0, 0.2 * np.median(near[near > 0]))
    top, missed = start, 0
    for i in range(start + 1, BINS - 1):
        if count[i] >= floor:
            top, missed = i, 0
        else:
            missed += 1
            if missed >= 2:
                break
    upper = widths[max(top - 8, 0) : top + 1]
    upper = upper[upper > 0]
    stem = np.median(upper) if len(upper) else 0.01
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
    result = np.zeros((3, 3))
    none = np.zeros(len(points), np.bool_)
    centre = tip - 0.03 * direction
    for _ in range(iterations):
        lateral_axis, depth_axis = lateral_frame(direction, view)
        away = points - centre
        along, lateral, depth = away @ direction, away @ lateral_axis, away @ depth_axis
        bins = np.floor((along + BACK_M) / BIN_M).astype(np.int64)
        ranged = (bins >= 0) & (bins < BINS)
        stem = ranged & (np.abs(lateral) < lateral_m) & (np.abs(depth) < depth_m)
        count = np.zeros(BINS)
        for b in bins[stem]:
            count[b] += 1
        box = ranged & (np.abs(lateral) < wide_m) & (np.abs(depth) < 1.5 * depth_m)
        bottom, top = extent(count, bin_widths(lateral[box], bins[box]))
        if top < 0:
            return result, none
        member = stem & (bins >= bottom) & (bins <= top)
        if member.sum() < 10:
            return result, none
        chosen = points[member]
        mean = np.array([chosen[:, 0].mean(), chosen[:, 1].mean(), chosen[:, 2].mean()])
        offset = chosen - mean
        _, vectors = np.linalg.eigh(offset.T @ offset)
        axis = np.ascontiguousarray(vectors[:, 2])
        if np.dot(axis, direction) < 0:
            axis = -axis
        position = offset @ axis
        result[0] = mean + axis * np.percentile(position, 99.5)
        result[1] = mean + axis * np.percentile(position, 0.5)
        result[2] = axis
        direction, centre = axis, result[0] - 0.03 * axis
    return result, member
