"""What has come to where nothing was: people and animals, told from what stood there but was hidden before."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from grape.geometry import wrap_angle
from grape.messages import Array
from grape.navigation.costmap import Beams
from grape.navigation.path import Path


@dataclass(frozen=True, kw_only=True)
class NewcomerOptions:
    """What counts as having come.

    Args:
        since_s: two scans that are so far apart are compared.
        margin: m that a beam must have reached farther before.
        gap: rad between neighbouring beams above which nothing is known between them.
        skew: rad that the heading may have been wrong by: what a beam hit so near to a bearing counts as seen there.
        least_points: fewer points than this are a cane or a weed.
    """

    since_s: float = 1.0
    margin: float = 0.3
    gap: float = 0.02
    skew: float = 0.06
    least_points: int = 6


class NewcomerWatch:
    """Compares the scans of one scanner with those of a while before."""

    def __init__(self, options: NewcomerOptions | None = None) -> None:
        self.options = options or NewcomerOptions()
        self._kept: deque[tuple[float, Beams]] = deque()

    def update(self, stamp: float, beams: Beams) -> Array:
        """Points (n, 2) m in map of a scan where there was free space `since_s` before; none until that is known."""
        while len(self._kept) > 1 and self._kept[1][0] <= stamp - self.options.since_s + 1e-9:
            self._kept.popleft()
        self._kept.append((stamp, beams))
        before_s, before = self._kept[0]
        if stamp - before_s < self.options.since_s - 1e-9:
            return np.empty((0, 2))
        return newcomers(beams, before, self.options)


@dataclass(frozen=True, kw_only=True)
class PassingOptions:
    """Near which part of a path nobody may walk while the robot drives.

    Args:
        ahead: m along the path.
        beside: m from the middle of the robot.
        still_s: after which who has come and stands counts as an obstacle like any other.
        least_points: as of `NewcomerOptions`.
    """

    ahead: float = 2.5
    beside: float = 0.95
    still_s: float = 1.5
    least_points: int = 6


@dataclass(kw_only=True)
class PassingWatch:
    """Whether somebody walks near the path ahead, or did a moment ago."""

    options: PassingOptions = field(default_factory=PassingOptions)
    _walked_s: float = field(init=False, default=-np.inf)

    def update(self, now: float, arrived: Array, path: Path, travelled: float) -> Array | None:
        """Where (2,) m in map somebody begins to walk near the path; None when nobody does, or still does.

        Args:
            arrived: (n, 2) m in map, as of `NewcomerWatch`.
            path: that the robot follows, and how far (m) it has `travelled` on it.
        """
        ahead = path.ahead(travelled, travelled + self.options.ahead)
        walking = arrived[near_path(arrived, ahead, self.options.beside)]
        if len(walking) < self.options.least_points:
            return None
        begins = not self.holds(now)
        self._walked_s = now
        return walking.mean(axis=0) if begins else None

    def holds(self, now: float) -> bool:
        """Whether to stand."""
        return now - self._walked_s <= self.options.still_s


def newcomers(now: Beams, before: Beams, options: NewcomerOptions) -> Array:
    """Hits (n, 2) m in map of one scan at which beams of an earlier one had passed."""
    from scipy.ndimage import minimum_filter1d

    points = now.ends[now.hit]
    rays = before.ends - before.sensor
    if len(rays) < 2 or not len(points):
        return np.empty((0, 2))
    bearings = np.arctan2(rays[:, 1], rays[:, 0])
    order = np.argsort(bearings)
    bearings, reach = bearings[order], np.hypot(*rays.T)[order]
    offset = points - before.sensor
    bearing = np.arctan2(offset[:, 1], offset[:, 0])
    after = np.searchsorted(bearings, bearing) % len(bearings)
    known = np.abs(wrap_angle(bearings[after] - bearings[after - 1])) < options.gap
    beside = 1 + int(options.skew / max(float(np.median(np.diff(bearings))), 1e-4))
    free = minimum_filter1d(reach, 2 * beside + 1, mode="wrap")[after]
    return points[known & (free > np.hypot(*offset.T) + options.margin)]


def near_path(points: Array, path: Array, distance: float) -> Array:
    """Which of the points (n, 2) m are nearer than `distance` m to poses (k, 3) of a path: (n,) bool."""
    if not len(points) or not len(path):
        return np.zeros(len(points), dtype=bool)
    gaps = np.linalg.norm(points[:, None] - path[None, :, :2], axis=2)
    return gaps.min(axis=1) < distance
