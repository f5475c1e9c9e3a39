"""What the site file says is in the way of the base, and which of several goals is nearest by driving."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from grape.actions.core import Context
from grape.errors import ActionFailed, Reason
from grape.geometry import planar_of
from grape.messages import Array
from grape.navigation.beams import ScanOptions, SliceOptions
from grape.navigation.costmap import InflationOptions
from grape.navigation.grid import Footprint
from grape.navigation.planner import GlobalPlanner, PlannerOptions, plan_route
from grape.navigation.route import RouteOptions, row_zones, waypoints
from grape.navigation.surroundings import Surroundings, SurroundingsOptions
from grape.site import Site


def shortest_way(ctx: Context, goals: Sequence[tuple[float, float, float]], planner: GlobalPlanner = plan_route) -> int:
    """Index of the goal (x, y, yaw in map) that is nearest by driving, by what the site file says is in the way.

    Args:
        planner: that the drive will use.

    Raises:
        ActionFailed: NO_PATH, with what was wrong with the last, when none can be reached.
    """
    pose, targets = planar_of(ctx.world.base_pose()), np.array(goals)
    description = ctx.robot.description
    footprint = footprint_of(description.base.footprint)
    costs = site_surroundings(ctx.world.site, targets, description.base).overall()
    lengths, failed = [], ActionFailed(Reason.NO_PATH, "nowhere to go")
    for target in targets:
        stops = waypoints(ctx.world.site.rows, pose, target, route_options(description))
        try:
            lengths.append(planner(costs, pose, stops, PlannerOptions(footprint=footprint)).length)
        except ActionFailed as failure:
            failed = failure
            lengths.append(np.inf)
    if not np.isfinite(lengths).any():
        raise failed
    return int(np.argmin(lengths))


def site_surroundings(site: Site, targets: Array, base: Any, avoided: Sequence[Array] = ()) -> Surroundings:
    """Prohibited areas of a site, on a grid around everything on it and around the targets (n, 3).

    Args:
        base: `grape.robots.BaseDescription` of the robot that looks around.
        avoided: polygons (n, 2) m in map to go round where there is another way.
    """
    footprint = footprint_of(base.footprint)
    points = [*(row.line for row in site.rows), *(area.polygon for area in site.headlands), site.start, targets[:, :2]]
    return Surroundings(
        [*(fence.polygon for fence in site.fences), *row_zones(site.rows)],
        np.vstack(points),
        SurroundingsOptions(
            footprint=footprint,
            inflation=InflationOptions(inscribed=footprint.inscribed),
            scan=ScanOptions(ground=-base.height),
            slice=SliceOptions(ground=-base.height),
        ),
        avoided,
    )


def route_options(description: Any, beside_m: float = 0.50, **more: float) -> RouteOptions:
    """Distances along rows for a robot, its side `beside_m` from the row; `more` are other fields of the options."""
    arm_x = float(description.arm.T_base_link_arm_base[0, 3])
    return RouteOptions(lateral=description.base.half_width + beside_m, arm_x=arm_x, **more)


def footprint_of(corners: Array) -> Footprint:
    """The rectangle around the corners (n, 2) m of a description."""
    corners = np.asarray(corners)
    return Footprint(
        front=float(corners[:, 0].max()),
        rear=float(-corners[:, 0].min()),
        half_width=float(np.abs(corners[:, 1]).max()),
    )
