"""The vine row beside the parked robot, in the robot's own frame, from the site file and the pose estimate."""

from __future__ import annotations

import numpy as np

from grape.actions.core import Context
from grape.actions.obstacles import UNSEEN
from grape.geometry import inverse, transform
from grape.messages import Array
from grape.planning import StaticBox

ROW = "row"  # name of the box that stands for it
ROW_DEPTH_M = {"nail": 0.09, "vine": 0.12}  # of that box from the row's line towards the robot
VINE_HALF_M = 0.32  # of a vine's box, along the row and across it
NEAR_M = 2.0  # along the row from base_link: farther away the arm does not reach


def plant_in_base(ctx: Context, plant: str) -> Array:
    """(3,) m, where the dispenser goes as far as the survey tells, in base_link: a nail's tip, or a vine's trunk.

    The ground at the plant is taken to be as high as under the robot; the robot's tilt counts.
    """
    spot = ctx.world.site.plant(plant)
    T_map_base = ctx.world.base_pose()
    ground = T_map_base[2, 3] - ctx.robot.description.base.height
    height = ground + (spot.height_m if spot.kind == "nail" else 0.0)
    return transform(inverse(T_map_base), np.array([*spot.target, height]))


def row_distance(ctx: Context, plant: str) -> float:
    """m, how far left of base_link the line of the plant's row runs, abreast of the plant."""
    spot = ctx.world.site.plant(plant)
    T_map_base = ctx.world.base_pose()
    return float(transform(inverse(T_map_base), np.array([*spot.position, T_map_base[2, 3]]))[1])


def expect_row(ctx: Context, plant: str) -> None:
    """Has the arm keep out of the row until it was scanned or the base moves: nobody has looked into it yet.

    The row is one box, which leaves place to reach a nail on its post; beside a nail each vine is a box of its own too,
    as far as arms of a gobelet reach into the aisle.

    Args:
        ctx: context; the base stands beside the row.
        plant: a plant of the row.
    """
    spot = ctx.world.site.plant(plant)
    y = row_distance(ctx, plant) - ROW_DEPTH_M[spot.kind]
    arm_x = float(ctx.robot.description.arm.T_base_link_arm_base[0, 3])
    boxes = [StaticBox(name=ROW, center=(arm_x, y + 0.5, 0.4), half_size=(1.5, 0.5, 0.9), ignore_links=())]
    if spot.kind == "nail":
        vines = [vine for vine in ctx.world.site.plants if vine.row == spot.row and vine.kind == "vine"]
        for vine in vines:
            foot = plant_in_base(ctx, vine.id)
            if abs(foot[0]) < NEAR_M:
                center = (float(foot[0]), float(foot[1]), 0.4)
                size = (VINE_HALF_M, VINE_HALF_M, 0.9)
                boxes.append(StaticBox(name=vine.id, center=center, half_size=size, ignore_links=()))
    ctx.world.committed[UNSEEN] = tuple(boxes)
