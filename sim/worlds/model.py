"""The world as plain frozen values: what stands where, and the truth that only the referee and tests may use."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from grape.messages import Array
from grape.sim.worlds.options import WalkerOptions
from grape.site import Site

Color = tuple[float, float, float, float]


class Label(IntEnum):
    """What a piece of the world is."""

    GROUND = 0
    TRUNK = 1
    ARM = 2
    SPUR = 3
    BUD = 4
    CANE = 5
    WIRE = 6
    POST = 7
    NAIL = 8
    BOARD = 9
    MARKER = 10
    WEED = 11


@dataclass(frozen=True, kw_only=True)
class Capsule:
    """A rod with round ends from `p0` to `p1` (m, map frame). `plant` is empty for posts, wires and weeds."""

    name: str
    p0: Array  # (3,)
    p1: Array  # (3,)
    radius: float
    label: Label
    rgba: Color
    plant: str = ""


@dataclass(frozen=True, kw_only=True)
class Plate:
    """A flat box; its z axis looks out of the face, x to the right and y up as seen by who looks at the face."""

    name: str
    T_map_plate: Array  # (4, 4) of the box's centre
    half_size: Array  # (3,) m
    label: Label
    rgba: Color
    plant: str = ""
    marker_id: int | None = None


@dataclass(frozen=True, kw_only=True)
class Terrain:
    """Heights on a regular grid: `heights[i, j]` is z at y = y0 + i * step_y and x = x0 + j * step_x (m, map frame)."""

    heights: Array  # (rows along y, columns along x)
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    slope: float

    @property
    def xs(self) -> Array:
        """x of the columns."""
        return np.linspace(*self.x_range, self.heights.shape[1])

    @property
    def ys(self) -> Array:
        """y of the rows."""
        return np.linspace(*self.y_range, self.heights.shape[0])

    def height(self, xy: Array) -> Array:
        """z (...,) of the ground at points (..., 2), bilinear; outside the grid the nearest edge."""
        xy = np.asarray(xy, dtype=float)
        ny, nx = self.heights.shape
        u = np.clip((xy[..., 0] - self.x_range[0]) / (self.x_range[1] - self.x_range[0]), 0, 1) * (nx - 1)
        v = np.clip((xy[..., 1] - self.y_range[0]) / (self.y_range[1] - self.y_range[0]), 0, 1) * (ny - 1)
        j, i = np.minimum(u.astype(int), nx - 2), np.minimum(v.astype(int), ny - 2)
        u, v = u - j, v - i
        h = self.heights
        low = h[i, j] * (1 - u) + h[i, j + 1] * u
        high = h[i + 1, j] * (1 - u) + h[i + 1, j + 1] * u
        return low * (1 - v) + high * v


@dataclass(frozen=True, kw_only=True)
class Sun:
    """Direction in which light travels (unit vector, map frame) and colours 0..1.

    Attributes:
        gloss_rad: how far from its mirror image in a marker the sun still blinds a camera.
    """

    direction: Array  # (3,)
    diffuse: tuple[float, float, float]
    ambient: tuple[float, float, float]
    sky_top: tuple[float, float, float]
    sky_horizon: tuple[float, float, float]
    gloss_rad: float = 0.0


@dataclass(frozen=True, kw_only=True)
class SpurTruth:
    """A spur as it really is: `direction` is the unit vector from base to tip (map frame)."""

    id: str
    plant: str
    base: Array  # (3,)
    tip: Array  # (3,) the outermost point
    direction: Array  # (3,)
    diameter: float


@dataclass(frozen=True, kw_only=True)
class NailTruth:
    """A nail as it really is: `direction` is the unit vector from the board to the tip (map frame)."""

    id: str
    base: Array  # (3,) where it leaves the board
    tip: Array  # (3,) the outermost point
    direction: Array  # (3,)
    diameter: float
    markers: tuple[int, int]  # left and right as the robot sees them


@dataclass(frozen=True, kw_only=True)
class World:
    """A vineyard: geometry to show, touch and range, the site file's content, and the truth."""

    site: Site
    terrain: Terrain
    sun: Sun
    capsules: tuple[Capsule, ...]
    plates: tuple[Plate, ...]
    spurs: tuple[SpurTruth, ...]  # truth, for the referee and tests only
    nails: tuple[NailTruth, ...]  # truth, for the referee and tests only
    walkers: tuple[WalkerOptions, ...] = ()
