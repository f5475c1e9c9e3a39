"""Park the robot where its arm reaches a plant."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Literal

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.drive_to_pose import DriveGoal, drive_to_pose
from grape.actions.obstacles import OBSTACLES
from grape.navigation.route import RouteOptions, park_beside

PARKED = "parked"  # in world.committed: (plant, place) of the present stop; in the ledger as well
STANDING = "standing"  # in world.committed after an interruption: the plant beside which the base still stands
ARM_SIDE_M = 0.335  # base_link to the robot's left side


@dataclass(frozen=True, kw_only=True)
class DriveToPlantGoal:
    """Where to stop.

    Attributes:
        plant: id in the site file.
        row_distance_m: from the robot's left side to the line of the row.
        speed: m/s.
    """

    plant: str
    row_distance_m: float = 0.62
    speed: float = 0.8


@action("DriveToPlant")
def drive_to_plant(goal: DriveToPlantGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Drives to a stop beside a plant, the row on the left; called again for the same plant it takes the other stop.

    After an interruption the base stays where it had stopped. The plant ends up before the arm's base, or, on the
    second stop, behind it: straight abreast the arm is singular.
    """
    if ctx.world.committed.pop(STANDING, None) == goal.plant:
        yield Feedback(status="still standing there")
        return NoResult()
    place: Literal["fore", "aft"] = "fore"
    if ctx.world.committed.get(PARKED) == (goal.plant, "fore"):
        place = "aft"
    ctx.world.committed.pop(PARKED, None)
    ctx.world.committed.pop(OBSTACLES, None)  # seen from the last stop, in the frame of that stop
    route = RouteOptions(lateral=ARM_SIDE_M + goal.row_distance_m)
    x, y, yaw = (float(v) for v in park_beside(ctx.world.site, goal.plant, place, route))
    with ctx.ledger.step("drive", goal.plant, moves_base=True, place=place):
        result = yield from drive_to_pose(DriveGoal(x=x, y=y, yaw=yaw, speed=goal.speed), ctx)
    ctx.ledger.remember(PARKED, [goal.plant, place])
    ctx.world.committed[PARKED] = (goal.plant, place)
    ctx.log.event(
        "parked",
        plant=goal.plant,
        place=place,
        along_m=result.along_m,
        across_m=result.across_m,
        yaw_rad=result.yaw_rad,
    )
    return NoResult()
