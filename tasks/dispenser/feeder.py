"""Poses of the hand at the feeder, from the robot's own description."""

from __future__ import annotations

from typing import Any

import numpy as np

from grape.geometry import inverse, pose
from grape.messages import Array
from grape.tasks.dispenser.perception.feeder import FeederGeometry

INSERT_BIAS_M = -0.0015  # the nails enter a little low, or a strand seats under the lower lip
FEEDER_BOXES = ("feeder", "feeder_markers")  # shapes of the robot that the hand enters when it grasps
VIEW_M = 0.12  # above the top level: wings and both markers are in view


def feeder_geometry(robot: Any) -> FeederGeometry:
    """The feeder as perception sees it, from the robot's description."""
    feeder = robot.description.feeder
    return FeederGeometry(
        pitch_m=feeder.pitch,
        levels=feeder.levels,
        marker_side_m=feeder.marker_side,
        T_feeder_marker={
            marker: pose(translation=position)
            for marker, position in zip(feeder.marker_ids, feeder.marker_positions, strict=True)
        },
    )


def hand_at_feeder(robot: Any, level: int, height: float, finger_angle: float | None = None) -> Array:
    """`T_base_hand` with the nails `height` metres over their place inside the loop at `level`.

    The hand points down, its opening axis along the robot's x.

    Args:
        robot: models of the robot.
        level: 0 is the lowest.
        height: m.
        finger_angle: rad, for where the nails are in the hand; None: closed.
    """
    angle = robot.description.gripper.closed_angle if finger_angle is None else finger_angle
    T_hand_nails = pose(None, robot.hand.T_hand_nails(angle)[:3, 3])
    T_base_nails = robot.description.feeder.T_base_link_level(level) @ pose(
        None, np.array([0.0, 0.0, height + INSERT_BIAS_M])
    )
    return T_base_nails @ inverse(T_hand_nails)
