"""What stands in a world, square by square: between which heights there is anything to touch."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from grape.messages import Array

CELL_M = 0.5


@dataclass(frozen=True, kw_only=True)
class Cells:
    """The span of heights that is filled in each square of `CELL_M`; beyond the last square it is as in that one.

    Attributes:
        origin: (2,) m, map frame: the corner of the first square.
        lowest: (ny, nx) m.
        highest: (ny, nx) m, below `lowest` where there is nothing.
    """

    origin: Array
    lowest: Array
    highest: Array

    @classmethod
    def of_boxes(cls, boxes: Array) -> Cells:
        """The squares that boxes (n, 6) m, lower and upper corner, reach into, with empty ones around them."""
        origin = boxes[:, :2].min(axis=0) - 1.5 * CELL_M
        first = ((boxes[:, :2] - origin) / CELL_M).astype(int)
        last = ((boxes[:, 3:5] - origin) / CELL_M).astype(int)
        nx, ny = last.max(axis=0) + 2
        lowest, highest = np.full((ny, nx), np.inf), np.full((ny, nx), -np.inf)
        for box, (x0, y0), (x1, y1) in zip(boxes, first, last, strict=True):
            inside = slice(y0, y1 + 1), slice(x0, x1 + 1)
            lowest[inside] = np.minimum(lowest[inside], box[2])
            highest[inside] = np.maximum(highest[inside], box[5])
        return cls(origin=origin, lowest=lowest, highest=highest)

    @classmethod
    def of_ground(cls, model: mujoco.MjModel, data: mujoco.MjData, body: int) -> Cells:
        """The squares of a body whose geom is a height field: filled from its surface down."""
        geom = int(model.body_geomadr[body])
        field = int(model.geom_dataid[geom])
        rows, columns, start = model.hfield_nrow[field], model.hfield_ncol[field], model.hfield_adr[field]
        half_x, half_y, span, _ = model.hfield_size[field]
        heights = model.hfield_data[start : start + rows * columns].reshape(rows, columns) * span
        origin = data.geom_xpos[geom] - [half_x, half_y, 0.0]
        highest = _block_maxima(
            heights + origin[2], np.linspace(0, 2 * half_x, columns), np.linspace(0, 2 * half_y, rows)
        )
        return cls(origin=origin[:2], lowest=np.full_like(highest, -np.inf), highest=highest)


def _block_maxima(heights: Array, xs: Array, ys: Array) -> Array:
    """The highest of `heights` (ys, xs) in each square of `CELL_M`, its border included."""
    nx, ny = int(xs[-1] / CELL_M) + 1, int(ys[-1] / CELL_M) + 1
    maxima = np.empty((ny, nx))
    for iy in range(ny):
        low = max(np.searchsorted(ys, iy * CELL_M) - 1, 0)
        band = heights[low : np.searchsorted(ys, (iy + 1) * CELL_M) + 1].max(axis=0)
        for ix in range(nx):
            left = max(np.searchsorted(xs, ix * CELL_M) - 1, 0)
            maxima[iy, ix] = band[left : np.searchsorted(xs, (ix + 1) * CELL_M) + 1].max()
    return maxima
