"""Where the robot is: a 15-state filter with a configuration vector per sensor, and the estimators built on it."""

from grape.localization.beginning import FusionOptions
from grape.localization.cascade import Cascade, Transform
from grape.localization.ekf import Ekf, EkfOptions
from grape.localization.estimator import EstimatorOptions, PoseEstimator
from grape.localization.fusion import Fusion
from grape.localization.measurements import (
    GnssConfig,
    ImuConfig,
    WheelConfig,
    from_gnss,
    from_imu,
    from_wheels,
    wheel_speeds,
)
from grape.localization.readings import Reading, reading_of_components, reading_of_message
from grape.localization.sensor_options import SensorOptions, per_component
from grape.localization.sensors import Sensor, skid_steer_rates
from grape.localization.state import STATE, Belief, Correction, Measurement, Mount, Verdict, components

__all__ = [
    "STATE",
    "Belief",
    "Cascade",
    "Correction",
    "Ekf",
    "EkfOptions",
    "EstimatorOptions",
    "Fusion",
    "FusionOptions",
    "GnssConfig",
    "ImuConfig",
    "Measurement",
    "Mount",
    "PoseEstimator",
    "Reading",
    "Sensor",
    "SensorOptions",
    "Transform",
    "Verdict",
    "WheelConfig",
    "components",
    "from_gnss",
    "from_imu",
    "from_wheels",
    "per_component",
    "reading_of_components",
    "reading_of_message",
    "skid_steer_rates",
    "wheel_speeds",
]
