"""Layered costmaps: what sensors saw, what the site prohibits, and how near is too near.

Source: Lu, Hershberger and Smart, Layered costmaps for context-sensitive navigation, IROS 2014.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, frozen_array
from grape.navigation.grid import FREE, INSCRIBED, LETHAL, UNKNOWN, Costmap, Footprint, GridSpec


class Layer(Protocol):
    """One source of costs."""

    def paint(self, cost: Array, spec: GridSpec) -> None:
        """Raise the costs (rows, columns) uint8 of the grid `spec` where this layer knows better."""
        ...


@dataclass(frozen=True, kw_only=True)
class InflationOptions:
    """Costs around lethal cells: inscribed within the robot's radius, then exp(-scaling d) up to `radius` m."""

    inscribed: float = Footprint().inscribed
    radius: float = 0.80
    scaling: float = 6.0  # 1/m


@dataclass(frozen=True, kw_only=True)
class Beams:
    """Horizontal rays in the map: from `sensor` (2,) to `ends` (n, 2) m, and whether something was `hit` there (n,)."""

    sensor: Array
    ends: Array
    hit: Array


class PolygonLayer:
    """Prohibited polygons in map: fences and the strips along rows. Cells that a polygon touches are lethal."""

    def __init__(self, polygons: Sequence[Array]) -> None:
        self.polygons = tuple(np.asarray(polygon, dtype=float) for polygon in polygons)
        for polygon in self.polygons:
            if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not np.isfinite(polygon).all():
                raise InvalidInput(f"a polygon needs at least 3 finite points (n, 2), got {polygon.shape}")
        self._painted: tuple[GridSpec, Array] | None = None

    def paint(self, cost: Array, spec: GridSpec) -> None:
        """Make the cells of all polygons lethal."""
        if self._painted is None or self._painted[0] != spec:
            self._painted = spec, self._mask(spec)
        cost[self._painted[1]] = LETHAL

    def _mask(self, spec: GridSpec) -> Array:
        import cv2

        mask = np.zeros((spec.rows, spec.columns), dtype=np.uint8)
        shift = 6  # cv2 takes fixed-point coordinates; integers mean centres of cells
        for polygon in self.polygons:
            points = ((polygon - spec.origin) / spec.resolution - 0.5) * 2**shift
            cv2.fillPoly(mask, [np.round(points).astype(np.int32)], 1, shift=shift)
        return mask.astype(bool)


