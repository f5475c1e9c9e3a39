"""Global paths: straight legs between waypoints where they are free, a grid search where they are not.

Source: Hart, Nilsson and Raphael, A formal basis for the heuristic determination of minimum cost paths, 1968.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from grape.errors import ActionFailed, InvalidInput, Reason
from grape.messages import Array
from grape.navigation.grid import INSCRIBED, LETHAL, Costmap, Footprint
from grape.navigation.path import Path, in_frame_of, rounded, straight, with_headings


@dataclass(frozen=True, kw_only=True)
class PlannerOptions:
    """How paths look; lengths in metres.

    Args:
        cost_weight: how much more a metre next to an obstacle costs than a free one.
        spacing: between poses.
        turn_radius: of rounded corners.
        approach: straight piece before the goal, along its heading; the shorter ones are tried when it is blocked.
        on_line: a start this near to the goal's line is joined to it without a detour; `near_line` within `near` of
            the goal, where the follower backs off for another approach when it comes in too far aside.
        reverse_limit: a goal on the line behind the robot is reached backwards up to this distance.
    """

    cost_weight: float = 3.0
    spacing: float = 0.05
    turn_radius: float = 0.7
    approach: tuple[float, ...] = (1.5, 0.8, 0.3)
    on_line: float = 0.15
    near_line: float = 0.5
    near: float = 1.5
    reverse_limit: float = 3.0
    footprint: Footprint = field(default_factory=Footprint)


class GlobalPlanner(Protocol):
    """Anything that finds a path through waypoints: `plan_route` here, others by plugin."""

    def __call__(
        self, costmap: Costmap, start: Array, waypoints: Array, options: PlannerOptions | None = None, /
    ) -> Path:
        """As `plan_route`."""
        ...


def plan_path(costmap: Costmap, start: Array, goal: Array, options: PlannerOptions | None = None) -> Path:
    """A path from start to goal, poses (3,) x y yaw in map, that ends straight along the goal's heading.

    Raises:
        ActionFailed: NO_PATH, when the goal is occupied or nothing leads to it.
        InvalidInput: a pose is not finite.
    """
    return plan_route(costmap, start, np.atleast_2d(np.asarray(goal, dtype=float)), options)


def plan_route(costmap: Costmap, start: Array, waypoints: Array, options: PlannerOptions | None = None) -> Path:
    """A path through waypoints (n, 3) x y yaw, of which only the last binds position and heading exactly.

    A blocked waypoint is left out; corners are rounded where there is room.

    Raises:
        ActionFailed: NO_PATH, when the last waypoint is occupied or nothing leads to it.
        InvalidInput: a pose is not finite.
    """
    options = options or PlannerOptions()
    start, waypoints = np.asarray(start, dtype=float), np.atleast_2d(np.asarray(waypoints, dtype=float))
    if not (np.isfinite(start).all() and np.isfinite(waypoints).all()):
        raise InvalidInput(f"start and waypoints must be finite, got {start} and {waypoints}")
    goal = waypoints[-1]
    if costmap.blocked(goal, options.footprint)[0]:
        raise ActionFailed(Reason.NO_PATH, f"the goal ({goal[0]:.2f}, {goal[1]:.2f}) is occupied")
    _check_inside(costmap, start, goal)
    if len(waypoints) == 1 and (direct := _on_goal_line(costmap, start, goal, options)) is not None:
        return direct
    via = [w for w in waypoints[:-1] if costmap.cost_at(w[:2]) < INSCRIBED]
    for length in _approaches(via, goal, options):
        heading = np.array([np.cos(goal[2]), np.sin(goal[2])])
        entry = goal[:2] - length * heading
        if _free(costmap, straight(entry, goal, options.spacing), options, goal[2]):
            corners = _corners(costmap, [start[:2], *(w[:2] for w in via), entry], options)
            return _finished(costmap, np.vstack([corners, goal[:2]]), goal, options)
    raise ActionFailed(Reason.NO_PATH, f"no straight approach to ({goal[0]:.2f}, {goal[1]:.2f}) is free")


def _check_inside(costmap: Costmap, origin: Array, target: Array) -> None:
    """Raise ActionFailed, NO_PATH, when one of both places (2 or more,) m is not on the map."""
    spec, ends = costmap.spec, np.array([origin[:2], target[:2]])
    if not spec.contains(spec.cells(ends)).all():
        raise ActionFailed(Reason.NO_PATH, f"from {ends[0].round(2)} to {ends[1].round(2)} leaves the costmap")


def _approaches(via: list[Array], goal: Array, options: PlannerOptions) -> tuple[float, ...]:
    """Lengths of the straight piece before the goal; none overshoots the place where the way turns into its line."""
    lengths = options.approach
    if via:
        along, across, _ = in_frame_of(via[-1], goal)
        if abs(across) < 0.3 and -along > lengths[-1]:
            lengths = tuple(dict.fromkeys(min(length, float(-along)) for length in lengths))
    return lengths


def path_blocked(costmap: Costmap, path: Path, since: float, until: float, footprint: Footprint) -> bool:
    """Whether the footprint meets something lethal on the path between two distances along it (m)."""
    ahead = path.ahead(since, until)
    return len(ahead) > 0 and bool(costmap.blocked(ahead[::2], footprint).any())


def _on_goal_line(costmap: Costmap, start: Array, goal: Array, options: PlannerOptions) -> Path | None:
    """The straight way along the goal's line when the robot is on it, forwards or a little backwards."""
    along, across, yaw = in_frame_of(start, goal)
    aside = options.near_line if abs(along) < options.near else options.on_line
    if abs(across) > aside or abs(yaw) > 0.5 or along > options.reverse_limit:
        return None
    sign = 1.0 if along > 0 else -1.0
    heading = np.array([np.cos(goal[2]), np.sin(goal[2])])
    begin = goal[:2] + sign * max(abs(along), 0.05) * heading
    points = straight(begin, goal, options.spacing)
    if not _free(costmap, points, options, goal[2]):
        return None
    reverse = along > 0
    return Path(poses=np.column_stack([points, np.full(len(points), goal[2])]), reverse=reverse)


