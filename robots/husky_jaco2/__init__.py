"""Clearpath Husky A200 with a Jaco2, its hand and its feeder (`grape.robots.jaco2`).

`husky_jaco2.xml` is the one source of the body; a test holds the numbers below to it. Its own names:

Bodies: base_link (free joint `base`), wheel_{front,rear}_{left,right}, riser, velodyne_mast, gnss_mast.
Joints and actuators: wheel_* (velocity, rad/s).
Sites: base_link, imu_link, gnss_link, velodyne, front_laser.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grape.geometry import pose
from grape.robots.description import BaseDescription, Mount, RobotDescription, driving_zones
from grape.robots.jaco2 import GRIPPER, WRIST_MOUNTS, feeder, jaco2

_WHEELS = ("wheel_front_left", "wheel_front_right", "wheel_rear_left", "wheel_rear_right")


def _on_base(x: float, y: float, z: float, model: str = "") -> Mount:
    return Mount(parent="base_link", T_parent_sensor=pose(translation=(x, y, z)), model=model)


_FOOTPRINT = np.array([[0.495, 0.343], [-0.495, 0.343], [-0.495, -0.343], [0.495, -0.343]])
_BASE = BaseDescription(
    height=0.132,
    wheel_joints=_WHEELS,
    wheel_actuators=_WHEELS,
    wheel_radius=0.1651,
    wheelbase=0.512,
    track=0.5708,
    effective_track=1.18,
    max_linear=1.0,
    max_angular=2.0,
    max_linear_acceleration=3.0,
    max_angular_acceleration=6.0,
    half_width=0.335,  # of the body; the wheels stand out 8 mm
    footprint=_FOOTPRINT,
    command_timeout=0.25,
    ticks_per_metre=78_000.0,
    zones=driving_zones(_FOOTPRINT),
)

DESCRIPTION = RobotDescription(
    name="husky_jaco2",
    mjcf=Path(__file__).with_name("husky_jaco2.xml"),
    base=_BASE,
    arm=jaco2(pose(translation=(0.25, 0.20, 0.458))),
    gripper=GRIPPER,
    feeder=feeder(pose(translation=(-0.20, 0.15, 0.358))),
    mounts={
        "imu_link": _on_base(0.19, 0.0, 0.149),
        "gnss_link": _on_base(-0.35, -0.20, 0.75),
        "velodyne": _on_base(0.40, -0.20, 0.52, "VLP-16"),
        "front_laser": _on_base(0.45, 0.0, 0.20, "UTM-30LX"),
        **WRIST_MOUNTS,
    },
)
