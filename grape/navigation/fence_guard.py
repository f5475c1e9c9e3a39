"""Keeps commands of the base from leading into prohibited polygons, exactly and without a grid.

Source: Liang and Barsky, A new concept and method for line clipping, ACM TOG 3(1), 1984.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grape.messages import Array
from grape.navigation.grid import Footprint
from grape.navigation.monitor import arc_poses
from grape.navigation.polygon import in_polygon


@dataclass(frozen=True, kw_only=True)
class FenceOptions:
    """How far ahead is looked.

    Args:
        react_s: until braking begins; `deceleration`, m/s^2 and rad/s^2, from then on.
        leave_s: a robot that is inside already may move if the motion leads out of the fence within this time.
    """

    react_s: float = 0.1
    deceleration: float = 1.0
    leave_s: float = 3.0


class FenceGuard:
    """Judges commands by the polygons (n, 2) m in map that the footprint must not touch."""

    def __init__(self, polygons: Sequence[Array], footprint: Footprint, options: FenceOptions | None = None) -> None:
        self.options = options or FenceOptions()
        self._polygons = tuple(np.asarray(polygon, dtype=float) for polygon in polygons)
        self._print = footprint

    @property
    def empty(self) -> bool:
        """Whether there is nothing to keep out of."""
        return not self._polygons

    def factor(self, v: float, w: float, pose: Array) -> float:
        """The largest of 1, 1/2, 1/4 and 0 by which a command of v (m/s), w (rad/s) keeps out of all polygons.

        Args:
            pose: (3,) x y yaw of base_link in map; 0 where it is no number.
        """
        if not np.isfinite(pose).all():
            return 0.0
        near = self._near(pose, abs(v) * self.options.leave_s)
        if not near:
            return 1.0
        if self._touched(near, pose[None])[0]:
            return 1.0 if np.isfinite(self.way_out_s(v, w, pose)) else 0.0
        for factor in (1.0, 0.5, 0.25):
            # Whoever is outside comes in over an edge.
            if not self._crossed(near, self._sweep(factor * v, factor * w, pose)).any():
                return factor
        return 0.0

    def stands_in(self, pose: Array) -> bool:
        """Whether the footprint at `pose` (3,) x y yaw in map is on a polygon."""
        return bool(self._touched(self._near(pose, 0.0), pose[None])[0])

    def way_out_s(self, v: float, w: float, pose: Array) -> float:
        """After how many s a command leads a footprint that is in a fence out, to stay out; inf: not in `leave_s`."""
        poses = _along(v, w, pose, self.options.leave_s)
        touched = self._touched(self._near(pose, abs(v) * self.options.leave_s), poses)
        if touched[-1] or (np.diff(touched.astype(int)) > 0).any():
            return np.inf
        return self.options.leave_s * int(touched.sum()) / (len(poses) - 1)

    def _near(self, pose: Array, travel: float) -> list[Array]:
        reach = self._print.circumscribed + travel
        low, high = pose[:2] - reach, pose[:2] + reach
        return [p for p in self._polygons if (p.max(axis=0) >= low).all() and (p.min(axis=0) <= high).all()]

    def _sweep(self, v: float, w: float, pose: Array) -> Array:
        """Poses (n, 3) until standstill, as if the speed stayed till then."""
        options = self.options
        return _along(v, w, pose, options.react_s + max(abs(v), abs(w)) / options.deceleration)

    def _touched(self, polygons: list[Array], poses: Array) -> Array:
        """Which of the poses (n, 3) put the footprint on a polygon: (n,) bool."""
        if not polygons:
            return np.zeros(len(poses), bool)
        touched = self._crossed(polygons, poses)
        for polygon in polygons:
            touched |= in_polygon(poses[:, :2], polygon)
        return touched

    def _crossed(self, polygons: list[Array], poses: Array) -> Array:
        """At which poses (n, 3) an edge passes through the footprint: (n,) bool."""
        corners, ends = np.vstack(polygons), np.vstack([np.roll(p, -1, axis=0) for p in polygons])  # (k, 2) m, map
        c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
        dx, dy = corners[:, 0] - poses[:, 0, None], corners[:, 1] - poses[:, 1, None]
        start = np.stack([c * dx + s * dy, -s * dx + c * dy], axis=-1)  # (n, k, 2) m, base_link
        dx, dy = (ends - corners).T
        step = np.stack([c * dx + s * dy, -s * dx + c * dy], axis=-1)
        print_ = self._print
        low, high = np.array([-print_.rear, -print_.half_width]), np.array([print_.front, print_.half_width])
        still = np.abs(step) < 1e-12
        safe = np.where(still, 1.0, step)
        first, second = (low - start) / safe, (high - start) / safe
        between = (start >= low) & (start <= high)
        enter = np.where(still, np.where(between, -np.inf, np.inf), np.minimum(first, second)).max(axis=-1)
        leave = np.where(still, np.where(between, np.inf, -np.inf), np.maximum(first, second)).min(axis=-1)
        return ((enter <= leave) & (leave >= 0.0) & (enter <= 1.0)).any(axis=1)


def _along(v: float, w: float, pose: Array, duration_s: float) -> Array:
    """Poses (n, 3) in map of a base that keeps a command, no more than 5 cm or 0.1 rad apart."""
    count = 2 + int(max(abs(v) / 0.05, abs(w) / 0.1) * duration_s)
    moves = arc_poses(v, w, np.linspace(0.0, duration_s, count))
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = moves[:, 0], moves[:, 1]
    return np.column_stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y, pose[2] + moves[:, 2]])
