"""Where the robot is: a 15-state filter with a configuration vector per sensor, and the pose estimator built on it."""

from grape.localization.ekf import STATE, Belief, Correction, Ekf, EkfOptions, Measurement, Verdict, components
from grape.localization.estimator import EstimatorOptions, PoseEstimator
from grape.localization.measurements import (
    GnssConfig,
    ImuConfig,
    WheelConfig,
    from_gnss,
    from_imu,
    from_wheels,
    wheel_speeds,
)

__all__ = [
    "STATE",
    "Belief",
    "Correction",
    "Ekf",
    "EkfOptions",
    "EstimatorOptions",
    "GnssConfig",
    "ImuConfig",
    "Measurement",
    "PoseEstimator",
    "Verdict",
    "WheelConfig",
    "components",
    "from_gnss",
    "from_imu",
    "from_wheels",
    "wheel_speeds",
]
