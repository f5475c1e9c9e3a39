"""More layers of a costmap: a static map, noise removed, the robot's own place, range cones, inflation in between.

Source: Lu, Hershberger and Smart, Layered costmaps for context-sensitive navigation, IROS 2014; the layers of Nav2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, frozen_array
from grape.navigation.costmap import Beams, InflationOptions, inflate
from grape.navigation.grid import FREE, LETHAL, UNKNOWN, Footprint, GridSpec


@dataclass(frozen=True, kw_only=True)
class StaticOptions:
    """How occupancies become costs.

    Args:
        occupied, free: percent from which on a cell is lethal, up to which it is free.
        between: what lies between them: "unknown", or costs 1..252 in "scale".
        unknown: whether cells nobody knows stay unknown; else they count as free.
        overwrite: whether known cells replace what earlier layers painted, instead of only raising it.
    """

    occupied: float = 65.0
    free: float = 25.0
    between: Literal["unknown", "scale"] = "unknown"
    unknown: bool = True
    overwrite: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.free < self.occupied <= 100.0:
            raise InvalidInput(f"0 <= free < occupied <= 100 percent, got {self.free} and {self.occupied}")
        if self.between not in ("unknown", "scale"):
            raise InvalidInput(f"between must be 'unknown' or 'scale', got {self.between!r}")


class StaticLayer:
    """A map that was made before, as of SLAM or of a ROS map file, of any resolution.

    Args:
        occupancy: (rows, columns) percent 0..100, -1 unknown (nav_msgs/OccupancyGrid); row 0 is the lowest y.
        spec: where its cells are in map.
    """

    def __init__(self, occupancy: Array, spec: GridSpec, options: StaticOptions | None = None) -> None:
        occupancy = np.asarray(occupancy)
        if occupancy.shape != (spec.rows, spec.columns):
            raise InvalidInput(f"the occupancy must be of {(spec.rows, spec.columns)}, got {occupancy.shape}")
        if not ((occupancy >= -1) & (occupancy <= 100)).all():
            raise InvalidInput("occupancies must lie in -1 .. 100 percent")
        self.spec, self.options = spec, options or StaticOptions()
        self._cost = _costs(occupancy.astype(float), self.options)

    def paint(self, cost: Array, spec: GridSpec) -> None:
        """Raise (or overwrite) the cells of the grid whose centres lie in the map."""
        i, inside_i = _axis(spec.y_min, spec.rows, spec, self.spec.y_min, self.spec.rows, self.spec)
        j, inside_j = _axis(spec.x_min, spec.columns, spec, self.spec.x_min, self.spec.columns, self.spec)
        if not (inside_i.any() and inside_j.any()):
            return
        own = self._cost[np.ix_(i, j)]
        place = np.ix_(inside_i, inside_j)
        below = cost[place]
        if self.options.overwrite:
            cost[place] = np.where(own == UNKNOWN, below, own)
        else:
            known = np.maximum(np.where(below == UNKNOWN, FREE, below), np.where(own == UNKNOWN, FREE, own))
            # what no layer knows is unknown; what only the map does not know is what the others say
            cost[place] = np.where((own == UNKNOWN) & ((below == UNKNOWN) | (below == FREE)), UNKNOWN, known)


def _costs(occupancy: Array, options: StaticOptions) -> Array:
    share = (occupancy - options.free) / (options.occupied - options.free)
    scaled = np.clip(np.round(1.0 + 251.0 * share), 1, 252)
    cost = np.where(occupancy >= options.occupied, LETHAL, scaled if options.between == "scale" else UNKNOWN)
    cost = np.where(occupancy <= options.free, FREE, cost)
    cost = np.where(occupancy < 0, UNKNOWN, cost)
    if not options.unknown:
        cost = np.where(cost == UNKNOWN, FREE, cost)
    return frozen_array(cost, np.uint8)


def _axis(low: float, count: int, spec: GridSpec, own_low: float, own_count: int, own: GridSpec) -> tuple[Array, Array]:
    """Indices into the own axis of the cells of another one that lie in it (k,), and which those are (count,)."""
    centres = low + (np.arange(count) + 0.5) * spec.resolution
    index = np.floor((centres - own_low) / own.resolution + 1e-9).astype(np.int64)
    inside = (index >= 0) & (index < own_count)
    return index[inside], inside


class DenoiseLayer:
    """Frees lethal cells of earlier layers that hang together in groups of fewer than `least` cells (8 neighbours)."""

    def __init__(self, least: int = 2) -> None:
        if least < 1:
            raise InvalidInput(f"a group has at least 1 cell, got {least}")
        self.least = least

    def paint(self, cost: Array, spec: GridSpec) -> None:
        """Lower the cells of small groups to free."""
        import cv2

        count, labels, stats, _ = cv2.connectedComponentsWithStats((cost == LETHAL).astype(np.uint8), connectivity=8)
        small = stats[:, cv2.CC_STAT_AREA] < self.least
        small[0] = False  # the background
        if count > 1 and small.any():
            cost[small[labels]] = FREE


class FootprintLayer:
    """Frees what earlier layers painted under the robot itself: it stands there, so nothing else does."""

    def __init__(self, footprint: Footprint | None = None) -> None:
        self.footprint = footprint or Footprint()
        self.pose: Array | None = None  # (3,) x y yaw in map

    def stand_at(self, pose: Array) -> None:
        """The robot is at `pose` (3,) x y yaw in map.

        Raises:
            InvalidInput: the pose is not finite.
        """
        pose = np.asarray(pose, dtype=float)
        if pose.shape != (3,) or not np.isfinite(pose).all():
            raise InvalidInput(f"a pose has 3 finite numbers, got {pose}")
        self.pose = pose

    def paint(self, cost: Array, spec: GridSpec) -> None:
        """Lower the cells whose centres the footprint covers to free."""
        if self.pose is None:
            return
        reach = self.footprint.circumscribed
        low, high = spec.cells(np.array([self.pose[:2] - reach, self.pose[:2] + reach]))
        (i0, j0), (i1, j1) = np.maximum(low, 0), np.minimum(high + 1, [spec.rows, spec.columns])
        if i0 >= i1 or j0 >= j1:
            return
        i, j = np.mgrid[i0:i1, j0:j1]
        d = spec.centres(np.stack([i, j], axis=-1)) - self.pose[:2]
        c, s = np.cos(self.pose[2]), np.sin(self.pose[2])
        own = np.stack([c * d[..., 0] + s * d[..., 1], -s * d[..., 0] + c * d[..., 1]], axis=-1)
        cost[i0:i1, j0:j1][self.footprint.contains(own)] = FREE


class InflationLayer:
    """Inflates what earlier layers painted; what comes after it, such as exact fences, is not inflated."""

    def __init__(self, options: InflationOptions | None = None) -> None:
        self.options = options or InflationOptions()

    def paint(self, cost: Array, spec: GridSpec) -> None:
        """Raise the surroundings of lethal cells."""
        cost[:] = inflate(cost, spec.resolution, self.options)


def beams_from_range(distance: float, sensor: Array, opening: float, most: float, spacing: float = 0.05) -> Beams:
    """Beams of one ultrasonic echo, which may come from anywhere on the arc: all of it marks, all of the cone clears.

    Args:
        distance: m measured; from `most` on, or +inf, nothing was met.
        sensor: (3,) x y yaw in map.
        opening: rad, full angle of the cone.
        spacing: m between beams on the arc.

    Raises:
        InvalidInput: a distance that is NaN, negative or -inf (REP-117: no measurement), or no cone.
    """
    if np.isnan(distance) or distance < 0 or not (opening > 0 and most > 0 and spacing > 0):
        raise InvalidInput(f"distance must be >= 0, opening, most and spacing > 0, got {distance}, {opening}, {most}")
    sensor = np.asarray(sensor, dtype=float)
    r = min(distance, most)
    angles = sensor[2] + opening * np.linspace(-0.5, 0.5, 2 + int(r * opening / spacing))
    ends = sensor[:2] + r * np.column_stack([np.cos(angles), np.sin(angles)])
    return Beams(sensor=sensor[:2], ends=ends, hit=np.full(len(angles), distance < most))
