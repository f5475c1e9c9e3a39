"""Worlds for a laser of 180 degrees, drawn from a seed as grids; a robot's way through them, odometry and scans."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from grape.mapping import OccupancyGrid, between, chained, compose, predicted_ranges
from grape.messages import Array, LaserScan, frozen_array
from grape.navigation import GridSpec

BEAMS = np.radians(np.arange(-90.0, 91.0, 1.0))
MAX_RANGE = 20.0
RESOLUTION = 0.05
STEP = 0.35
CORRIDOR = 2.4
ROW_SPACING, VINE_SPACING, HEADLAND = 2.6, 1.15, 4.0


@dataclass(frozen=True, kw_only=True)
class LaserWorld:
    """A true map and the corners (k, 2) m of the way that a robot drives in it."""

    grid: OccupancyGrid
    corners: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", frozen_array(self.corners, float))


class Canvas:
    """Boxes and discs on a grid of so many metres, with its lower left corner (m) in map."""

    def __init__(
        self, width: float, height: float, resolution: float = RESOLUTION, corner: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        size = {"columns": round(width / resolution), "rows": round(height / resolution)}
        self.spec = GridSpec(x_min=corner[0], y_min=corner[1], resolution=resolution, **size)
        self.occupancy = np.zeros((self.spec.rows, self.spec.columns), np.int8)
        self._x = corner[0] + (np.arange(self.spec.columns) + 0.5) * resolution
        self._y = corner[1] + (np.arange(self.spec.rows) + 0.5) * resolution

    def box(self, x0: float, y0: float, x1: float, y1: float, value: int = 100) -> None:
        """Fill the cells whose middle is in a box (m)."""
        rows, columns = (self._y > y0) & (self._y < y1), (self._x > x0) & (self._x < x1)
        self.occupancy[np.ix_(rows, columns)] = value

    def disc(self, x: float, y: float, radius: float) -> None:
        """Fill the cells that a disc touches, one at least."""
        reach = radius + 0.5 * self.spec.resolution
        rows, columns = np.flatnonzero(np.abs(self._y - y) < reach), np.flatnonzero(np.abs(self._x - x) < reach)
        near = np.hypot(self._x[columns][None, :] - x, self._y[rows][:, None] - y) < reach
        block = np.ix_(rows, columns)
        self.occupancy[block] = np.where(near, 100, self.occupancy[block])

    def grid(self) -> OccupancyGrid:
        """What was drawn."""
        return OccupancyGrid(spec=self.spec, occupancy=self.occupancy)


def building(seed: int) -> LaserWorld:
    """A corridor around a block of rooms with doors and furniture; pillars and cupboards along the outer walls."""
    rng = np.random.default_rng([seed, 1])
    width, height = rng.uniform(18.0, 26.0), rng.uniform(13.0, 18.0)
    canvas = Canvas(width, height)
    canvas.box(0, 0, width, height)
    canvas.box(0.1, 0.1, width - 0.1, height - 0.1, 0)
    x0, y0, x1, y1 = CORRIDOR, CORRIDOR, width - CORRIDOR, height - CORRIDOR
    canvas.box(x0, y0, x1, y1)
    middle = 0.5 * (y0 + y1) + rng.uniform(-0.8, 0.8)
    _rooms(canvas, rng, (x0, y0, x1, middle), y0)
    _rooms(canvas, rng, (x0, middle, x1, y1), y1)
    for along in rng.uniform(1.0, width - 1.0, 7):
        depth, half = rng.uniform(0.2, 0.5), rng.uniform(0.1, 0.6)
        wall = rng.choice([0.5 * depth, height - 0.5 * depth])
        canvas.box(along - half, wall - 0.5 * depth, along + half, wall + 0.5 * depth)
    for along in rng.uniform(1.0, height - 1.0, 5):
        depth, half = rng.uniform(0.2, 0.5), rng.uniform(0.1, 0.6)
        wall = rng.choice([0.5 * depth, width - 0.5 * depth])
        canvas.box(wall - 0.5 * depth, along - half, wall + 0.5 * depth, along + half)
    m = 0.5 * CORRIDOR + 0.1
    ring = [(m, m), (width - m, m), (width - m, height - m), (m, height - m), (m, m), (0.4 * width, m)]
    return LaserWorld(grid=canvas.grid(), corners=np.array(ring))


def _rooms(canvas: Canvas, rng: np.random.Generator, block: tuple[float, float, float, float], wall: float) -> None:
    """Two to four rooms side by side in a block (x0, y0, x1, y1) m, with doors in the wall at that y."""
    x0, y0, x1, y1 = block
    edges = np.linspace(x0, x1, rng.integers(3, 6))
    edges[1:-1] += rng.uniform(-0.7, 0.7, len(edges) - 2)
    for left, right in pairwise(edges):
        canvas.box(left + 0.1, y0 + 0.1, right - 0.1, y1 - 0.1, 0)
        door = rng.uniform(left + 0.4, right - 1.4)
        canvas.box(door, wall - 0.15, door + 0.95, wall + 0.15, 0)
        for x, y in rng.uniform([left + 0.6, y0 + 0.6], [right - 0.6, y1 - 0.6], (3, 2)):
            canvas.box(x - 0.3, y - 0.2, x + 0.3, y + 0.2)


def vineyard(seed: int) -> LaserWorld:
    """Four rows of trunks and posts with gaps, driven up and down, and a few trees at the headlands."""
    rng = np.random.default_rng([seed, 2])
    vines, rows = int(rng.integers(12, 17)), 4
    width, height = VINE_SPACING * (vines - 1) + 2 * HEADLAND, ROW_SPACING * (rows + 1)
    canvas = Canvas(width, height)
    for row in range(rows):
        y = ROW_SPACING * (row + 1)
        for vine in range(vines):
            x = HEADLAND + VINE_SPACING * vine
            if rng.random() > 0.06:
                canvas.disc(x + rng.normal(0, 0.06), y + rng.normal(0, 0.04), rng.uniform(0.02, 0.05))
            if vine % 4 == 0:
                canvas.disc(x + 0.5 * VINE_SPACING * (vine > 0), y, 0.04)
    for k in range(6):
        x = rng.uniform(0.3, 1.2)
        canvas.disc(x if k % 2 else width - x, rng.uniform(0.5, height - 0.5), rng.uniform(0.1, 0.25))
    near, far = HEADLAND - 1.8, width - HEADLAND + 1.8
    aisles = [ROW_SPACING * (k + 0.5) for k in range(rows + 1)]
    way = [(x, y) for k, y in enumerate(aisles) for x in ((near, far) if k % 2 == 0 else (far, near))]
    return LaserWorld(grid=canvas.grid(), corners=np.array([*way, (far, aisles[0]), (near, aisles[0])]))


def way_of(world: LaserWorld, step: float = STEP, turn: float = 0.3) -> Array:
    """Poses (n, 3) of a robot that drives from corner to corner and turns on the spot at each."""
    poses: list[Array] = []
    for start, end in pairwise(world.corners):
        way, length = end - start, float(np.hypot(*(end - start)))
        yaw = float(np.arctan2(way[1], way[0]))
        if poses:
            left = between(poses[-1], np.array([*start, yaw]))[2]
            count = int(abs(left) / turn)
            poses += [np.array([*start, poses[-1][2] + left * (k + 1) / (count + 1)]) for k in range(count)]
        poses += [np.array([*(start + way * s / length), yaw]) for s in np.arange(0.0, length, step)]
    return np.array(poses)


def drifting(poses: Array, rng: np.random.Generator, noise: float = 0.03, bias: float = 0.004) -> Array:
    """Odometry (n, 3) of the poses: each step's length and turn are off by `noise`, and it turns by `bias` a step."""
    steps = between(poses[:-1], poses[1:])
    steps[:, :2] *= 1.0 + noise * rng.standard_normal((len(steps), 1))
    steps[:, 2] = steps[:, 2] * (1.0 + noise * rng.standard_normal(len(steps))) + bias
    return chained(steps, poses[0])


def laser_scans(
    grid: OccupancyGrid,
    poses: Array,
    rng: np.random.Generator,
    noise: float = 0.01,
    mount: Array | None = None,
    clutter: float = 0.0,
) -> list[LaserScan]:
    """Scans of 181 beams over 180 degrees, one a second.

    Args:
        noise: m, standard deviation of a range.
        clutter: share of the beams that end anywhere before the wall, at weeds or people that no map has.
    """
    sensors = poses if mount is None else compose(poses, mount)
    ranges = predicted_ranges(grid, sensors, BEAMS, MAX_RANGE)
    ranges = np.maximum(ranges + noise * rng.standard_normal(ranges.shape), 0.01)
    if clutter > 0.0:
        short = rng.uniform(0.3, np.minimum(ranges, MAX_RANGE).clip(0.31))
        ranges = np.where(rng.random(ranges.shape) < clutter, short, ranges)
    return [
        LaserScan(
            stamp=float(k), angle_min=float(BEAMS[0]), angle_increment=float(np.radians(1.0)),
            range_min=0.0, range_max=MAX_RANGE, ranges=row,
        )
        for k, row in enumerate(ranges)
    ]  # fmt: skip
