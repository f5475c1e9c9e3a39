"""Drive to where somebody refills the feeder."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, action
from grape.actions.drive_to_pose import (
    LEGS,
    PURE_PURSUIT,
    DriveGoal,
    GlobalPlannerName,
    LocalPlannerName,
    drive_to_pose,
    planner_named,
)
from grape.actions.shortest_way import shortest_way
from grape.errors import ActionFailed, Reason
from grape.navigation.planner import GlobalPlanner
from grape.plugins import GLOBAL_PLANNERS
from grape.site import RefillPoint
from grape.tasks.dispenser.actions.drive_to_plant import leave_stop


@dataclass(frozen=True, kw_only=True)
class DriveToRefillGoal:
    """Attributes: speed: m/s; planner, global_planner: names of a local and a global planner."""

    speed: float = 0.8
    planner: LocalPlannerName = PURE_PURSUIT
    global_planner: GlobalPlannerName = LEGS


@dataclass(frozen=True, kw_only=True)
class DriveToRefillResult:
    """Attributes: point: id of the refill point in the site file."""

    point: str


@action("DriveToRefill")
def drive_to_refill(goal: DriveToRefillGoal, ctx: Context) -> Generator[Feedback, None, DriveToRefillResult]:
    """Drives to the refill point that is nearest by driving; NO_REFILL_POINT when the site has none."""
    if not ctx.world.site.refills:
        raise ActionFailed(Reason.NO_REFILL_POINT, "the site file has no feature of kind refill")
    point = yield from _nearest(ctx, planner_named(GLOBAL_PLANNERS, goal.global_planner))
    leave_stop(ctx)
    x, y = (float(v) for v in point.position)
    with ctx.ledger.step("drive", moves_base=True, refill=point.id):
        drive = DriveGoal(
            x=x, y=y, yaw=point.yaw_rad, speed=goal.speed, planner=goal.planner, global_planner=goal.global_planner
        )
        yield from drive_to_pose(drive, ctx)
    return DriveToRefillResult(point=point.id)


def _nearest(ctx: Context, planner: GlobalPlanner) -> Generator[Feedback, None, RefillPoint]:
    points = ctx.world.site.refills
    if len(points) == 1:
        return points[0]
    poses = [(*(float(v) for v in point.position), point.yaw_rad) for point in points]
    index = yield from ctx.jobs.run(shortest_way, ctx, poses, planner)
    return points[index]
