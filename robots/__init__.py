"""Robots as data: one package a robot, each with one MJCF and one `DESCRIPTION`."""

from grape.robots.description import (
    ArmDescription,
    BaseDescription,
    FeederDescription,
    GripperDescription,
    Mount,
    RobotDescription,
    SafetyZone,
    driving_zones,
)

__all__ = [
    "ArmDescription",
    "BaseDescription",
    "FeederDescription",
    "GripperDescription",
    "Mount",
    "RobotDescription",
    "SafetyZone",
    "driving_zones",
]
