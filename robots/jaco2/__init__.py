"""Kinova Jaco2 j2n6s300 with nails on two fingers, camera and scanner on its wrist, and a feeder of loop dispensers.

Robots that carry them include `jaco2.xml` (defaults, materials, actuators), `arm.xml` (in their body `arm_base`) and
`feeder.xml` (in their body `feeder`), and place both. Names:

Bodies: feeder, marker_1, marker_2, arm_base, link_1 … link_5, hand (the last link), wrist_camera, wrist_lidar,
    finger_{1,2,3} (1 = thumb), finger_{1,2,3}_tip, nail_2 (+x side), nail_3 (-x side).
Joints: joint_1 … joint_6, finger_1 … finger_3 (driven), finger_1_tip … finger_3_tip (springs).
Actuators: arm_1 … arm_6 (position, absolute rad), finger_1 … finger_3 (position, rad).
Sites (group 4, hidden): feeder (centre of the lowest loop), marker_1, marker_2, arm_base, hand, nails_closed and
    nails_open (nail mid-point in the hand at the closed and the open finger angle), camera_optical (z forward, y down),
    wrist_lidar (scan in x-y, x forward), nail_2, nail_3 (grooves).
Camera: wrist_camera (640 x 480, f = 466 px, cx 319.5, cy 239.5); site camera_optical is its optical frame.
Geom groups: 1 drawn only; 2 drawn and touched (feeder channels, nails); 3 collision shapes, not drawn: capsules on
    every moving link, boxes on the base. Group 3 is also what planners use; its boxes `feeder` and
    `feeder_markers` are envelopes for planning without contact.
Contact bits (a pair touches when contype of one meets conaffinity of the other):
    1 world (ground, vines, posts, spurs, nails in posts): contype 1, conaffinity 4;
    2 robot bodies: contype 2, conaffinity 27 (hand and wrist: 31; wheels: 9; feeder: 25);
    4 loops: contype 4, conaffinity 0, priority 1: their friction, solref and solimp hold in every contact they make;
    8 fingers and nails: contype 8, conaffinity 5;
    16 the feet in the welded ends of a loop: by them alone it lies in the feeder or on the base, which saves most of
    the search for contacts.
    So loops touch nails, fingers, hand and world along their length, feeder and base by their feet, and not each other;
    fingers do not touch each other.
"""

from __future__ import annotations

from math import inf

import numpy as np

from grape.geometry import pose, rotation_y
from grape.messages import Array
from grape.robots.description import ArmDescription, FeederDescription, GripperDescription, Mount, TouchDescription

_HOME = np.array([4.805, 2.925, 1.002, 4.203, 1.446, 1.323])  # Kinova's home position
_TRAVEL = np.array([5.980, 3.744, 1.522, 5.993, 1.077, 2.548])
_CAMERA_TILT = np.radians(13.0)
_R_hand_camera = np.column_stack(
    (
        (1.0, 0.0, 0.0),
        (0.0, -np.cos(_CAMERA_TILT), -np.sin(_CAMERA_TILT)),
        (0.0, np.sin(_CAMERA_TILT), -np.cos(_CAMERA_TILT)),
    )
)


WRIST_MOUNTS = {
    "camera_optical": Mount(parent="hand", T_parent_sensor=pose(_R_hand_camera, (0.0, -0.092, -0.020))),
    "wrist_lidar": Mount(
        parent="hand", T_parent_sensor=pose(rotation_y(np.pi / 2), (-0.10, -0.030, -0.030)), model="TiM561"
    ),
}

GRIPPER = GripperDescription(
    joints=("finger_1", "finger_2", "finger_3"),
    actuators=("finger_1", "finger_2", "finger_3"),
    nail_bodies=("nail_2", "nail_3"),
    position_min=np.zeros(3),
    position_max=np.array([1.51, 1.15, 1.15]),
    velocity_max=1.0,
    open_angle=0.30,
    closed_angle=1.05,
    thumb_clear=1.5,
    pivot=np.array([0.02226, -0.02707, -0.11482]),
    axis=np.array([np.cos(np.radians(10.58)), np.sin(np.radians(10.58)), 0.0]),
    radius=0.150,
    reference=0.675,
    nail_x=0.014569581,
    nail_radius=0.0065,
    stem_radius=0.0028,
    stem_length=0.045,
)


def jaco2(T_base_link_arm_base: Array) -> ArmDescription:
    """The arm on a base that has its foot at a pose (4, 4) in base_link."""
    return ArmDescription(
        base_frame="arm_base",
        tip_frame="hand",
        T_base_link_arm_base=T_base_link_arm_base,
        joints=tuple(f"joint_{i}" for i in range(1, 7)),
        actuators=tuple(f"arm_{i}" for i in range(1, 7)),
        position_min=np.array([-inf, np.radians(47), np.radians(19), -inf, -inf, -inf]),
        position_max=np.array([inf, np.radians(313), np.radians(341), inf, inf, inf]),
        velocity_max=np.radians([36.0, 36.0, 36.0, 48.0, 48.0, 48.0]),
        headroom=0.05,
        # Nominally 200 deg/s^2; joints 4-6 cannot exceed 2.5 rad/s^2 with 6.8 N m on an armature of 2 kg m^2.
        acceleration_max=np.array([3.0, 3.0, 3.0, 2.0, 2.0, 2.0]),
        torque_max=np.array([30.5, 30.5, 30.5, 6.8, 6.8, 6.8]),
        servo_lag=0.07,
        command_timeout=0.05,
        poses={
            "home": _HOME,
            "travel": _TRAVEL,  # every link inside the footprint, hand over the feeder
            "ready_feeder": _TRAVEL,  # 0.14 m above the highest loop
            # The hand level to the left, 0.22 m before or behind the arm base, 0.15 m beside it and 0.25 m above it.
            "ready_left_fore": np.array([2.952, 4.023, 0.780, 3.894, 1.938, 1.042]),
            "ready_left_aft": np.array([6.540, 4.022, 0.779, 5.602, -1.947, 5.248]),
        },
        cable_turns=1.5 * np.pi,
        unwound=_TRAVEL,
        touch=TouchDescription(
            motor_inertia=np.array([4.0, 4.0, 4.0, 2.0, 2.0, 2.0]),
            friction=np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0]),
            torque_max=np.array([12.0, 12.0, 12.0, 6.0, 6.0, 6.0]),  # 20 N at 0.6 m from a large joint
        ),
    )


def feeder(T_base_link_feeder: Array) -> FeederDescription:
    """The feeder with the centre of its lowest loop at a pose (4, 4) in base_link."""
    return FeederDescription(
        T_base_link_feeder=T_base_link_feeder,
        levels=8,
        pitch=0.012,
        marker_ids=(1, 2),
        marker_positions=np.array([[-0.085, -0.060, -0.030], [0.085, -0.060, -0.030]]),
        marker_side=0.040,
        marker_dictionary="DICT_4X4_50",
    )
