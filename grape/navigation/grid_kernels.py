"""Compiled inner loops over grids."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.heap import pop, push
from grape.messages import Array

_LETHAL = 254


@njit(cache=True)
def footprint_hits(
    cost: Array, x_min: float, y_min: float, step: float, poses: Array, front: float, rear: float, half: float
) -> Array:
    """Which poses (n, 3) have the centre of a lethal cell under the rectangle."""
    hits = np.zeros(poses.shape[0], dtype=np.bool_)
    rows, columns = cost.shape
    for k in range(poses.shape[0]):
        x, y = poses[k, 0], poses[k, 1]
        c, s = np.cos(poses[k, 2]), np.sin(poses[k, 2])
        reach_x = max(front, rear) * abs(c) + half * abs(s)
        reach_y = max(front, rear) * abs(s) + half * abs(c)
        i0 = max(0, int(np.floor((y - reach_y - y_min) / step)))
        i1 = min(rows - 1, int(np.floor((y + reach_y - y_min) / step)))
        j0 = max(0, int(np.floor((x - reach_x - x_min) / step)))
        j1 = min(columns - 1, int(np.floor((x + reach_x - x_min) / step)))
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                if cost[i, j] != _LETHAL:
                    continue
                dx, dy = x_min + (j + 0.5) * step - x, y_min + (i + 0.5) * step - y
                along, across = c * dx + s * dy, -s * dx + c * dy
                if -rear <= along <= front and abs(across) <= half:
                    hits[k] = True
                    break
            if hits[k]:
                break
    return hits


@njit(cache=True)
def footprint_worst(
    cost: Array, x_min: float, y_min: float, step: float, poses: Array, front: float, rear: float, half: float
) -> Array:
    """(n,) the worst of lethal, unknown (also what is outside the grid), near and free cells under the rectangle."""
    worst = np.zeros(poses.shape[0], dtype=np.uint8)
    rows, columns = cost.shape
    for k in range(poses.shape[0]):
        x, y = poses[k, 0], poses[k, 1]
        c, s = np.cos(poses[k, 2]), np.sin(poses[k, 2])
        reach = np.sqrt(max(front, rear) ** 2 + half**2)
        found = 0
        for i in range(int(np.floor((y - reach - y_min) / step)), int(np.floor((y + reach - y_min) / step)) + 1):
            for j in range(int(np.floor((x - reach - x_min) / step)), int(np.floor((x + reach - x_min) / step)) + 1):
                dx, dy = x_min + (j + 0.5) * step - x, y_min + (i + 0.5) * step - y
                along, across = c * dx + s * dy, -s * dx + c * dy
                if along < -rear or along > front or abs(across) > half:
                    continue
                here = int(cost[i, j]) if 0 <= i < rows and 0 <= j < columns else 255
                if here == _LETHAL:
                    found = here
                elif found != _LETHAL:
                    found = max(found, here)
        worst[k] = found
    return worst


@njit(cache=True)
def mark_and_clear(
    evidence: Array,
    x_min: float,
    y_min: float,
    step: float,
    sensor: Array,
    ends: Array,
    hit: Array,
    gain: int,
    loss: int,
    most: int,
) -> None:
    """Add `gain` to the cells where beams end in a hit and take `loss` from the cells they pass, within 0..most.

    Beams go from `sensor` (2,) to `ends` (n, 2) m; a cell that one beam hits is not cleared by the others.
    """
    rows, columns = evidence.shape
    touched = np.zeros((rows, columns), dtype=np.uint8)
    for k in range(ends.shape[0]):
        if hit[k]:
            i, j = int(np.floor((ends[k, 1] - y_min) / step)), int(np.floor((ends[k, 0] - x_min) / step))
            if 0 <= i < rows and 0 <= j < columns and touched[i, j] == 0:
                touched[i, j] = 1
                evidence[i, j] = min(most, evidence[i, j] + gain)
    along = 0.7  # cells between places where it is looked which cell a beam passes
    x, y = (sensor[0] - x_min) / step, (sensor[1] - y_min) / step
    for k in range(ends.shape[0]):
        dx, dy = (ends[k, 0] - sensor[0]) / step, (ends[k, 1] - sensor[1]) / step
        length = np.sqrt(dx * dx + dy * dy)
        steps = int((length - 1.5 if hit[k] else length) / along)
        if steps <= 0:
            continue
        ux, uy = along * dx / length, along * dy / length
        for n in range(steps):
            i, j = int(np.floor(y + n * uy)), int(np.floor(x + n * ux))
            if i < 0 or j < 0 or i >= rows or j >= columns:
                continue
            if touched[i, j] == 0:
                touched[i, j] = 2
                evidence[i, j] = max(0, evidence[i, j] - loss)


@njit(cache=True)
def search(cost: Array, start: int, goal: int, weight: float, most: int) -> Array:
    """A* over eight neighbours; cells come back as flat indices from start to goal, empty when there is no way.

    A step costs its length times (1 + weight cost / 252); cells with a cost above `most` are closed, except that the
    start may lie among closed inscribed cells and leave them.
    """
    rows, columns = cost.shape
    total = np.full(rows * columns, np.inf)
    parent = np.full(rows * columns, -1, dtype=np.int64)
    done = np.zeros(rows * columns, dtype=np.bool_)
    keys = np.empty(8 * rows * columns + 8)
    cells = np.empty(8 * rows * columns + 8, dtype=np.int64)
    goal_i, goal_j = goal // columns, goal % columns
    total[start] = 0.0
    push(keys, cells, 0, 0.0, start)
    size = 1
    diagonal = np.sqrt(2.0)
    while size > 0:
        cell = cells[0]
        pop(keys, cells, size)
        size -= 1
        if done[cell]:
            continue
        done[cell] = True
        if cell == goal:
            return _way_to(goal, parent)
        i, j = cell // columns, cell % columns
        leaving = cost[i, j] > most
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if a < 0 or b < 0 or a >= rows or b >= columns:
                    continue
                near, c = a * columns + b, cost[a, b]
                if c >= _LETHAL or (c > most and not leaving) or done[near]:
                    continue
                step = diagonal if di != 0 and dj != 0 else 1.0
                g = total[cell] + step * (1.0 + weight * c / 252.0)
                if g >= total[near]:
                    continue
                total[near], parent[near] = g, cell
                x, y = abs(a - goal_i), abs(b - goal_j)
                push(keys, cells, size, g + max(x, y) + (diagonal - 1.0) * min(x, y), near)
                size += 1
    return np.empty(0, dtype=np.int64)


@njit(cache=True)
def _way_to(goal: int, parent: Array) -> Array:
    """The cells that lead to the goal, from the one without a parent on."""
    count, cell = 1, goal
    while parent[cell] >= 0:
        cell = parent[cell]
        count += 1
    way = np.empty(count, dtype=np.int64)
    for n in range(count - 1, -1, -1):
        way[n] = goal
        goal = parent[goal]
    return way


@njit(cache=True)
def worst_on_segment(cost: Array, i0: float, j0: float, i1: float, j1: float) -> int:
    """The largest cost under a straight line between two points in cell units."""
    length = np.sqrt((i1 - i0) ** 2 + (j1 - j0) ** 2)
    steps = int(np.ceil(length / 0.5)) + 1
    worst = 0
    for n in range(steps + 1):
        s = n / steps
        i, j = int(np.floor(i0 + s * (i1 - i0))), int(np.floor(j0 + s * (j1 - j0)))
        if i < 0 or j < 0 or i >= cost.shape[0] or j >= cost.shape[1]:
            return 255
        worst = max(worst, int(cost[i, j]))
    return worst
