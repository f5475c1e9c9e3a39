"""Compiled walks of beams over grids; cells are (row, column), points metres in the map frame.

Source: Bresenham 1965 for marking; Amanatides and Woo, A fast voxel traversal algorithm for ray tracing, 1987.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array


@njit(cache=True)
def beam_ends(ranges: Array, first: float, step: float, nearest: float, farthest: float, most: int) -> Array:
    """Points (n, 2) m in the laser's frame where beams end that are longer than `nearest` and shorter than `farthest`.

    Args:
        ranges: m. first, step: rad, angle of the first beam and from each to the next.
        most: of more than so many beams so many are chosen evenly.
    """
    ended = np.flatnonzero((ranges > nearest) & (ranges < farthest))
    if ended.size > most:
        ended = ended[np.arange(most) * (ended.size - 1) // max(most - 1, 1)]
    points = np.empty((ended.size, 2))
    for k in range(ended.size):
        angle = first + step * ended[k]
        points[k, 0], points[k, 1] = ranges[ended[k]] * np.cos(angle), ranges[ended[k]] * np.sin(angle)
    return points


@njit(cache=True)
def mark_scan(
    log_odds: Array,
    hits: Array,
    visited: Array,
    scan: int,
    origin: Array,
    resolution: float,
    sensor: Array,
    ends: Array,
    hit: Array,
    gain: float,
    loss: float,
    limit: float,
) -> None:
    """Add one scan: each cell once, as hit if any beam of the scan ends there, else as passed.

    Args:
        log_odds: (rows, columns) float32, changed.
        hits: (rows, columns) int32, scans of which a beam ended in a cell, changed.
        visited: (rows, columns) int32, number of the last scan that touched a cell, changed.
        sensor: (2,) m. ends: (n, 2) m. hit: (n,) whether the beam ends on something.
    """
    rows, columns = log_odds.shape
    for k in range(ends.shape[0]):
        if hit[k]:
            column = int(np.floor((ends[k, 0] - origin[0]) / resolution))
            row = int(np.floor((ends[k, 1] - origin[1]) / resolution))
            if 0 <= row < rows and 0 <= column < columns and visited[row, column] != scan:
                visited[row, column] = scan
                hits[row, column] += 1
                log_odds[row, column] = min(log_odds[row, column] + gain, limit)
    start_column = int(np.floor((sensor[0] - origin[0]) / resolution))
    start_row = int(np.floor((sensor[1] - origin[1]) / resolution))
    for k in range(ends.shape[0]):
        column, row = start_column, start_row
        last_column = int(np.floor((ends[k, 0] - origin[0]) / resolution))
        last_row = int(np.floor((ends[k, 1] - origin[1]) / resolution))
        dx, dy = abs(last_column - column), -abs(last_row - row)
        step_x = 1 if column < last_column else -1
        step_y = 1 if row < last_row else -1
        error = dx + dy
        while not (column == last_column and row == last_row):
            if 0 <= row < rows and 0 <= column < columns and visited[row, column] != scan:
                visited[row, column] = scan
                log_odds[row, column] = max(log_odds[row, column] - loss, -limit)
            twice = 2 * error
            if twice >= dy:
                error += dy
                column += step_x
            if twice <= dx:
                error += dx
                row += step_y


@njit(cache=True)
def cast_beams(
    occupied: Array, origin: Array, resolution: float, sensors: Array, angles: Array, max_range: float
) -> Array:
    """Ranges (n, m) m from sensors (n, 3) x y yaw along angles (m,) to the first occupied cell; inf beyond max_range.

    Args:
        occupied: (rows, columns) bool.
    """
    rows, columns = occupied.shape
    ranges = np.full((sensors.shape[0], angles.size), np.inf)
    for i in range(sensors.shape[0]):
        x0, y0 = (sensors[i, 0] - origin[0]) / resolution, (sensors[i, 1] - origin[1]) / resolution
        for j in range(angles.size):
            c, s = np.cos(sensors[i, 2] + angles[j]), np.sin(sensors[i, 2] + angles[j])
            column, row = int(np.floor(x0)), int(np.floor(y0))
            step_x, step_y = (1 if c > 0 else -1), (1 if s > 0 else -1)
            width_x = abs(1.0 / c) if abs(c) > 1e-12 else 1e300
            width_y = abs(1.0 / s) if abs(s) > 1e-12 else 1e300
            next_x = (column + 1 - x0 if c > 0 else x0 - column) * width_x
            next_y = (row + 1 - y0 if s > 0 else y0 - row) * width_y
            way = 0.0
            while way * resolution <= max_range:
                if 0 <= row < rows and 0 <= column < columns and occupied[row, column]:
                    ranges[i, j] = way * resolution
                    break
                if next_x < next_y:
                    way, next_x, column = next_x, next_x + width_x, column + step_x
                else:
                    way, next_y, row = next_y, next_y + width_y, row + step_y
    return ranges
