"""What the site file says is in the way of the base, and which of several goals is nearest by driving."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grape.actions.core import Context
from grape.errors import ActionFailed, Reason
from grape.geometry import yaw_of
from grape.messages import Array
from grape.navigation.costmap import InflationOptions
from grape.navigation.grid import Footprint
from grape.navigation.planner import PlannerOptions, plan_route
from grape.navigation.route import row_zones, waypoints
from grape.navigation.surroundings import Surroundings, SurroundingsOptions
from grape.site import Site


def shortest_way(ctx: Context, goals: Sequence[tuple[float, float, float]]) -> int:
    """Index of the goal (x, y, yaw in map) that is nearest by driving, by what the site file says is in the way.

    Raises:
        ActionFailed: NO_PATH, with what was wrong with the last, when none can be reached.
    """
    T_map_base, targets = ctx.world.base_pose(), np.array(goals)
    pose = np.array([T_map_base[0, 3], T_map_base[1, 3], yaw_of(T_map_base)])
    footprint = footprint_of(ctx.robot.description.base.footprint)
    costs = site_surroundings(ctx.world.site, targets, footprint).overall()
    lengths, failed = [], ActionFailed(Reason.NO_PATH, "nowhere to go")
    for target in targets:
        stops = waypoints(ctx.world.site.rows, pose, target)
        try:
            lengths.append(plan_route(costs, pose, stops, PlannerOptions(footprint=footprint)).length)
        except ActionFailed as failure:
            failed = failure
            lengths.append(np.inf)
    if not np.isfinite(lengths).any():
        raise failed
    return int(np.argmin(lengths))


def site_surroundings(site: Site, targets: Array, footprint: Footprint) -> Surroundings:
    """Prohibited areas of a site, on a grid around everything on it and around the targets (n, 3)."""
    points = [*(row.line for row in site.rows), *(area.polygon for area in site.headlands), site.start, targets[:, :2]]
    return Surroundings(
        [*(fence.polygon for fence in site.fences), *row_zones(site.rows)],
        np.vstack(points),
        SurroundingsOptions(footprint=footprint, inflation=InflationOptions(inscribed=footprint.inscribed)),
    )


def footprint_of(corners: Array) -> Footprint:
    """The rectangle around the corners (n, 2) m of a description."""
    corners = np.asarray(corners)
    return Footprint(
        front=float(corners[:, 0].max()),
        rear=float(-corners[:, 0].min()),
        half_width=float(np.abs(corners[:, 1]).max()),
    )
