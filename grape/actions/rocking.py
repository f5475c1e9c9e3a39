"""A base that rocks on its wheels under its arm: what was seen before is elsewhere in its frame afterwards."""

from __future__ import annotations

import numpy as np

from grape.actions.core import Context
from grape.actions.obstacles import OBSTACLES, Obstacles
from grape.errors import StaleData
from grape.geometry import pose, rotation_exp, transform
from grape.messages import Array

ROCKED_RAD = 0.01  # a place 1 m away moves by 1 cm; an estimate of the tilt is good to a fifth of that


def up_in_base(ctx: Context) -> Array | None:
    """(3,) unit vector against gravity in base_link, by the estimate; None as long as there is none."""
    try:
        up: Array = ctx.world.base_pose()[2, :3].copy()
    except StaleData:
        return None
    return up


def rocking(ctx: Context, up_seen: Array | None) -> Array | None:
    """`T_now_seen` (4, 4), where things are in base_link that were seen in it; None where the base stands as it stood.

    The base turns about where it stands on the ground. A turn about the vertical is not looked for.

    Args:
        ctx: context.
        up_seen: what `up_in_base` was when they were seen; None: unknown.
    """
    up = up_in_base(ctx)
    if up is None or up_seen is None:
        return None
    axis = np.cross(up_seen, up)
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, up_seen @ up))
    if angle < ROCKED_RAD:
        return None
    R = rotation_exp(axis / sine * angle)
    foot = np.array([0.0, 0.0, -ctx.robot.description.base.height])
    return pose(R, foot - R @ foot)


def follow_rocking(ctx: Context) -> None:
    """Moves the obstacles that were seen from this stop to where they are by now."""
    seen: Obstacles | None = ctx.world.committed.get(OBSTACLES)
    T_now_seen = None if seen is None else rocking(ctx, seen.up)
    if seen is not None and T_now_seen is not None:
        ctx.world.committed[OBSTACLES] = Obstacles(transform(T_now_seen, seen.cloud), up=up_in_base(ctx))
