"""Compiled parts that local planners share: how near the footprint comes, and where on the path a point is."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array

_FAR = 1e3


@njit(cache=True, fastmath=True)
def gap(field: Array, frame: Array, x: float, y: float, c: float, s: float, discs: Array) -> float:
    """Metres from the footprint to the nearest lethal cell; negative in contact, 1e3 outside the grid.

    Args:
        field: (rows, columns) float32 m, `Costmap.distance`.
        frame: (3,) x_min, y_min, resolution of the grid.
        c, s: cosine and sine of the heading.
        discs: (k + 1,) m, centres of the discs that cover the footprint, then their radius.
    """
    least = _FAR
    rows, columns = field.shape
    per_metre = 1.0 / frame[2]
    u, v, du, dv = (x - frame[0]) * per_metre, (y - frame[1]) * per_metre, c * per_metre, s * per_metre
    for n in range(discs.shape[0] - 1):
        j, i = int(np.floor(u + discs[n] * du)), int(np.floor(v + discs[n] * dv))
        if 0 <= i < rows and 0 <= j < columns:
            least = min(least, field[i, j])
    return least - discs[discs.shape[0] - 1] if least < _FAR else _FAR


@njit(cache=True, fastmath=True)
def smooth_gap(field: Array, frame: Array, x: float, y: float, c: float, s: float, discs: Array) -> float:
    """As `gap`, interpolated between cells, so that it has a slope."""
    least = _FAR
    rows, columns = field.shape
    for n in range(discs.shape[0] - 1):
        u = (x + discs[n] * c - frame[0]) / frame[2] - 0.5
        v = (y + discs[n] * s - frame[1]) / frame[2] - 0.5
        j, i = int(np.floor(u)), int(np.floor(v))
        if 0 <= i < rows - 1 and 0 <= j < columns - 1:
            a, b = u - j, v - i
            low = (1.0 - a) * field[i, j] + a * field[i, j + 1]
            high = (1.0 - a) * field[i + 1, j] + a * field[i + 1, j + 1]
            least = min(least, (1.0 - b) * low + b * high)
    return least - discs[discs.shape[0] - 1] if least < _FAR else _FAR


@njit(cache=True, fastmath=True)
def nearest(path: Array, k: int, x: float, y: float) -> int:
    """Index of the pose of the path (n, ≥ 2) next to a point, searched downhill from index k."""
    best = (path[k, 0] - x) ** 2 + (path[k, 1] - y) ** 2
    while k + 1 < path.shape[0]:
        d = (path[k + 1, 0] - x) ** 2 + (path[k + 1, 1] - y) ** 2
        if d > best:
            break
        best = d
        k += 1
    while k > 0:
        d = (path[k - 1, 0] - x) ** 2 + (path[k - 1, 1] - y) ** 2
        if d >= best:
            break
        best = d
        k -= 1
    return k
