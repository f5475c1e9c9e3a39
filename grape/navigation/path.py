"""A way to drive: poses along a line, and where on it the robot is."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import wrap_angle
from grape.messages import Array, frozen_array


@dataclass(frozen=True, kw_only=True)
class Path:
    """Poses (n, 3) x y yaw in map from start to goal; yaw is the robot's heading.

    Args:
        poses: at least two, no two neighbours in the same place.
        reverse: the whole path is driven backwards.
    """

    poses: Array
    reverse: bool = False
    distance: Array = field(init=False)  # (n,) m along the path

    def __post_init__(self) -> None:
        poses = frozen_array(self.poses, float)
        if poses.ndim != 2 or poses.shape[1] != 3 or len(poses) < 2 or not np.isfinite(poses).all():
            raise InvalidInput(f"a path needs finite poses (n >= 2, 3), got {poses.shape}")
        steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        if not (steps > 1e-9).all():
            raise InvalidInput("neighbouring poses of a path must not coincide")
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "distance", frozen_array(np.concatenate([[0.0], np.cumsum(steps)])))

    @property
    def length(self) -> float:
        """Metres from start to goal."""
        return float(self.distance[-1])

    @property
    def goal(self) -> Array:
        """(3,) x y yaw of the last pose."""
        return self.poses[-1]

    def project(self, point: Array, since: float, window: float) -> float:
        """Distance (m) along the path of the point of it nearest to `point` (2,), between since and since + window."""
        first = max(0, int(np.searchsorted(self.distance, since, side="right")) - 1)
        last = min(len(self.poses) - 1, int(np.searchsorted(self.distance, since + window)) + 1)
        a, b = self.poses[first:last, :2], self.poses[first + 1 : last + 1, :2]
        if len(a) == 0:
            return self.length
        d = b - a
        s = np.clip(((point - a) * d).sum(axis=1) / (d * d).sum(axis=1), 0.0, 1.0)
        gap = np.hypot(*(a + s[:, None] * d - point).T)
        k = int(np.argmin(gap))
        return max(since, float(self.distance[first + k] + s[k] * np.hypot(*d[k])))

    def at(self, distance: float) -> Array:
        """(3,) pose at a distance along the path; beyond the goal the path goes on straight."""
        beyond = distance - self.length
        if beyond >= 0:
            sign = -1.0 if self.reverse else 1.0
            x, y, yaw = self.poses[-1]
            return np.array([x + sign * beyond * np.cos(yaw), y + sign * beyond * np.sin(yaw), yaw])
        k = min(len(self.poses) - 2, max(0, int(np.searchsorted(self.distance, distance, side="right")) - 1))
        s = (distance - self.distance[k]) / (self.distance[k + 1] - self.distance[k])
        x, y = (1 - s) * self.poses[k, :2] + s * self.poses[k + 1, :2]
        return np.array([x, y, self.poses[k, 2]])

    def ahead(self, since: float, until: float) -> Array:
        """Poses (m, 3) between two distances along the path."""
        return self.poses[(self.distance >= since) & (self.distance <= until)]


def in_frame_of(pose: Array, reference: Array) -> Array:
    """(3,) along (m), across (m, left positive) and yaw (rad) of a pose seen from a reference pose, both x y yaw."""
    dx, dy = pose[0] - reference[0], pose[1] - reference[1]
    c, s = np.cos(reference[2]), np.sin(reference[2])
    return np.array([c * dx + s * dy, -s * dx + c * dy, wrap_angle(float(pose[2] - reference[2]))])


def straight(start: Array, goal: Array, spacing: float) -> Array:
    """Points (n, 2) m from start to goal (2,), both included, at most `spacing` m apart."""
    count = max(1, int(np.ceil(np.hypot(*(np.asarray(goal)[:2] - np.asarray(start)[:2])) / spacing)))
    s = np.linspace(0.0, 1.0, count + 1)[:, None]
    return (1 - s) * np.asarray(start)[:2] + s * np.asarray(goal)[:2]


def rounded(corners: Array, radius: float, spacing: float) -> Array:
    """Points (n, 2) m along a polyline whose corners (k, 2) become arcs of `radius` m, smaller on short legs."""
    corners = np.asarray(corners, dtype=float)
    pieces = [corners[:1]]
    for k in range(1, len(corners) - 1):
        a, b, c = corners[k - 1], corners[k], corners[k + 1]
        to_a, to_c = a - b, c - b
        la, lc = np.hypot(*to_a), np.hypot(*to_c)
        turn = np.pi - np.arccos(np.clip(to_a @ to_c / (la * lc), -1.0, 1.0))
        if turn < 1e-3 or turn > np.pi - 0.2:
            pieces.append(b[None])
            continue
        tangent = min(radius * np.tan(turn / 2), 0.45 * la, 0.45 * lc)
        r = tangent / np.tan(turn / 2)
        start, end = b + to_a / la * tangent, b + to_c / lc * tangent
        bisector = to_a / la + to_c / lc
        centre = b + bisector / np.hypot(*bisector) * (r / np.cos(turn / 2))
        count = max(2, int(np.ceil(r * turn / spacing)))
        angle0 = np.arctan2(*(start - centre)[::-1])
        sweep = float(wrap_angle(float(np.arctan2(*(end - centre)[::-1]) - angle0)))
        angles = angle0 + sweep * np.linspace(0.0, 1.0, count + 1)
        pieces.append(centre + r * np.column_stack([np.cos(angles), np.sin(angles)]))
    pieces.append(corners[-1:])
    points = np.concatenate(pieces)
    dense = [points[:1]]
    for a, b in pairwise(points):
        if np.hypot(*(b - a)) > 1e-6:
            dense.append(straight(a, b, spacing)[1:])
    return np.concatenate(dense)


def with_headings(points: Array, last_yaw: float | None = None, reverse: bool = False) -> Array:
    """Poses (n, 3) with the heading of each segment; the last one gets `last_yaw` or that of the last segment."""
    d = np.diff(points, axis=0)
    yaw = np.arctan2(d[:, 1], d[:, 0]) + (np.pi if reverse else 0.0)
    yaw = np.append(wrap_angle(yaw), last_yaw if last_yaw is not None else wrap_angle(float(yaw[-1])))
    return np.column_stack([points, yaw])
