"""Joint motions in time: timing of paths, set-points made while moving."""

from grape.trajectory.online import VelocityLimiter
from grape.trajectory.timing import TimingOptions, densify, time_path
from grape.trajectory.trajectory import Trajectory, TrajectoryPoint

__all__ = [
    "TimingOptions",
    "Trajectory",
    "TrajectoryPoint",
    "VelocityLimiter",
    "densify",
    "time_path",
]
