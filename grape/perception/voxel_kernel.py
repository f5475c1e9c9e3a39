"""Compiled kernel of the voxel grid; imported only where a grid is built, since numba is slow to load."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def accumulate(points, voxel_m):  # type: ignore[no-untyped-def]
    """Sums and counts of the points of each cell by an open-addressing hash table.

    Args:
        points: (n, 3) float64 m.
        voxel_m: edge of a cell.

    Returns:
        sums (m, 3), counts (m,), in the order in which the cells are first met.
    """
    n = len(points)
    size = 1
    while size < 2 * n:
        size *= 2
    table = np.full(size, -1, np.int32)  # slot -> row of the output
    keys = np.empty((n, 3), np.int64)
    sums = np.zeros((n, 3))
    counts = np.zeros(n, np.int64)
    m = 0
    for i in range(n):
        x, y = math.floor(points[i, 0] / voxel_m), math.floor(points[i, 1] / voxel_m)
        z = math.floor(points[i, 2] / voxel_m)
        slot = (x * 73856093 ^ y * 19349669 ^ z * 83492791) & (size - 1)
        row = table[slot]
        while row >= 0 and not (keys[row, 0] == x and keys[row, 1] == y and keys[row, 2] == z):
            slot = (slot + 1) & (size - 1)
            row = table[slot]
        if row < 0:
            row = m
            table[slot] = m
            keys[m, 0], keys[m, 1], keys[m, 2] = x, y, z
            m += 1
        for k in range(3):
            sums[row, k] += points[i, k]
        counts[row] += 1
    return sums[:m], counts[:m]
