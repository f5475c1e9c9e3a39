"""Compiled search for near points through a hashed grid; imported only where it runs, since numba is slow to load."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_OFFSET = 1 << 20  # cells are counted from here, so that keys of clouds near the origin sort by place
_AXIS = (1 << 21) - 1
_NEAREST_FIRST = np.array(  # of 3 x 3 x 3 cells: the middle, faces, edges, corners
    [13, 4, 10, 12, 14, 16, 22, 1, 3, 5, 7, 9, 11, 15, 17, 19, 21, 23, 25, 0, 2, 6, 8, 18, 20, 24, 26]
)


@njit(cache=True)
def _key(x, y, z):  # type: ignore[no-untyped-def]
    """21 bits an axis: cells 2^21 apart share a key, and their points are told apart by distance."""
    return (((x + _OFFSET) & _AXIS) << 42) | (((y + _OFFSET) & _AXIS) << 21) | ((z + _OFFSET) & _AXIS)


@njit(cache=True)
def _slot(key, size):  # type: ignore[no-untyped-def]
    mixed = (key >> 42) * 73856093 ^ ((key >> 21) & _AXIS) * 19349669 ^ (key & _AXIS) * 83492791
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
def _near_cell(key, n):  # type: ignore[no-untyped-def]
    """Key of the cell beside the cell `key` that is number n of 27, z counting first."""
    x, y, z = (key >> 42) - _OFFSET, ((key >> 21) & _AXIS) - _OFFSET, (key & _AXIS) - _OFFSET
    return _key(x + n // 9 - 1, y + n // 3 % 3 - 1, z + n % 3 - 1)


@njit(cache=True)
def crowded(points, radius_m, neighbours):  # type: ignore[no-untyped-def]
    """(n,) bool: points (n, 3) with at least so many others within a radius."""
    order, keys, start = into_cells(points, radius_m)
    moved, size = points[order], len(start) - 1
    result = np.zeros(len(points), np.bool_)
    limit = radius_m * radius_m
    for at in range(len(points)):
        count = -1  # the point itself
        for c in _NEAREST_FIRST:
            other = _near_cell(keys[at], c)
            slot = _slot(other, size)
            for k in range(start[slot], start[slot + 1]):
                if keys[k] != other:
                    continue
                x, y, z = moved[k, 0] - moved[at, 0], moved[k, 1] - moved[at, 1], moved[k, 2] - moved[at, 2]
                count += x * x + y * y + z * z <= limit
                if count >= neighbours:
                    break
            if count >= neighbours:
                result[order[at]] = True
                break
    return result


@njit(cache=True)
def nearest(points, radius_m, neighbours):  # type: ignore[no-untyped-def]
    """Indices (n, k) of the nearest other points within a radius, -1 where there are fewer, and distances (n, k)."""
    order, keys, start = into_cells(points, radius_m)
    n, size = len(points), len(start) - 1
    index = np.full((n, neighbours), -1, np.int32)
    distance = np.full((n, neighbours), np.inf)
    squares, rows = np.empty(neighbours), np.empty(neighbours, np.int64)
    gaps = np.zeros((3, 3))  # squared distance of the point to the cells behind, its own and ahead, along each axis
    done = np.zeros(n, np.bool_)
    near, places, cells = np.empty(n, np.int64), np.empty((n, 3)), np.empty((27, 4), np.int64)
    for first in range(n):
        if done[first]:
            continue
        filled_cells = _gather(
            points, order, keys, start, keys[first], near, places, cells
        )  # once for all points of the cell
        for at in range(first, start[_slot(keys[first], size) + 1]):
            if keys[at] != keys[first]:
                continue
            done[at] = True
            i = order[at]
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            filled, limit = 0, radius_m * radius_m
            for k in range(3):
                inside = points[i, k] - math.floor(points[i, k] / radius_m) * radius_m
                gaps[k, 0], gaps[k, 2] = inside * inside, (radius_m - inside) * (radius_m - inside)
            begin = 0
            for c in range(filled_cells):
                end = cells[c, 3]
                if gaps[0, cells[c, 0]] + gaps[1, cells[c, 1]] + gaps[2, cells[c, 2]] > limit:
                    begin = end
                    continue
                for k in range(begin, end):
                    x, y, z = places[k, 0] - px, places[k, 1] - py, places[k, 2] - pz
                    square = x * x + y * y + z * z
                    if square > limit or near[k] == i:
                        continue
                    place = min(filled, neighbours - 1)
                    while place > 0 and squares[place - 1] > square:
                        squares[place], rows[place] = squares[place - 1], rows[place - 1]
                        place -= 1
                    squares[place], rows[place] = square, near[k]
                    filled = min(filled + 1, neighbours)
                    if filled == neighbours:
                        limit = squares[neighbours - 1]
                begin = end
            for k in range(filled):
                index[i, k], distance[i, k] = rows[k], math.sqrt(squares[k])
    return index, distance


@njit(cache=True)
def _gather(points, order, keys, start, key, near, places, cells):  # type: ignore[no-untyped-def]
    """Fills in the points of the 27 cells about the cell `key`, nearest first.

    Args: near, places: index and place of each point; cells: of each cell that is not empty 0, 1 or 2 along each axis,
        and where its points end.

    Returns:
        How many cells are not empty.
    """
    filled, count, size = 0, 0, len(start) - 1
    for c in _NEAREST_FIRST:
        other = _near_cell(key, c)
        slot, before = _slot(other, size), filled
        for k in range(start[slot], start[slot + 1]):
            if keys[k] == other:
                i = order[k]
                near[filled] = i
                places[filled, 0], places[filled, 1], places[filled, 2] = points[i, 0], points[i, 1], points[i, 2]
                filled += 1
        if filled > before:
            cells[count, 0], cells[count, 1], cells[count, 2], cells[count, 3] = c // 9, c // 3 % 3, c % 3, filled
            count += 1
    return count