class ObstacleLayer:
    """What one range sensor saw: beams that end in a hit mark, beams that pass clear.

    A cell counts as an obstacle from `threshold` on: `gain` per hit, minus one per passing scan, at most `most`, so
    single echoes from weeds vanish and people who left are forgotten.
    """

    def __init__(self, spec: GridSpec, *, gain: int = 3, threshold: int = 4, most: int = 12) -> None:
        self.spec = spec
        self.gain, self.threshold, self.most = gain, threshold, most
        self._evidence = np.zeros((spec.rows, spec.columns), dtype=np.int16)

    def integrate(self, beams: Beams) -> None:
        """Take one scan into account."""
        from grape.navigation.grid_kernels import mark_and_clear

        if not (np.isfinite(beams.sensor).all() and np.isfinite(beams.ends).all()):
            raise InvalidInput("beams must be finite; cut them at the clearing range first")
        mark_and_clear(
            self._evidence,
            self.spec.x_min,
            self.spec.y_min,
            self.spec.resolution,
            np.ascontiguousarray(beams.sensor, dtype=float),
            np.ascontiguousarray(beams.ends, dtype=float),
            np.ascontiguousarray(beams.hit, dtype=np.bool_),
            self.gain,
            1,
            self.most,
        )

    def move_to(self, centre: Array) -> None:
        """Roll the window so that `centre` (2,) m is in its middle; what leaves it is forgotten."""
        spec = self.spec
        size = np.array([spec.columns, spec.rows]) * spec.resolution
        low = np.floor((np.asarray(centre)[:2] - 0.5 * size) / spec.resolution)
        old = np.round(spec.origin / spec.resolution)
        shift = (low - old).astype(int)
        if not shift.any():
            return
        moved = np.zeros_like(self._evidence)
        source, target = _overlap(spec.rows, shift[1]), _overlap(spec.columns, shift[0])
        moved[source[1], target[1]] = self._evidence[source[0], target[0]]
        self._evidence = moved
        x, y = low * spec.resolution
        self.spec = GridSpec(x_min=x, y_min=y, columns=spec.columns, rows=spec.rows, resolution=spec.resolution)

    def forget(self, centre: Array, radius: float) -> None:
        """Drop everything within `radius` m of `centre` (2,): the recovery that clears the costmap."""
        i, j = np.indices(self._evidence.shape)
        points = self.spec.centres(np.stack([i, j], axis=-1))
        self._evidence[radius >= np.hypot(*(points - np.asarray(centre)[:2]).T).T] = 0

    def points(self) -> Array:
        """Centres (n, 2) m of the cells with enough evidence."""
        return self.spec.centres(np.argwhere(self._evidence >= self.threshold))

    def paint(self, cost: Array, spec: GridSpec) -> None:
        """Make the cells with enough evidence lethal; the two grids may differ by whole cells."""
        seen = self._evidence >= self.threshold
        if spec == self.spec:
            cost[seen] = LETHAL
            return
        cells = spec.cells(self.points())
        cells = cells[spec.contains(cells)]
        cost[cells[:, 0], cells[:, 1]] = LETHAL


def _overlap(size: int, shift: int) -> tuple[slice, slice]:
    """Source and target slices of an axis that moves by `shift` cells."""
    kept = max(0, size - abs(shift))
    if shift >= 0:
        return slice(size - kept, size), slice(0, kept)
    return slice(0, kept), slice(size - kept, size)


def inflate(cost: Array, resolution: float, options: InflationOptions) -> Array:
    """Costs with the surroundings of lethal cells raised; unknown cells stay unknown unless they come near."""
    import cv2

    lethal = cost == LETHAL
    if not lethal.any():
        return cost.copy()
    distance = cv2.distanceTransform((~lethal).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    raised_by = _cost_by_square(resolution, options)
    square = np.minimum(np.rint(distance * distance), len(raised_by) - 1).astype(np.intp)  # in cells: whole numbers
    raised = raised_by.take(square)
    inflated = np.maximum(cost, raised)
    np.copyto(inflated, raised, where=(cost == UNKNOWN) & (raised >= INSCRIBED))
    return inflated


@lru_cache(maxsize=16)
def _cost_by_square(resolution: float, options: InflationOptions) -> Array:
    """(n,) uint8 what a lethal cell makes of a cell so many squared cells away; the last one is 0."""
    last = int((max(options.radius, options.inscribed) / resolution) ** 2) + 2
    distance = np.sqrt(np.arange(last)) * resolution - 1e-9  # so that ten cells of 0.07 m are within 0.7 m
    decay = np.exp(-options.scaling * np.maximum(distance - options.inscribed, 0.0))
    raised = np.minimum(INSCRIBED - 1, np.round((INSCRIBED - 1) * decay))
    raised[distance > options.radius] = FREE
    raised[distance <= options.inscribed] = INSCRIBED
    raised[0] = LETHAL
    return frozen_array(raised, np.uint8)


def layered_costmap(
    spec: GridSpec, layers: Sequence[Layer], options: InflationOptions | None = None, background: int = FREE
) -> Costmap:
    """Paint all layers over the background and inflate the result."""
    cost = np.full((spec.rows, spec.columns), background, dtype=np.uint8)
    for layer in layers:
        layer.paint(cost, spec)
    return Costmap(spec=spec, cost=inflate(cost, spec.resolution, options or InflationOptions()))
