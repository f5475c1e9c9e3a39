"""Where the robot is: a 15-state filter with a configuration vector per sensor, the estimators built on it, and Monte
Carlo localisation on a known map."""

from grape.localization.amcl import Amcl, AmclEstimate, AmclOptions
from grape.localization.amcl_input import AmclInput, AmclInputOptions
from grape.localization.beginning import FusionOptions
from grape.localization.cascade import Cascade, Transform
from grape.localization.discord import (
    Accord,
    Agreement,
    DiscordOptions,
    DiscordWatch,
    PlanarBelief,
    belief_of,
    from_amcl,
)
from grape.localization.ekf import Ekf, EkfOptions
from grape.localization.estimator import EstimatorOptions, PoseEstimator
from grape.localization.fusion import Fusion
from grape.localization.laser_odometry import LaserMotion, LaserOdometry, LaserOdometryOptions
from grape.localization.likelihood_field import FieldOptions, LikelihoodField
from grape.localization.measurements import (
    GnssConfig,
    ImuConfig,
    WheelConfig,
    from_gnss,
    from_imu,
    from_wheels,
    wheel_speeds,
)
from grape.localization.motion import OdometryNoise
from grape.localization.readings import Reading, reading_of_components, reading_of_message
from grape.localization.refusals import Discord
from grape.localization.sensor_options import SensorOptions, per_component
from grape.localization.sensors import Sensor, skid_steer_rates
from grape.localization.state import STATE, Belief, Correction, Measurement, Mount, Verdict, components

__all__ = [
    "STATE",
    "Accord",
    "Agreement",
    "Amcl",
    "AmclEstimate",
    "AmclInput",
    "AmclInputOptions",
    "AmclOptions",
    "Belief",
    "Cascade",
    "Correction",
    "Discord",
    "DiscordOptions",
    "DiscordWatch",
    "Ekf",
    "EkfOptions",
    "EstimatorOptions",
    "FieldOptions",
    "Fusion",
    "FusionOptions",
    "GnssConfig",
    "ImuConfig",
    "LaserMotion",
    "LaserOdometry",
    "LaserOdometryOptions",
    "LikelihoodField",
    "Measurement",
    "Mount",
    "OdometryNoise",
    "PlanarBelief",
    "PoseEstimator",
    "Reading",
    "Sensor",
    "SensorOptions",
    "Transform",
    "Verdict",
    "WheelConfig",
    "belief_of",
    "components",
    "from_amcl",
    "from_gnss",
    "from_imu",
    "from_wheels",
    "per_component",
    "reading_of_components",
    "reading_of_message",
    "skid_steer_rates",
    "wheel_speeds",
]
