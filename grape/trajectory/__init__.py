"""Joint motions in time: timing of paths, straight hand motions, set-points made while moving."""

from grape.trajectory.cartesian import (
    CartesianOptions,
    CartesianPath,
    CartesianPathBroken,
    cartesian_path,
    linear_target,
)
from grape.trajectory.online import VelocityLimiter
from grape.trajectory.timing import TimingOptions, densify, time_path
from grape.trajectory.trajectory import Trajectory, TrajectoryPoint

__all__ = [
    "CartesianOptions",
    "CartesianPath",
    "CartesianPathBroken",
    "TimingOptions",
    "Trajectory",
    "TrajectoryPoint",
    "VelocityLimiter",
    "cartesian_path",
    "densify",
    "linear_target",
    "time_path",
]
