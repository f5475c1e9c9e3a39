"""Which bodies are near enough to each other that they may touch soon: kernels of `grape.sim.culling`."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array


@njit(cache=True)
def bound_bodies(
    first_geom: Array, geoms: Array, owners: Array, centres: Array, radii: Array, margin: float, boxes: Array
) -> None:
    """Boxes (bodies, 6) of the listed bodies around the bounding spheres of their geoms, `margin` m wider.

    Args:
        first_geom: (owners + 1,) where each listed body's geoms begin in `geoms`.
        geoms: indices of geoms, body by body.
        owners: (owners,) rows of `boxes` to fill.
        centres: (all geoms, 3) m.
        radii: (all geoms,) m.
    """
    for k in range(len(owners)):
        box = boxes[owners[k]]
        for axis in range(3):
            low, high = 1e30, -1e30
            for j in range(first_geom[k], first_geom[k + 1]):
                centre, radius = centres[geoms[j], axis], radii[geoms[j]]
                low, high = min(low, centre - radius), max(high, centre + radius)
            box[axis], box[axis + 3] = low - margin, high + margin


@njit(cache=True)
def in_cells(box: Array, lowest: Array, highest: Array, origin: Array, cell: float) -> bool:
    """Whether a box (6,) meets the span of heights, `lowest` to `highest` (ny, nx), of one of the squares under it."""
    ny, nx = highest.shape
    x0 = min(max(int((box[0] - origin[0]) / cell), 0), nx - 1)
    x1 = min(max(int((box[3] - origin[0]) / cell), 0), nx - 1)
    y0 = min(max(int((box[1] - origin[1]) / cell), 0), ny - 1)
    y1 = min(max(int((box[4] - origin[1]) / cell), 0), ny - 1)
    for iy in range(y0, y1 + 1):
        for ix in range(x0, x1 + 1):
            if box[2] <= highest[iy, ix] and box[5] >= lowest[iy, ix]:
                return True
    return False


@njit(cache=True)
def mark_neighbours(
    boxes: Array,
    moving: Array,
    first: Array,
    partners: Array,
    contype: Array,
    conaffinity: Array,
    near: Array,
) -> None:
    """Keep of each body's contact bits those by which it may touch a body whose box overlaps its own.

    Args:
        boxes: (bodies, 6) m: lower corner, upper corner.
        moving: (moving,) indices of bodies.
        first: (moving + 1,) where each one's partners begin in `partners`.
        partners: indices of the bodies that it may touch at all; each pair is listed once.
        contype, conaffinity: (bodies,) all bits of each body.
        near: (2, bodies) where contype and conaffinity are added up.
    """
    everything = boxes[moving[0]].copy()
    for body in moving:
        for axis in range(3):
            everything[axis] = min(everything[axis], boxes[body, axis])
            everything[axis + 3] = max(everything[axis + 3], boxes[body, axis + 3])
    reached = np.ones(len(boxes), dtype=np.bool_)
    for body in range(len(boxes)):
        reached[body] = _overlap(everything, boxes[body])
    for k in range(len(moving)):
        a = moving[k]
        box = boxes[a]
        for j in range(first[k], first[k + 1]):
            b = partners[j]
            if reached[b] and _overlap(box, boxes[b]):
                near[0, a] |= contype[a] & conaffinity[b]
                near[1, a] |= conaffinity[a] & contype[b]
                near[0, b] |= contype[b] & conaffinity[a]
                near[1, b] |= conaffinity[b] & contype[a]


@njit(cache=True)
def _overlap(a: Array, b: Array) -> bool:
    beside = a[0] > b[3] or b[0] > a[3] or a[1] > b[4] or b[1] > a[4]
    return not (beside or a[2] > b[5] or b[2] > a[5])


@njit(cache=True)
def mark_in_cells(
    boxes: Array,
    moving: Array,
    lowest: Array,
    highest: Array,
    origin: Array,
    cell: float,
    bits: Array,
    standing: int,
    near: Array,
) -> None:
    """Give every moving body that is near a body in cells a contact bit that it shares with that one alone.

    Args:
        bits: (bodies, 2) contact bits: added to contype and conaffinity.
        standing: the index of the body in cells.
        near: (2, bodies) where contype and conaffinity are added up.
    """
    for k in range(len(moving)):
        a = moving[k]
        if (bits[a, 0] or bits[a, 1]) and in_cells(boxes[a], lowest, highest, origin, cell):
            near[0, a] |= bits[a, 0]
            near[1, a] |= bits[a, 1]
            near[0, standing] |= bits[a, 1]
            near[1, standing] |= bits[a, 0]
