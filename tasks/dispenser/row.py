"""The vine row beside the parked robot, in the robot's own frame, from the site file and the pose estimate."""

from __future__ import annotations

import numpy as np

from grape.actions.core import Context
from grape.geometry import inverse, transform
from grape.messages import Array
from grape.planning import StaticBox

GROUND_CLEARANCE_M = 0.132  # of base_link on flat ground


def plant_in_base(ctx: Context, plant: str) -> Array:
    """(3,) m, where the dispenser goes as far as the survey tells, in base_link: a nail's tip, or a vine's trunk.

    The ground at the plant is taken to be as high as under the robot; the robot's tilt counts.
    """
    spot = ctx.world.site.plant(plant)
    T_map_base = ctx.world.base_pose()
    height = T_map_base[2, 3] - GROUND_CLEARANCE_M + (spot.height_m if spot.kind == "nail" else 0.0)
    return transform(inverse(T_map_base), np.array([*spot.target, height]))


def row_distance(ctx: Context, plant: str) -> float:
    """m, how far left of base_link the line of the plant's row runs, abreast of the plant."""
    spot = ctx.world.site.plant(plant)
    T_map_base = ctx.world.base_pose()
    return float(transform(inverse(T_map_base), np.array([*spot.position, T_map_base[2, 3]]))[1])


def row_boxes(ctx: Context, plant: str, depth_m: float = 0.12) -> tuple[StaticBox, ...]:
    """The row as one box, for planning before anything of it was seen: unseen space beside the vines is occupied.

    Args:
        plant: a plant of the row.
        depth_m: how far the box reaches from the row's line towards the robot.
    """
    y = row_distance(ctx, plant)
    return (
        StaticBox(
            name="row",
            center=(0.25, y + 0.5 - depth_m, 0.4),
            half_size=(1.5, 0.5, 0.9),
            ignore_links=(),
        ),
    )
