"""A vineyard on paper for tuning local planners: rows, fences, obstacles, and a base that slips, lags and drifts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from grape.geometry import pose as make_pose
from grape.geometry import rotation_z
from grape.messages import Array, LaserScan
from grape.navigation.grid import Footprint
from grape.navigation.path import in_frame_of
from grape.navigation.route import RouteOptions, parking_pose, row_zones

_ROOM_M = 0.27  # between a parked robot and the obstacle: as near as the collision monitor lets it back up
T_BASE_LASER = make_pose(translation=(0.45, 0.0, 0.20))
_FIRST, _STEP, _BEAMS = -np.pi, float(np.radians(0.75)), 480


@dataclass(frozen=True)
class Line:
    """A row."""

    id: str
    line: Array


@dataclass(frozen=True, kw_only=True)
class Goal:
    """Where to drive, and what kind of drive that is."""

    kind: str
    pose: Array  # (3,) x y yaw in map


@dataclass(frozen=True, kw_only=True)
class Yard:
    """One seed's vineyard.

    Args:
        circles: (n, 3) x y radius (m) of trunks, posts, canes and obstacles.
        fences: convex polygons (4, 2) m that nothing of the robot may enter: strips along rows, edges of headlands.
        start: (3,) x y yaw.
    """

    rows: tuple[Line, ...]
    circles: Array
    fences: tuple[Array, ...]
    start: Array
    goals: tuple[Goal, ...]


def yard(seed: int) -> Yard:
    """Three rows, four drives: into a row, on to a plant, past an obstacle in the lane, into another lane."""
    rng = np.random.default_rng([seed, 11])
    spacing, pitch, vines = rng.uniform(2.4, 2.9), rng.uniform(1.0, 1.3), int(rng.integers(7, 10))
    length = pitch * (vines - 1)
    plants = np.array([[[pitch * k, spacing * r] for k in range(vines)] for r in range(3)])
    stops = np.sort(rng.choice(np.arange(0, vines - 3), 2, replace=False))
    obstacle_x = pitch * stops[1] + rng.uniform(1.5, 2.0)
    last = min(vines - 1, int(np.ceil((obstacle_x + 1.6) / pitch)))
    side = rng.choice([-1.0, 1.0])
    lane_y = 0.5 * spacing  # of the lane between the first two rows
    obstacle = [obstacle_x, lane_y + side * rng.uniform(0.45, 0.6) * (0.5 * spacing - 0.28), rng.uniform(0.08, 0.15)]
    change = int(rng.integers(0, 2))
    others = np.roll(plants[change, 1 : vines - 2], 1 - int(rng.integers(1, vines - 2)), axis=0)
    east, west = np.array([1.0, 0.0]), np.array([-1.0, 0.0])
    place = rng.choice(["fore", "aft"], 4)
    goals = (
        Goal(kind="row entry", pose=parking_pose(plants[1, stops[0]], east, place[0])),
        Goal(kind="plant", pose=parking_pose(plants[1, stops[1]], east, place[1])),
        Goal(kind="obstacle", pose=_clear_of(obstacle, plants[1, last:], east, place[2])),
        Goal(kind="row change", pose=_clear_of(obstacle, others, west, place[3])),
    )
    start = np.array([rng.uniform(-2.6, -2.0), rng.uniform(-0.5, spacing), rng.uniform(-np.pi, np.pi)])
    turn = float(rng.uniform(-0.3, 0.3))
    lines = tuple(Line(f"r{r}", _turned(plants[r, [0, -1]], turn)) for r in range(3))
    edges = [_strip(x, -3.0, 2 * spacing + 3.0) for x in (-rng.uniform(3.6, 4.4), length + rng.uniform(3.6, 4.4))]
    circles = np.vstack([_standing(plants, rng), obstacle])
    circles[:, :2] = _turned(circles[:, :2], turn)
    return Yard(
        rows=lines,
        circles=circles,
        fences=(*row_zones(lines, RouteOptions()), *(_turned(edge, turn) for edge in edges)),
        start=_turned_pose(start, turn),
        goals=tuple(Goal(kind=goal.kind, pose=_turned_pose(goal.pose, turn)) for goal in goals),
    )


def _clear_of(obstacle: Sequence[float], plants: Array, direction: Array, place: Literal["fore", "aft"]) -> Array:
    """(3,) where to park for the first of the plants (n, 2) whose place the obstacle leaves room for.

    Args:
        direction: (2,) that the robot faces.
        place: at all plants in turn; where there is room at none, the other place.
    """
    other: Literal["fore", "aft"] = "aft" if place == "fore" else "fore"
    poses = (parking_pose(plant, direction, choice) for choice in (place, other) for plant in plants)
    return next(pose for pose in poses if gap_to_circles(pose, np.array([obstacle]), Footprint()) > _ROOM_M)


def _standing(plants: Array, rng: np.random.Generator) -> Array:
    """(n, 3) circles of trunks, posts and canes that stick out, within the strips of the rows."""
    flat = plants.reshape(-1, 2)
    trunks = np.column_stack([flat + rng.normal(0.0, 0.03, flat.shape), rng.uniform(0.02, 0.05, len(flat))])
    out = rng.uniform([-0.4, -0.24], [0.4, 0.24], (2 * len(flat), 2))
    canes = np.column_stack([np.repeat(flat, 2, axis=0) + out, np.full(2 * len(flat), 0.01)])
    between = np.array([0.5 * (plants[0, 1, 0] - plants[0, 0, 0]), 0.0])
    posts = plants[:, ::4].reshape(-1, 2) + between
    return np.vstack([trunks, canes, np.column_stack([posts, np.full(len(posts), 0.05)])])


def _strip(x: float, low: float, high: float) -> Array:
    return np.array([[x - 0.1, low], [x + 0.1, low], [x + 0.1, high], [x - 0.1, high]])


def _turned(points: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points) @ np.array([[c, s], [-s, c]])


def _turned_pose(pose: Array, angle: float) -> Array:
    return np.array([*_turned(pose[:2], angle), pose[2] + angle])


def scan_of(circles: Array, pose: Array, rng: np.random.Generator, sigma: float = 0.015) -> LaserScan:
    """What a robot at `pose` (3,) that looks all around, as by its 3-D LiDAR, sees of circles (n, 3) within 6 m."""
    from grape.experiments.driving_kernels import ranges_to_circles

    T = make_pose(rotation_z(pose[2]), (pose[0], pose[1], 0.0)) @ T_BASE_LASER
    near = circles[np.hypot(*(circles[:, :2] - T[:2, 3]).T) < 6.0]
    r = ranges_to_circles(near, T[0, 3], T[1, 3], float(pose[2]) + _FIRST, _STEP, _BEAMS)
    return LaserScan(
        stamp=0.0,
        angle_min=_FIRST,
        angle_increment=_STEP,
        range_min=0.1,
        range_max=30.0,
        ranges=r + rng.normal(0.0, sigma, _BEAMS),
    )


@dataclass
class Base:
    """A skid-steer base: it lags, slips, turns less than told, and drifts while it turns without noticing."""

    pose: Array
    rng: np.random.Generator
    turn_ratio: float = 0.75
    v: float = 0.0
    w: float = 0.0
    time_s: float = 0.0
    sigma: float = 0.01  # m, and 0.4 times that in rad, of the pose estimate
    error: Array = field(default_factory=lambda: np.zeros(3))
    unseen: Array = field(default_factory=lambda: np.zeros(2))  # m in map, drift that the estimate lacks
    slip: Array = field(default_factory=lambda: np.zeros(2))
    drift: Array = field(default_factory=lambda: np.zeros(2))  # m per rad, along and across
    track: list[Array] = field(default_factory=list)
    driven: float = 0.0

    @staticmethod
    def seeded(start: Array, seed: int) -> Base:
        """A base of its own for each seed."""
        rng = np.random.default_rng([seed, 12])
        return Base(np.array(start, dtype=float), rng, turn_ratio=float(rng.uniform(0.55, 1.1)))

    def drive(self, v: float, w: float, dt: float) -> None:
        """Follow a command for dt s."""
        if abs(self.w) < 0.05:  # every turn drifts its own way, up to 18 cm in 40 degrees
            angle = self.rng.uniform(-np.pi, np.pi)
            size = self.rng.uniform(0.0, 0.18 / np.radians(40.0))
            self.drift = size * np.array([np.cos(angle), np.sin(angle)])
        for _ in range(5):
            self._advance(v, w, dt / 5)
        self.unseen = self.unseen * np.exp(-dt / 1.5)
        noise = self.rng.normal(0.0, 1.0, 3) * [1.0, 1.0, 0.4]
        self.error = 0.95 * self.error + np.sqrt(1.0 - 0.95**2) * self.sigma * noise
        self.time_s += dt
        self.track.append(self.pose.copy())

    def _advance(self, v: float, w: float, h: float) -> None:
        self.slip = 0.99 * self.slip + self.rng.normal(0.0, 0.005, 2)
        self.v += float(np.clip(v - self.v, -1.2 * h, 1.2 * h))
        self.w += float(np.clip(w * self.turn_ratio - self.w, -2.0 * h, 2.0 * h))
        speed = self.v * (1.0 + self.slip[0])
        rate = self.w * (1.0 + self.slip[1]) + 0.3 * self.slip[1] * self.v
        c, s = np.cos(self.pose[2]), np.sin(self.pose[2])
        spot = max(0.0, 1.0 - abs(self.v) / 0.2)  # a rolling base holds its line
        along, across = spot * abs(self.w) * h * self.drift
        aside = np.array([c * along - s * across, s * along + c * across])
        self.unseen = self.unseen + aside
        self.pose = self.pose + np.array([h * speed * c + aside[0], h * speed * s + aside[1], h * rate])
        self.driven += abs(h * speed)

    def estimate(self) -> Array:
        """(3,) x y yaw, as a filter would tell."""
        return self.pose + self.error - [*self.unseen, 0.0]


def gap_to_circles(pose: Array, circles: Array, footprint: Footprint) -> float:
    """Metres between the footprint at `pose` (3,) and the nearest circle (n, 3); negative in contact."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    d = circles[:, :2] - pose[:2]
    x, y = c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]
    out_x = np.maximum(np.maximum(x - footprint.front, -footprint.rear - x), 0.0)
    out_y = np.maximum(np.abs(y) - footprint.half_width, 0.0)
    return float((np.hypot(out_x, out_y) - circles[:, 2]).min(initial=np.inf))


def in_fence(pose: Array, fences: tuple[Array, ...], footprint: Footprint) -> bool:
    """Whether the footprint at `pose` (3,) and a convex polygon overlap: no edge of either separates them."""
    corners = footprint.corners(pose)
    return any(not (_separated(corners, fence) or _separated(fence, corners)) for fence in fences)


def _separated(one: Array, other: Array) -> bool:
    edges = np.roll(one, -1, axis=0) - one
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])
    a, b = one @ normals.T, other @ normals.T
    return bool(((a.max(axis=0) < b.min(axis=0)) | (b.max(axis=0) < a.min(axis=0))).any())


def misses(pose: Array, goal: Array) -> tuple[float, float]:
    """Distance (m) and heading error (rad) between a pose and a goal, both (3,)."""
    along, across, yaw = in_frame_of(pose, goal)
    return float(np.hypot(along, across)), abs(float(yaw))
