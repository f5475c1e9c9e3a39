"""Feedback loops of the arm at 100 Hz: trajectories, hand twists, visual servoing; no clock, no driver."""

from grape.control.differential_ik import (
    DifferentialIk,
    DifferentialIkOptions,
    JointVelocityCommand,
    damped_inverse,
    shift_twist,
)
from grape.control.features import marker_corners
from grape.control.ibvs import MarkerServo, MarkerServoOptions, ServoState
from grape.control.point_servo import PointServo, PointServoOptions, PointServoState
from grape.control.servo_run import ServoStage
from grape.control.tracking import TrackingCommand, TrackingOptions, TrajectoryTracker

__all__ = [
    "DifferentialIk",
    "DifferentialIkOptions",
    "JointVelocityCommand",
    "MarkerServo",
    "MarkerServoOptions",
    "PointServo",
    "PointServoOptions",
    "PointServoState",
    "ServoStage",
    "ServoState",
    "TrackingCommand",
    "TrackingOptions",
    "TrajectoryTracker",
    "damped_inverse",
    "marker_corners",
    "shift_twist",
]
