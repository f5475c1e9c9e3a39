"""Ports to a robot: what every driver offers, simulated or real.

A driver says what it really did (`send` returns what was sent) and how old its data is (`latest(max_age_s)`).
"""

from grape.drivers.mailbox import Mailbox
from grape.drivers.ports import (
    ArmDriver,
    BaseDriver,
    CameraDriver,
    Drivers,
    GripperDriver,
    NoOperator,
    OperatorDriver,
    SensorDriver,
)

__all__ = [
    "ArmDriver",
    "BaseDriver",
    "CameraDriver",
    "Drivers",
    "GripperDriver",
    "Mailbox",
    "NoOperator",
    "OperatorDriver",
    "SensorDriver",
]
