"""Kinematics of arm and hand: forward and inverse, from the robot's MJCF."""

from grape.kinematics.arm import ROTATION_WEIGHT, ArmModel
from grape.kinematics.hand import HandModel, NailGeometry
from grape.kinematics.inverse import IkOptions, IkResult, IkSolution, inverse, inverse_all, inverse_path
from grape.kinematics.mjcf import BodyInertia, Link, Shape, read_body_pose, read_chain, read_mjcf, read_shapes

__all__ = [
    "ROTATION_WEIGHT",
    "ArmModel",
    "BodyInertia",
    "HandModel",
    "IkOptions",
    "IkResult",
    "IkSolution",
    "Link",
    "NailGeometry",
    "Shape",
    "inverse",
    "inverse_all",
    "inverse_path",
    "read_body_pose",
    "read_chain",
    "read_mjcf",
    "read_shapes",
]
