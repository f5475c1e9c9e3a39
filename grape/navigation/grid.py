"""Grids over the map: where the cells are, and a grid of typed costs.

Source: Lu, Hershberger and Smart, Layered costmaps for context-sensitive navigation, IROS 2014; cost values as Nav2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, frozen_array

MOST_CELLS = 100_000_000
FREE = 0
INSCRIBED = 253  # the robot's centre here means contact whatever its heading
LETHAL = 254
UNKNOWN = 255


@dataclass(frozen=True, kw_only=True)
class GridSpec:
    """Cells of `resolution` m over the map; cell (row, column) = (0, 0) has its corner at (`x_min`, `y_min`) m."""

    x_min: float
    y_min: float
    columns: int
    rows: int
    resolution: float = 0.05

    def __post_init__(self) -> None:
        if self.columns < 1 or self.rows < 1 or not 0 < self.resolution < inf:
            raise InvalidInput(
                f"a grid needs cells of positive size, got {self.rows} x {self.columns}, {self.resolution}"
            )
        if int(self.rows) * int(self.columns) > MOST_CELLS:  # numpy's integers would run over
            raise InvalidInput(f"a grid of {self.rows} x {self.columns} cells is too large, at most 1e8 cells")
        if not (isfinite(self.x_min) and isfinite(self.y_min)):
            raise InvalidInput(f"a grid needs a finite corner, got {self.x_min}, {self.y_min}")

    @property
    def origin(self) -> Array:
        """(2,) m, outer corner of the first cell."""
        return np.array([self.x_min, self.y_min])

    def cells(self, points: Array) -> Array:
        """Cells (..., 2) int as (row, column) of points (..., 2) m; they may lie outside the grid."""
        return np.floor((np.asarray(points) - self.origin) / self.resolution).astype(np.int64)[..., ::-1]

    def centres(self, cells: Array) -> Array:
        """Centres (..., 2) m of cells (..., 2) given as (row, column)."""
        return self.origin + (np.asarray(cells)[..., ::-1] + 0.5) * self.resolution

    def contains(self, cells: Array) -> Array:
        """Which of the cells (..., 2) lie in the grid."""
        return (
            (cells[..., 0] >= 0) & (cells[..., 0] < self.rows) & (cells[..., 1] >= 0) & (cells[..., 1] < self.columns)
        )

    @staticmethod
    def around(points: Array, margin: float, resolution: float = 0.05) -> GridSpec:
        """The grid that covers points (n, 2) m with a margin (m), its corner on a multiple of the resolution."""
        low = np.floor((np.min(points, axis=0) - margin) / resolution)
        high = np.ceil((np.max(points, axis=0) + margin) / resolution)
        if not (high - low).max() <= MOST_CELLS:
            raise InvalidInput(f"points over {np.ptp(points, axis=0)} m are too far apart for cells of {resolution} m")
        columns, rows = (high - low).astype(int)
        return GridSpec(
            x_min=low[0] * resolution, y_min=low[1] * resolution, columns=columns, rows=rows, resolution=resolution
        )

    @staticmethod
    def window(centre: Array, size: float, resolution: float = 0.05) -> GridSpec:
        """The square grid of `size` m around `centre` (2,) m, its corner on a multiple of the resolution."""
        low = np.floor((np.asarray(centre)[:2] - 0.5 * size) / resolution)
        cells = round(size / resolution)
        return GridSpec(
            x_min=low[0] * resolution, y_min=low[1] * resolution, columns=cells, rows=cells, resolution=resolution
        )


@dataclass(frozen=True, kw_only=True)
class Footprint:
    """The rectangle that the robot covers, in base_link; all in metres."""

    front: float = 0.495
    rear: float = 0.495
    half_width: float = 0.335

    @property
    def inscribed(self) -> float:
        """Radius of the largest circle around base_link inside the rectangle."""
        return min(self.front, self.rear, self.half_width)

    @property
    def circumscribed(self) -> float:
        """Radius of the smallest circle around base_link that holds the rectangle."""
        return float(np.hypot(max(self.front, self.rear), self.half_width))

    def grown(self, margin: float) -> Footprint:
        """The rectangle with `margin` m more on every side."""
        return Footprint(front=self.front + margin, rear=self.rear + margin, half_width=self.half_width + margin)

    def contains(self, points: Array) -> Array:
        """Which of the points (..., 2) m in base_link it covers."""
        x, y = points[..., 0], points[..., 1]
        return (x <= self.front) & (x >= -self.rear) & (np.abs(y) <= self.half_width)

    def discs(self, count: int = 4) -> tuple[Array, float]:
        """Centres (count,) m on the x axis and the one radius (m) of discs that together cover the rectangle."""
        length = (self.front + self.rear) / count
        centres = -self.rear + length * (np.arange(count) + 0.5)
        return centres, float(np.hypot(0.5 * length, self.half_width))

    def corners(self, pose: Array) -> Array:
        """Corners (4, 2) m in map of the robot at `pose` (3,) x y yaw, counter-clockwise."""
        c, s = np.cos(pose[2]), np.sin(pose[2])
        x = np.array([self.front, self.front, -self.rear, -self.rear])
        y = np.array([-self.half_width, self.half_width, self.half_width, -self.half_width])
        return np.column_stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y])


@dataclass(frozen=True, kw_only=True)
class Costmap:
    """Typed costs of cells: 0 free, 1..252 near something, 253 inscribed, 254 lethal, 255 unknown."""

    spec: GridSpec
    cost: Array  # (rows, columns) uint8

    def __post_init__(self) -> None:
        if self.cost.shape != (self.spec.rows, self.spec.columns) or self.cost.dtype != np.uint8:
            raise InvalidInput(
                f"costs must be uint8 of {(self.spec.rows, self.spec.columns)}, got {self.cost.dtype} {self.cost.shape}"
            )
        object.__setattr__(self, "cost", frozen_array(self.cost))

    @cached_property
    def distance(self) -> Array:
        """(rows, columns) float32 m from the centre of each cell to that of the nearest lethal one; 1e3 without any."""
        import cv2

        free = (self.cost != LETHAL).astype(np.uint8)
        if free.all():
            return np.full(self.cost.shape, 1e3, dtype=np.float32)
        metres = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        metres *= self.spec.resolution
        return metres

    def cost_at(self, points: Array) -> Array:
        """Costs (...,) of points (..., 2) m; unknown outside the grid."""
        cells = self.spec.cells(np.asarray(points))
        inside = self.spec.contains(cells)
        clipped = np.clip(cells, 0, [self.spec.rows - 1, self.spec.columns - 1])
        return np.where(inside, self.cost[clipped[..., 0], clipped[..., 1]], UNKNOWN)

    def blocked(self, poses: Array, footprint: Footprint) -> Array:
        """Which of the poses (n, 3) x y yaw put part of the footprint on a lethal cell; unknown counts as free."""
        from grape.navigation.grid_kernels import footprint_hits

        poses = np.ascontiguousarray(np.atleast_2d(poses), dtype=float)
        spec = self.spec
        return footprint_hits(
            self.cost,
            spec.x_min,
            spec.y_min,
            spec.resolution,
            poses,
            footprint.front,
            footprint.rear,
            footprint.half_width,
        )

    def footprint_cost(self, poses: Array, footprint: Footprint) -> Array:
        """(n,) uint8, the worst cost under the footprint at poses (n, 3): lethal before unknown before the others.

        The inscribed cost holds for centres, so it means nothing special here.
        """
        from grape.navigation.grid_kernels import footprint_worst

        poses = np.ascontiguousarray(np.atleast_2d(poses), dtype=float)
        spec, own = self.spec, footprint
        size = (own.front, own.rear, own.half_width)
        return footprint_worst(self.cost, spec.x_min, spec.y_min, spec.resolution, poses, *size)
