"""Compiled search of a scan's pose over a field of responses.

Source: Olson, Real-time correlative scan matching, ICRA 2009; bounds by maxima over blocks as in Hess et al.,
Real-time loop closure in 2D LIDAR SLAM, ICRA 2016.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array


@njit(cache=True)
def stamp_points(field: Array, origin: Array, resolution: float, points: Array, sigma: float) -> None:
    """Raise the field (rows, columns) float32 to exp(-d^2 / 2 sigma^2) around each of the points (n, 2) m."""
    rows, columns = field.shape
    reach = int(np.ceil(3.0 * sigma / resolution))
    for k in range(points.shape[0]):
        x, y = (points[k, 0] - origin[0]) / resolution, (points[k, 1] - origin[1]) / resolution
        column, row = int(np.floor(x)), int(np.floor(y))
        for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
            for c in range(max(column - reach, 0), min(column + reach + 1, columns)):
                square = ((c + 0.5 - x) ** 2 + (r + 0.5 - y) ** 2) * resolution * resolution
                value = np.exp(-0.5 * square / (sigma * sigma))
                if value > field[r, c]:
                    field[r, c] = value


@njit(cache=True)
def response(field: Array, rows_: Array, columns_: Array, down: int, right: int) -> float:
    """Mean of the field at cells that are shifted by (down, right); 0 outside."""
    rows, columns = field.shape
    total = 0.0
    for k in range(rows_.size):
        r, c = rows_[k] + down, columns_[k] + right
        if 0 <= r < rows and 0 <= c < columns:
            total += field[r, c]
    return total / max(rows_.size, 1)


@njit(cache=True)
def search(
    field: Array,
    bound: Array,
    block: int,
    origin: Array,
    resolution: float,
    points: Array,
    guess: Array,
    reach: int,
    turns: Array,
    pull: Array,
) -> Array:
    """(4,) x, y, yaw and response of the best pose within `reach` cells and the `turns` (rad) around a guess.

    Args:
        bound: the field's maxima over the `block` x `block` cells that begin at a cell.
        points: (n, 2) m in the robot's frame.
        pull: (2,) what is taken off the response per m^2 and rad^2 away from the guess.
    """
    n, blocks = points.shape[0], (2 * reach + block) // block
    rows_, columns_ = np.empty((turns.size, n), np.int64), np.empty((turns.size, n), np.int64)
    coarse = np.empty(turns.size * blocks * blocks)
    for t in range(turns.size):
        c, s = np.cos(guess[2] + turns[t]), np.sin(guess[2] + turns[t])
        for k in range(n):
            x = guess[0] + c * points[k, 0] - s * points[k, 1]
            y = guess[1] + s * points[k, 0] + c * points[k, 1]
            columns_[t, k] = int(np.floor((x - origin[0]) / resolution))
            rows_[t, k] = int(np.floor((y - origin[1]) / resolution))
        for i in range(blocks):
            for j in range(blocks):
                down, right = i * block - reach, j * block - reach
                near_y = max(max(down, -(down + block - 1)), 0) * resolution
                near_x = max(max(right, -(right + block - 1)), 0) * resolution
                off = pull[0] * (near_x * near_x + near_y * near_y) + pull[1] * turns[t] * turns[t]
                coarse[(t * blocks + i) * blocks + j] = response(bound, rows_[t], columns_[t], down, right) - off
    best = np.array([guess[0], guess[1], guess[2], 0.0])
    most = -1e9
    for index in np.argsort(-coarse):
        if coarse[index] <= most:
            break
        t, i, j = index // (blocks * blocks), (index // blocks) % blocks, index % blocks
        for down in range(i * block - reach, min((i + 1) * block, 2 * reach + 1) - reach):
            for right in range(j * block - reach, min((j + 1) * block, 2 * reach + 1) - reach):
                value = response(field, rows_[t], columns_[t], down, right)
                square = (down * down + right * right) * resolution * resolution
                score = value - pull[0] * square - pull[1] * turns[t] * turns[t]
                if score > most:
                    most = score
                    best[0], best[1] = guess[0] + right * resolution, guess[1] + down * resolution
                    best[2], best[3] = guess[2] + turns[t], value
    return best
