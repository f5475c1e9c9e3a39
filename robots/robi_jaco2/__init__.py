"""Robì, a base of aluminium bars with four in-wheel motors, a Jaco2, its hand and its feeder (`grape.robots.jaco2`).

Its legs can be set for clearances of 0.25–0.35 m, tracks of 0.75–1.2 m and wheelbases of 0.6–1.0 m; here they stand
for rows: narrow and short. Mass, wheels, encoders and places of the sensors are assumed, the reference names none.

`robi_jaco2.xml` is the one source of the body; a test holds the numbers below to it. Its own names:

Bodies: base_link (free joint `base`; under the middle of the frame), wheel_{front,rear}_{left,right}, riser, portal,
    gnss_mast, battery.
Joints and actuators: wheel_* (velocity, rad/s).
Sites: base_link, imu_link, gnss_link, ld_mrs (tilted forward by 6 degrees), front_laser.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grape.geometry import pose, rotation_y
from grape.messages import Array
from grape.robots.description import BaseDescription, Mount, RobotDescription, driving_zones
from grape.robots.jaco2 import GRIPPER, WRIST_MOUNTS, feeder, jaco2

_WHEELS = ("wheel_front_left", "wheel_front_right", "wheel_rear_left", "wheel_rear_right")
_LEVEL = np.eye(3)


def _on_base(position: tuple[float, float, float], model: str = "", rotation: Array = _LEVEL) -> Mount:
    return Mount(parent="base_link", T_parent_sensor=pose(rotation, position), model=model)


_FOOTPRINT = np.array([[0.50, 0.425], [-0.44, 0.425], [-0.44, -0.425], [0.50, -0.425]])
_BASE = BaseDescription(
    height=0.28,
    wheel_joints=_WHEELS,
    wheel_actuators=_WHEELS,
    wheel_radius=0.13,
    wheelbase=0.60,
    track=0.75,
    effective_track=1.45,
    max_linear=1.0,
    max_angular=2.0,
    max_linear_acceleration=2.0,
    max_angular_acceleration=4.0,
    half_width=0.42,
    footprint=_FOOTPRINT,
    command_timeout=0.25,
    ticks_per_metre=5_000.0,
    zones=driving_zones(_FOOTPRINT),
)

DESCRIPTION = RobotDescription(
    name="robi_jaco2",
    mjcf=Path(__file__).with_name("robi_jaco2.xml"),
    base=_BASE,
    arm=jaco2(pose(translation=(0.25, 0.285, 0.31))),
    gripper=GRIPPER,
    feeder=feeder(pose(translation=(-0.20, 0.235, 0.21))),
    mounts={
        "imu_link": _on_base((0.14, 0.05, 0.048)),
        "gnss_link": _on_base((-0.36, -0.30, 0.60)),
        "ld_mrs": _on_base((0.355, -0.24, 0.416), "LD-MRS400001", rotation_y(np.radians(6.0))),
        "front_laser": _on_base((0.413, 0.0, 0.122), "LMS291"),
        **WRIST_MOUNTS,
    },
)