def _corners(costmap: Costmap, stops: list[Array], options: PlannerOptions) -> Array:
    """Corners (n, 2) of a polyline through the stops, with detours where the straight leg is blocked."""
    corners = [stops[0]]
    for target in stops[1:]:
        origin = corners[-1]
        if np.hypot(*(target - origin)) < options.spacing:
            continue
        if _line_cost(costmap, origin, target) < INSCRIBED:
            corners.append(target)
        else:
            corners.extend(_detour(costmap, origin, target, options))
    if len(corners) == 1 and np.hypot(*(stops[-1] - corners[0])) > 1e-6:
        corners.append(stops[-1])
    return np.array(corners)


def _finished(costmap: Costmap, corners: Array, goal: Array, options: PlannerOptions) -> Path:
    """The polyline with the roundest corners that are free, as poses."""
    for radius in (options.turn_radius, 0.5 * options.turn_radius, 0.0):
        points = rounded(corners, radius, options.spacing)
        inside = costmap.cost_at(points)
        if radius == 0.0 or not ((inside == INSCRIBED) | (inside == LETHAL)).any():
            return Path(poses=with_headings(points, last_yaw=float(goal[2])))
    raise AssertionError("unreachable: radius 0 always returns")


def _detour(costmap: Costmap, origin: Array, target: Array, options: PlannerOptions) -> list[Array]:
    """Corners after `origin` up to and including `target`, found by the grid search."""
    from grape.navigation.grid_kernels import search

    _check_inside(costmap, origin, target)
    spec = costmap.spec
    cells = spec.cells(np.array([origin, target]))
    flat = cells[:, 0] * spec.columns + cells[:, 1]
    found = search(costmap.cost, int(flat[0]), int(flat[1]), options.cost_weight, INSCRIBED - 1)
    if found.size == 0:
        raise ActionFailed(Reason.NO_PATH, f"nothing leads from {origin.round(2)} to {target.round(2)}")
    points = spec.centres(np.column_stack(np.divmod(found, spec.columns)))
    points = np.vstack([origin, points[1:-1], target])
    return _pruned(costmap, points)[1:]


def _pruned(costmap: Costmap, points: Array) -> list[Array]:
    """The corners of a cell path that remain when it is pulled tight without coming nearer to obstacles."""
    own = costmap.cost_at(points).astype(int)
    kept, k = [points[0]], 0
    while k < len(points) - 1:
        reach = k + 1
        stride = max(1, (len(points) - k) // 64)
        for n in range(len(points) - 1, k + 1, -stride):
            allowed = max(60, int(own[k : n + 1].max()))
            if _line_cost(costmap, points[k], points[n]) <= min(allowed, INSCRIBED - 1):
                reach = n
                break
        k = reach
        kept.append(points[k])
    return kept


def _line_cost(costmap: Costmap, a: Array, b: Array) -> int:
    from grape.navigation.grid_kernels import worst_on_segment

    spec = costmap.spec
    (x0, y0), (x1, y1) = (a - spec.origin) / spec.resolution, (b - spec.origin) / spec.resolution
    return int(worst_on_segment(costmap.cost, float(y0), float(x0), float(y1), float(x1)))


def _free(costmap: Costmap, points: Array, options: PlannerOptions, yaw: float) -> bool:
    poses = np.column_stack([points, np.full(len(points), yaw)])
    return not costmap.blocked(poses, options.footprint).any()
