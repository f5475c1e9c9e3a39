"""What a sensor of the filter contributes: its configuration vector, its mount, its noise and its gates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite

import numpy as np

from grape.errors import InvalidInput
from grape.localization.state import STATE, Mount, components
from grape.messages import Array, frozen_array

UNKNOWN = np.nan
NOTHING = components()
FLOAT_FACTOR = 3.0  # errors without an integer fix stay for many readings


def per_component(**values: float) -> Array:
    """(15,) with the named values, nan elsewhere: `per_component(vx=0.05, wz=0.1)`.

    Raises:
        InvalidInput: a name is no component of the state.
    """
    unknown = set(values) - set(STATE)
    if unknown:
        raise InvalidInput(f"unknown state components {sorted(unknown)}; allowed: {', '.join(STATE)}")
    return np.array([values.get(name, UNKNOWN) for name in STATE])


@dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """What a sensor contributes, where it sits and how far it is believed.

    Args:
        components: the configuration vector, 15 flags in the order of `STATE`: which components are fused. Positions
            count in the sensor's frame of the world, velocities, rates and accelerations along the sensor's own axes,
            attitudes as roll, pitch and yaw of base_link (the mount is taken off the sensor's orientation).
        mount: where the sensor sits, the frame of its poses, and the gravity that its accelerometer feels.
        std: (15,) standard deviations, nan where the covariance of the reading is used.
        least_std: (15,) a covariance of the reading is never believed below these; nan is none.
        std_per_speed: (15,) what is added to the standard deviation for each m/s of the reading's own speed.
        std_per_turn: (15,) what is added for each rad/s of its own yaw rate: skidding wheels.
        status_factors: what the standard deviations are multiplied with, by GNSS status; 1 for a status not named.
        differential: poses enter as their change from one reading to the next, as velocities along the sensor's axes;
            their noise is `std` of those velocities, or else follows from the covariances of both poses.
        relative: poses are taken relative to the first one, which is where base_link starts.
        yaw_offset: rad added to the yaw of the reading: magnetic declination and mounting of a compass.
        pose_gate: largest Mahalanobis distance at which position and attitude are accepted.
        delay_s: how long before its stamp the sensor really measured.
        still_below: m/s and rad/s; when all velocities and rates of a reading are less, the base stands and all six
            are taken as zero with `still_std`; 0 is never.
        still_bias: flags of the rates and accelerations whose bias is learnt while the base stands, as some sensor with
            `still_below` says, and taken off from then on.
        still_bias_s: s of standing after which an old bias counts little.
        relocate_after: after so many refused poses in a row the filter gives up its position; 0 is never.
    """

    components: tuple[bool, ...]
    mount: Mount = field(default_factory=Mount)
    std: Array = field(default_factory=per_component)
    least_std: Array = field(default_factory=per_component)
    std_per_speed: Array = field(default_factory=per_component)
    std_per_turn: Array = field(default_factory=per_component)
    status_factors: Mapping[str, float] = field(default_factory=lambda: {"single": FLOAT_FACTOR, "float": FLOAT_FACTOR})
    differential: bool = False
    relative: bool = False
    yaw_offset: float = 0.0
    pose_gate: float = inf
    twist_gate: float = inf
    acceleration_gate: float = inf
    delay_s: float = 0.0
    still_below: float = 0.0
    still_std: float = 0.002
    still_bias: tuple[bool, ...] = NOTHING
    still_bias_s: float = 300.0
    relocate_after: int = 0

    def __post_init__(self) -> None:
        if len(self.components) != len(STATE) or not any(self.components):
            raise InvalidInput(f"components must be 15 flags, at least one of them true, got {self.components}")
        for name in ("std", "least_std", "std_per_speed", "std_per_turn"):
            value = frozen_array(getattr(self, name), float)
            if value.shape != (15,) or (value < 0).any() or np.isinf(value).any():
                raise InvalidInput(f"{name} must be 15 numbers from 0 (nan: not set), got {value}")
            object.__setattr__(self, name, value)
        if (self.std == 0).any():
            raise InvalidInput("std must be positive: nothing is measured without error")
        if min(self.pose_gate, self.twist_gate, self.acceleration_gate) <= 0:
            raise InvalidInput("pose_gate, twist_gate and acceleration_gate must be positive")
        if self.differential and self.relative:
            raise InvalidInput("differential and relative exclude each other")
        if self.still_below > 0 and not any(self.components[6:9]):
            raise InvalidInput("still_below needs vx, vy or vz among the components: rates alone tell no standing")
        if len(self.still_bias) != len(STATE) or any(self.still_bias[:9]) or not self.still_bias_s > 0:
            raise InvalidInput(
                "still_bias must be flags of rates and accelerations, and still_bias_s positive, got "
                f"{self.still_bias} and {self.still_bias_s}"
            )
        if not (isfinite(self.delay_s) and self.delay_s >= 0):
            raise InvalidInput(f"delay_s must be finite and not negative, got {self.delay_s}")
