"""Where to park for a plant, what not to enter along the rows, and which way to go between parking places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, Protocol

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import wrap_angle
from grape.messages import Array
from grape.site import Site


class RowLine(Protocol):
    """A row of a site."""

    @property
    def id(self) -> str: ...

    @property
    def line(self) -> Array: ...  # (n, 2) m, map


@dataclass(frozen=True, kw_only=True)
class RouteOptions:
    """Distances in metres.

    Args:
        lateral: from base_link to the line of the row when parked or driving along it, row on the left.
        arm_x: arm base in base_link.
        offset: plant before or behind the arm base, along the driving direction.
        zone: half-width of the prohibited strip along a row.
        zone_ahead: the strip goes on past the row's ends by this much.
        behind: a goal in the same aisle this far behind is reached backwards.
        headland: how far past the row's end the robot turns.
    """

    lateral: float = 0.335 + 0.50
    arm_x: float = 0.25
    offset: float = 0.22
    zone: float = 0.28
    zone_ahead: float = 0.30
    behind: float = 2.0
    headland: float = 1.6


def parking_pose(
    plant: Array, direction: Array, place: Literal["fore", "aft"], options: RouteOptions | None = None
) -> Array:
    """(3,) x y yaw of base_link with the plant on the left.

    Args:
        plant: (2,) m, trunk, post or nail in map.
        direction: (2,) unit vector along the row that the robot faces; the row is on its left.
        place: whether the plant is before ("fore") or behind ("aft") the arm base.

    Raises:
        InvalidInput: `place` is neither.
    """
    options = options or RouteOptions()
    if place not in ("fore", "aft"):
        raise InvalidInput(f"place must be 'fore' or 'aft', got {place!r}")
    direction = _unit(direction)
    right = np.array([direction[1], -direction[0]])
    plant_x = options.arm_x + (options.offset if place == "fore" else -options.offset)
    x, y = np.asarray(plant, dtype=float) - plant_x * direction + options.lateral * right
    return np.array([x, y, np.arctan2(direction[1], direction[0])])


def park_beside(
    site: Site, plant: str, place: Literal["fore", "aft"] = "fore", options: RouteOptions | None = None
) -> Array:
    """(3,) x y yaw of base_link in map for working on a plant of the site, its row on the left.

    Args:
        place: whether the plant is before ("fore") or behind ("aft") the arm base.

    Raises:
        InvalidInput: the site has no such plant.
    """
    spot = site.plant(plant)
    row = site.row(spot.row)
    segment = int(np.argmin([_gap(spot.position, a, b) for a, b in pairwise(row.line)]))
    a, b = row.line[segment : segment + 2]
    along = _unit(b - a)
    foot = a + ((spot.position - a) @ along) * along
    return parking_pose(foot, along if spot.side == "right" else -along, place, options)


def row_zones(rows: Sequence[RowLine], options: RouteOptions | None = None) -> tuple[Array, ...]:
    """Prohibited strips (4, 2) m around every segment of every row, longer than the row at both ends."""
    options = options or RouteOptions()
    zones = []
    for row in rows:
        for k in range(len(row.line) - 1):
            a, b = row.line[k], row.line[k + 1]
            along = _unit(b - a)
            across = options.zone * np.array([-along[1], along[0]])
            a = a - (options.zone_ahead if k == 0 else options.zone) * along
            b = b + (options.zone_ahead if k == len(row.line) - 2 else options.zone) * along
            zones.append(np.array([a - across, b - across, b + across, a + across]))
    return tuple(zones)


def waypoints(rows: Sequence[RowLine], start: Array, goal: Array, options: RouteOptions | None = None) -> Array:
    """Poses (n, 3) x y yaw from start (left out) to goal (included): along the lane, out to the headland, around.

    Both poses are (3,) x y yaw in map. A pose between the ends of the rows is in a lane and leaves it forwards, or
    along its lane; a pose outside is in a headland.
    """
    options = options or RouteOptions()
    start, goal = np.asarray(start, dtype=float), np.asarray(goal, dtype=float)
    if not rows:
        return goal[None]
    axis = _axis(rows)
    low, high = _extent(rows, axis)
    across = np.array([-axis[1], axis[0]])
    s0, s1 = float(start[:2] @ axis), float(goal[:2] @ axis)
    t0, t1 = float(start[:2] @ across), float(goal[:2] @ across)
    margin = options.headland
    start_inside, goal_inside = low - 0.5 < s0 < high + 0.5, low - 0.5 < s1 < high + 0.5
    forward = np.sign(np.cos(goal[2] - np.arctan2(axis[1], axis[0])))
    if start_inside and goal_inside and _same_aisle(rows, across, start, goal, options):
        return goal[None]
    stops: list[tuple[float, float]] = []
    if start_inside:
        facing = np.sign(np.cos(start[2] - np.arctan2(axis[1], axis[0])))
        exit_s = high + margin if facing > 0 else low - margin
        stops.append((exit_s, t0))
    if goal_inside:
        entry_s = low - margin if forward > 0 else high + margin
        here = stops[-1] if stops else (s0, t0)
        wrong_end = (here[0] - 0.5 * (low + high)) * (entry_s - 0.5 * (low + high)) < 0
        if wrong_end:
            stops.extend(_around(rows, across, here, entry_s, options))
            here = stops[-1]
        in_line = stops == [] and abs(here[1] - t1) < 0.3
        faces_it = _same_way(start, goal) and (s1 - s0) * forward > 0.0
        if not (in_line and (faces_it or (entry_s - s0) * forward > -0.5 * margin)):
            stops.append((entry_s, t1))
    points = [s * axis + t * across for s, t in _distinct(stops, (s0, t0))]
    return _with_yaw(points, goal)


def _same_aisle(rows: Sequence[RowLine], across: Array, start: Array, goal: Array, options: RouteOptions) -> bool:
    """Whether no row lies between the poses, they face the same way, and the goal is not far behind."""
    t0, t1 = sorted((float(start[:2] @ across), float(goal[:2] @ across)))
    between = [row.id for row in rows if t0 < float(np.mean(row.line @ across)) < t1]
    heading = np.array([np.cos(goal[2]), np.sin(goal[2])])
    return not between and _same_way(start, goal) and float((goal[:2] - start[:2]) @ heading) > -options.behind


def _same_way(start: Array, goal: Array) -> bool:
    return abs(float(wrap_angle(float(start[2] - goal[2])))) < 1.0


def _around(
    rows: Sequence[RowLine], across: Array, here: tuple[float, float], entry_s: float, options: RouteOptions
) -> list[tuple[float, float]]:
    """Way to the other headland outside the outermost row that is nearer."""
    offsets = np.array([float(point @ across) for row in rows for point in row.line])
    low, high = offsets.min() - options.lateral - 0.4, offsets.max() + options.lateral + 0.4
    side = low if abs(here[1] - low) < abs(here[1] - high) else high
    return [(here[0], side), (entry_s, side)]


def _distinct(stops: list[tuple[float, float]], first: tuple[float, float]) -> list[tuple[float, float]]:
    kept: list[tuple[float, float]] = []
    last = first
    for stop in stops:
        if np.hypot(stop[0] - last[0], stop[1] - last[1]) > 0.3:
            kept.append(stop)
            last = stop
    return kept


def _with_yaw(points: list[Array], goal: Array) -> Array:
    """Each waypoint faces the next one."""
    poses = []
    for k, point in enumerate(points):
        following = points[k + 1] if k + 1 < len(points) else goal[:2]
        d = following - point
        poses.append([point[0], point[1], np.arctan2(d[1], d[0])])
    return np.array([*poses, goal.tolist()])


def _axis(rows: Sequence[RowLine]) -> Array:
    """Mean direction of the rows, all turned the same way."""
    reference = _unit(rows[0].line[-1] - rows[0].line[0])
    total = np.zeros(2)
    for row in rows:
        d = _unit(row.line[-1] - row.line[0])
        total += d if d @ reference >= 0 else -d
    return _unit(total)


def _extent(rows: Sequence[RowLine], axis: Array) -> tuple[float, float]:
    along = np.concatenate([np.asarray(row.line) @ axis for row in rows])
    return float(along.min()), float(along.max())


def _gap(point: Array, a: Array, b: Array) -> float:
    """Distance (m) from a point to a segment."""
    d = b - a
    s = np.clip((point - a) @ d / (d @ d), 0.0, 1.0)
    return float(np.hypot(*(point - a - s * d)))


def _unit(v: Array) -> Array:
    v = np.asarray(v, dtype=float)
    length = float(np.hypot(*v))
    if not length > 1e-9:
        raise InvalidInput(f"a direction must not be zero or NaN, got {v}")
    return v / length
