"""Park the robot where its arm reaches a plant."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

from grape.actions.calibration import adopt_offsets, remember_offsets
from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.drive_to_pose import (
    LEGS,
    PURE_PURSUIT,
    DriveGoal,
    GlobalPlannerName,
    LocalPlannerName,
    drive_to_pose,
)
from grape.actions.obstacles import OBSTACLES, UNSEEN
from grape.actions.shortest_way import route_options
from grape.messages import Array
from grape.navigation.route import park_beside
from grape.site import Site
from grape.tasks.dispenser.row import plant_in_base
from grape.tasks.dispenser.stops import Stop, first_stop, next_stop, relative_to
from grape.tasks.dispenser.targets import recall_spurs

PARKED = "parked"  # in world.committed: (plant, ahead_m, beside_m) of the present stop; in the ledger as well
STANDING = "standing"  # in world.committed after an interruption: the plant beside which the base still stands


@dataclass(frozen=True, kw_only=True)
class DriveToPlantGoal:
    """Where to stop.

    Attributes:
        plant: id in the site file.
        speed: m/s.
        planner, global_planner: names of a local and a global planner.
    """

    plant: str
    speed: float = 0.8
    planner: LocalPlannerName = PURE_PURSUIT
    global_planner: GlobalPlannerName = LEGS


@action("DriveToPlant")
def drive_to_plant(goal: DriveToPlantGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Drives to a stop beside a plant, the row on the left; called again for the same plant it takes another stop.

    The first stop is the one from which the arm reaches most of where spurs, or the tip of a nail, usually are. The
    other one is chosen by the deployment poses that were found at the first. After an interruption the base stays
    where it had stopped.
    """
    if ctx.world.committed.pop(STANDING, None) == goal.plant:
        yield Feedback(status="still standing there")
        return NoResult()
    yield Feedback(status="choosing a stop")
    stop = yield from ctx.jobs.run(_choose, ctx, goal.plant)
    leave_stop(ctx)
    adopt_offsets(ctx)
    x, y, yaw = (float(v) for v in stop_pose(ctx.robot.description, ctx.world.site, goal.plant, stop))
    place = {"ahead_m": stop.ahead_m, "beside_m": stop.beside_m}
    with ctx.ledger.step("drive", goal.plant, moves_base=True, **place):
        drive = DriveGoal(x=x, y=y, yaw=yaw, speed=goal.speed, planner=goal.planner, global_planner=goal.global_planner)
        result = yield from drive_to_pose(drive, ctx)
    remember_offsets(ctx)
    ctx.ledger.remember(PARKED, [goal.plant, stop.ahead_m, stop.beside_m])
    ctx.world.committed[PARKED] = (goal.plant, stop.ahead_m, stop.beside_m)
    ctx.log.event(
        "parked",
        plant=goal.plant,
        **place,
        along_m=result.along_m,
        across_m=result.across_m,
        yaw_rad=result.yaw_rad,
    )
    return NoResult()


def leave_stop(ctx: Context) -> None:
    """Forgets what is valid at the present stop alone: it is in the frame of that stop."""
    for name in (PARKED, STANDING, OBSTACLES, UNSEEN):
        ctx.world.committed.pop(name, None)


def stop_pose(description: Any, site: Site, plant: str, stop: Stop) -> Array:
    """(3,) x y yaw in map of a robot's base_link (`grape.robots.RobotDescription`) at a stop beside a plant."""
    return park_beside(site, plant, "fore", route_options(description, stop.beside_m, offset=stop.ahead_m))


def _choose(ctx: Context, plant: str) -> Stop:
    """The stop to drive to: another one when the robot stands beside the plant already."""
    spot = ctx.world.site.plant(plant)
    what = (spot.kind, spot.height_m, spot.reach_m)
    parked, *place = ctx.world.committed.get(PARKED) or ("",)
    if parked != plant:
        return first_stop(ctx.robot, *what)
    here = Stop(ahead_m=place[0], beside_m=place[1])
    found = relative_to(plant_in_base(ctx, plant), recall_spurs(ctx, plant))
    return next_stop(ctx.robot, here, found, *what)
