"""Where the robot is: a 15-state filter with a configuration vector per sensor, the pose estimator built on it, and
Monte Carlo localisation on a known map."""

from grape.localization.amcl import Amcl, AmclEstimate, AmclOptions
from grape.localization.discord import (
    Accord,
    Agreement,
    DiscordOptions,
    DiscordWatch,
    PlanarBelief,
    belief_of,
    from_amcl,
)
from grape.localization.ekf import STATE, Belief, Correction, Ekf, EkfOptions, Measurement, Verdict, components
from grape.localization.estimator import EstimatorOptions, PoseEstimator
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

__all__ = [
    "STATE",
    "Accord",
    "Agreement",
    "Amcl",
    "AmclEstimate",
    "AmclOptions",
    "Belief",
    "Correction",
    "DiscordOptions",
    "DiscordWatch",
    "Ekf",
    "EkfOptions",
    "EstimatorOptions",
    "FieldOptions",
    "GnssConfig",
    "ImuConfig",
    "LikelihoodField",
    "Measurement",
    "OdometryNoise",
    "PlanarBelief",
    "PoseEstimator",
    "Verdict",
    "WheelConfig",
    "belief_of",
    "components",
    "from_amcl",
    "from_gnss",
    "from_imu",
    "from_wheels",
    "wheel_speeds",
]
