"""Compiled kernels of the silhouette; imported only where they run, since numba is slow to load."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from grape.tasks.dispenser.perception.spur_kernels import middle


@njit(cache=True)
def nearest_depth(local, origin, pixel_m, h, w):  # type: ignore[no-untyped-def]
    """(h, w) depth of the nearest point (n, 3) of each pixel, infinite where there is none."""
    depth = np.full((h, w), np.inf)
    for i in range(len(local)):
        column = math.floor((local[i, 0] - origin[0]) / pixel_m)
        row = math.floor((local[i, 1] - origin[1]) / pixel_m)
        depth[row, column] = min(depth[row, column], local[i, 2])
    return depth


@njit(cache=True)
def thin(image):  # type: ignore[no-untyped-def]
    """Zhang and Suen's thinning (1984), in place: image (h, w) uint8 of 0 and 1 with an empty border."""
    rows, columns = np.nonzero(image)
    left, removed = len(rows), 1
    leave = np.zeros(left, np.bool_)
    ring = np.empty(8, np.int64)
    while removed > 0:
        removed = 0
        for phase in range(2):
            for p in range(left):
                i, j = rows[p], columns[p]
                ring[0], ring[1], ring[2] = image[i - 1, j], image[i - 1, j + 1], image[i, j + 1]
                ring[3], ring[4], ring[5] = image[i + 1, j + 1], image[i + 1, j], image[i + 1, j - 1]
                ring[6], ring[7] = image[i, j - 1], image[i - 1, j - 1]
                total, rises = 0, 0
                for k in range(8):
                    total += ring[k]
                    rises += ring[k] == 0 and ring[(k + 1) % 8] == 1
                leave[p] = False
                if total < 2 or total > 6 or rises != 1:
                    continue
                n, e, s, west = ring[0], ring[2], ring[4], ring[6]
                if phase == 0:
                    leave[p] = n * e * s == 0 and e * s * west == 0
                else:
                    leave[p] = n * e * west == 0 and n * s * west == 0
            kept = 0
            for p in range(left):
                if leave[p]:
                    image[rows[p], columns[p]] = 0
                else:
                    rows[kept], columns[kept] = rows[p], columns[p]
                    kept += 1
            removed += left - kept
            left = kept
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
