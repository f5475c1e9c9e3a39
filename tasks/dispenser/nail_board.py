"""The board that is hammered on with each nail, and what the site file says about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context
from grape.errors import GoalRejected
from grape.geometry import inverse, pose, yaw_of
from grape.messages import Array
from grape.tasks.dispenser.row import plant_in_base
from grape.tasks.dispenser.targets import HangTarget

MARKER_DICTIONARY = "DICT_4X4_50"
MARKER_SIDE_M = 0.040


@dataclass(frozen=True, kw_only=True)
class NailBoard:
    """Where the nail's tip is between the two markers; every board is made to this drawing.

    Seen from the aisle: x right, y up, z out of the board.

    Attributes:
        offset_m: markers to the left and right of the nail.
        drop_m: markers' centres below the height of the tip.
        reach_m: tip in front of the markers' faces.
        rise_rad: of the nail above the horizontal.
    """

    offset_m: float = 0.085
    drop_m: float = 0.030
    reach_m: float = 0.0463
    rise_rad: float = np.radians(15.0)

    def T_tip_markers(self, ids: tuple[int, ...]) -> Mapping[int, Array]:
        """Poses of the left and right marker relative to the nail's tip, axes as the board's."""
        return {
            marker: pose(None, (sign * self.offset_m, -self.drop_m, -self.reach_m))
            for marker, sign in zip(ids, (-1.0, 1.0), strict=True)
        }


def nail_target(ctx: Context, plant: str, board: NailBoard) -> HangTarget:
    """Where the survey and the pose estimate say the nail is.

    Raises:
        GoalRejected: the plant is no nail, or its markers are not in the site file.
    """
    spot = ctx.world.site.plant(plant)
    if spot.kind != "nail" or len(spot.markers) != 2:
        raise GoalRejected(f"{plant} is a {spot.kind} with markers {spot.markers}; nail mode needs a nail with two")
    yaw = spot.yaw_rad - yaw_of(ctx.world.base_pose())
    out = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    direction = np.cos(board.rise_rad) * out + np.array([0.0, 0.0, np.sin(board.rise_rad)])
    return HangTarget(
        plant=plant,
        kind="nail",
        tip=plant_in_base(ctx, plant),
        direction=direction,
        pitch=np.pi / 2,
        azimuth=float(np.arctan2(out[0], -out[1])),
        diameter=0.006,
    )


def T_base_tip(target: HangTarget) -> Array:
    """(4, 4) the tip with the board's axes (x right, y up, z out) in base_link."""
    out = np.array([np.sin(target.azimuth), -np.cos(target.azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return pose(np.column_stack([np.cross(up, out), up, out]), target.tip)


def desired_markers(
    target: HangTarget,
    board: NailBoard,
    ids: tuple[int, ...],
    T_hand_nails: Array,
    T_hand_camera: Array,
    back_off: float,
) -> Mapping[int, Array]:
    """`T_camera_marker` of each marker when the hand is `back_off` metres short of its final pose at the nail."""
    T_camera_base = inverse(target.hand_pose(T_hand_nails, back_off) @ T_hand_camera)
    T = T_base_tip(target)
    return {marker: T_camera_base @ T @ T_tip for marker, T_tip in board.T_tip_markers(ids).items()}
