"""Compiled search for near points through a hashed grid; imported only where it runs, since numba is slow to load."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_OFFSET = 1 << 20  # cells are counted from here, so that keys stay positive


@njit(cache=True)
def _key(x, y, z):  # type: ignore[no-untyped-def]
    return ((x + _OFFSET) << 42) | ((y + _OFFSET) << 21) | (z + _OFFSET)


@njit(cache=True)
def _slot(key, size):  # type: ignore[no-untyped-def]
    mixed = (key >> 42) * 73856093 ^ ((key >> 21) & 0x1FFFFF) * 19349669 ^ (key & 0x1FFFFF) * 83492791
    return mixed & (size - 1)


@njit(cache=True)
def into_cells(points, cell_m):  # type: ignore[no-untyped-def]
    """Sorts points (n, 3) by the cell of a grid that they lie in.

    Returns:
        order (n,) of the points, their cells' keys (n,) in that order, start (size + 1,) of each slot of the table.
    """
    n = len(points)
    size = 1
    while size < 2 * n:
        size *= 2
    keys, slots = np.empty(n, np.int64), np.empty(n, np.int64)
    start = np.zeros(size + 1, np.int64)
    for i in range(n):
        x, y = math.floor(points[i, 0] / cell_m), math.floor(points[i, 1] / cell_m)
        keys[i] = _key(x, y, math.floor(points[i, 2] / cell_m))
        slots[i] = _slot(keys[i], size)
        start[slots[i] + 1] += 1
    for s in range(size):
        start[s + 1] += start[s]
    filled = start.copy()
    order, sorted_keys = np.empty(n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        at = filled[slots[i]]
        order[at], sorted_keys[at] = i, keys[i]
        filled[slots[i]] += 1
    return order, sorted_keys, start


@njit(cache=True)
def _around(key, keys, start, found):  # type: ignore[no-untyped-def]
    """The sorted rows of the points in the 27 cells round the cell `key`, written into `found`, and their number."""
    size, n = len(start) - 1, 0
    x, y, z = (key >> 42) - _OFFSET, ((key >> 21) & 0x1FFFFF) - _OFFSET, (key & 0x1FFFFF) - _OFFSET
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                other = _key(x + dx, y + dy, z + dz)
                slot = _slot(other, size)
                for at in range(start[slot], start[slot + 1]):
                    if keys[at] == other:
                        if n == len(found):
                            longer = np.empty(2 * n, np.int64)
                            longer[:n] = found
                            found = longer
                        found[n] = at
                        n += 1
    return found, n


@njit(cache=True)
def crowded(points, radius_m, neighbours):  # type: ignore[no-untyped-def]
    """(n,) bool: points (n, 3) with at least so many others within a radius."""
    order, keys, start = into_cells(points, radius_m)
    moved = points[order]
    result = np.zeros(len(points), np.bool_)
    found, n = np.empty(256, np.int64), 0
    limit = radius_m * radius_m
    for at in range(len(points)):
        if at == 0 or keys[at] != keys[at - 1]:
            found, n = _around(keys[at], keys, start, found)
        count = -1  # the point itself
        for k in range(n):
            x, y = moved[found[k], 0] - moved[at, 0], moved[found[k], 1] - moved[at, 1]
            z = moved[found[k], 2] - moved[at, 2]
            if x * x + y * y + z * z <= limit:
                count += 1
                if count >= neighbours:
                    result[order[at]] = True
                    break
    return result


@njit(cache=True)
def nearest(points, radius_m, neighbours):  # type: ignore[no-untyped-def]
    """Indices (n, k) of the nearest other points within a radius, -1 where there are fewer, and distances (n, k)."""
    order, keys, start = into_cells(points, radius_m)
    moved = points[order]
    index = np.full((len(points), neighbours), -1, np.int64)
    distance = np.full((len(points), neighbours), np.inf)
    found, n = np.empty(256, np.int64), 0
    squares, rows = np.empty(neighbours), np.empty(neighbours, np.int64)
    for at in range(len(points)):
        if at == 0 or keys[at] != keys[at - 1]:
            found, n = _around(keys[at], keys, start, found)
        filled, limit = 0, radius_m * radius_m
        for k in range(n):
            x, y = moved[found[k], 0] - moved[at, 0], moved[found[k], 1] - moved[at, 1]
            z = moved[found[k], 2] - moved[at, 2]
            square = x * x + y * y + z * z
            if square > limit or found[k] == at:
                continue
            place = min(filled, neighbours - 1)
            while place > 0 and squares[place - 1] > square:
                squares[place], rows[place] = squares[place - 1], rows[place - 1]
                place -= 1
            squares[place], rows[place] = square, found[k]
            filled = min(filled + 1, neighbours)
            if filled == neighbours:
                limit = squares[neighbours - 1]
        for k in range(filled):
            index[order[at], k], distance[order[at], k] = order[rows[k]], math.sqrt(squares[k])
    return index, distance
