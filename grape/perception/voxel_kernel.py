"""Compiled kernel of the voxel grid; imported only where a grid is built, since numba is slow to load."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def accumulate(cells, points):  # type: ignore[no-untyped-def]
    """Sums and counts of the points of each cell by an open-addressing hash table.

    Args:
        cells: (n, 3) int64 cell indices.
        points: (n, 3) float64 m.

    Returns:
        sums (m, 3), counts (m,), in the order in which the cells are first met.
    """
    n = cells.shape[0]
    size = 1
    while size < 2 * n:
        size *= 2
    table = np.full(size, -1, np.int64)  # slot -> row of the output
    keys = np.empty((n, 3), np.int64)
    sums = np.zeros((n, 3))
    counts = np.zeros(n, np.int64)
    m = 0
    for i in range(n):
        x, y, z = cells[i, 0], cells[i, 1], cells[i, 2]
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
