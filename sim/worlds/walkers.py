"""People and animals that walk through a world: bodies of rods whose place is a function of time alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.geometry import rotation_z
from grape.messages import Array
from grape.sim.worlds.model import Color, Terrain
from grape.sim.worlds.options import WalkerKind, WalkerOptions


@dataclass(frozen=True, kw_only=True)
class Rod:
    """A capsule of a body: ends (3,) and radius in m, in the walker's frame (x ahead, z up from the ground)."""

    p0: tuple[float, float, float]
    p1: tuple[float, float, float]
    radius: float
    rgba: Color


_CLOTH, _SKIN, _FUR, _BRISTLE = (
    (0.15, 0.25, 0.5, 1.0),
    (0.85, 0.65, 0.5, 1.0),
    (0.5, 0.35, 0.2, 1.0),
    (0.2, 0.17, 0.15, 1.0),
)


def _four_legged(length: float, height: float, girth: float, leg: float, rgba: Color) -> tuple[Rod, ...]:
    """Trunk, head and four legs; `height` is that of the back."""
    z, x, y = height - girth, 0.5 * length - girth, 0.6 * girth
    trunk = Rod(p0=(-x, 0.0, z), p1=(x, 0.0, z), radius=girth, rgba=rgba)
    head = Rod(p0=(x + girth, 0.0, z + 0.05), p1=(x + girth + 0.15, 0.0, z), radius=0.6 * girth, rgba=rgba)
    feet = [(sx * x, sy * y) for sx in (-1.0, 1.0) for sy in (-1.0, 1.0)]
    legs = [Rod(p0=(fx, fy, leg), p1=(fx, fy, z), radius=leg, rgba=rgba) for fx, fy in feet]
    return (trunk, head, *legs)


BODIES: dict[WalkerKind, tuple[Rod, ...]] = {
    "person": (
        Rod(p0=(0.18, 0.10, 0.07), p1=(0.0, 0.10, 0.85), radius=0.07, rgba=_CLOTH),
        Rod(p0=(-0.18, -0.10, 0.07), p1=(0.0, -0.10, 0.85), radius=0.07, rgba=_CLOTH),
        Rod(p0=(0.0, 0.0, 0.95), p1=(0.0, 0.0, 1.35), radius=0.17, rgba=_CLOTH),
        Rod(p0=(0.0, 0.0, 1.60), p1=(0.0, 0.0, 1.65), radius=0.10, rgba=_SKIN),
    ),
    "dog": _four_legged(0.75, 0.55, 0.13, 0.03, _FUR),
    "boar": _four_legged(1.20, 0.75, 0.21, 0.04, _BRISTLE),
}


class Walkers:
    """The walkers of a world: where each is at any time.

    Args:
        options: who walks.
        terrain: they stay on it.
    """

    def __init__(self, options: tuple[WalkerOptions, ...], terrain: Terrain) -> None:
        self.ids = tuple(option.id for option in options)
        self.bodies = tuple(BODIES[option.kind] for option in options)
        self._tracks = tuple(_Track(option) for option in options)
        self._terrain = terrain
        self._ends = [np.array([(rod.p0, rod.p1) for rod in body]) for body in self.bodies]  # (rods, 2, 3)
        self._radii = [np.array([rod.radius for rod in body]) for body in self.bodies]

    def poses(self, time_s: float) -> Array:
        """(walkers, 4) x y z in map (m) and yaw (rad) of each at a time; z is the ground's."""
        places = np.array([track.at(time_s) for track in self._tracks]).reshape(-1, 3)
        return np.column_stack([places[:, :2], self._terrain.height(places[:, :2]), places[:, 2]])

    def rods(self, time_s: float) -> list[tuple[Array, Array]]:
        """Ends (rods, 2, 3) and radii (rods,) of each walker's body, m, map frame."""
        if not self.ids:
            return []
        poses = self.poses(time_s)
        return [
            (ends @ rotation_z(pose[3]).T + pose[:3], radii)
            for pose, ends, radii in zip(poses, self._ends, self._radii, strict=True)
        ]


class _Track:
    """Waypoints with the times of arrival at and departure from each."""

    def __init__(self, option: WalkerOptions) -> None:
        points = np.array(option.path, dtype=float)
        if option.loop:
            points = np.vstack([points, points[:1]])
        legs = np.diff(points, axis=0)
        arrive, leave = [0.0], [option.start_s]
        for length in np.hypot(*legs.T):
            arrive.append(leave[-1] + float(length) / option.speed)
            leave.append(arrive[-1] + option.wait_s)
        self._points, self._arrive, self._leave = points, np.array(arrive), np.array(leave)
        self._yaws = np.arctan2(legs[:, 1], legs[:, 0]) if len(legs) else np.zeros(1)
        self._start_s = option.start_s
        self._round_s = leave[-1] - option.start_s if option.loop else np.inf

    def at(self, time_s: float) -> tuple[float, float, float]:
        """x, y (m) and yaw (rad) at a time."""
        if time_s > self._start_s and 0.0 < self._round_s < np.inf:
            time_s = self._start_s + (time_s - self._start_s) % self._round_s
        left = int(np.searchsorted(self._leave, time_s, side="left"))  # waypoints that it has left
        if left in (0, len(self._points)):
            end = 0 if left == 0 else -1
            return float(self._points[end, 0]), float(self._points[end, 1]), float(self._yaws[end])
        share = min(1.0, (time_s - self._leave[left - 1]) / max(self._arrive[left] - self._leave[left - 1], 1e-9))
        x, y = (1.0 - share) * self._points[left - 1] + share * self._points[left]
        return float(x), float(y), float(self._yaws[left - 1])
