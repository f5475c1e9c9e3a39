"""The 15 states, what a sensor says about them, and what the filter made of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from grape.errors import InvalidInput, with_suggestion
from grape.geometry import is_pose
from grape.messages import Array, frozen_array

STATE = ("x", "y", "z", "roll", "pitch", "yaw", "vx", "vy", "vz", "wx", "wy", "wz", "ax", "ay", "az")
GRAVITY = 9.80665


def components(*names: str) -> tuple[bool, ...]:
    """The configuration vector (15 flags in the order of `STATE`) that is true for the named components.

    Raises:
        InvalidInput: a name is not in `STATE`.
    """
    unknown = [name for name in names if name not in STATE]
    if unknown:
        sentence = f"unknown state components {unknown}; allowed: {', '.join(STATE)}"
        raise InvalidInput(with_suggestion(sentence, unknown[0], STATE))
    return tuple(name in names for name in STATE)


@dataclass(frozen=True, kw_only=True)
class Mount:
    """Where a sensor sits on the robot, and the frame of the world in which it gives poses.

    Args:
        T_base_sensor: (4, 4) pose of the sensor in base_link.
        T_world_frame: (4, 4) pose of the frame of its poses in the filter's world.
        gravity: m/s^2 in what its accelerometer gives; 0 when gravity has been taken off.
    """

    T_base_sensor: Array = field(default_factory=lambda: np.eye(4))
    T_world_frame: Array = field(default_factory=lambda: np.eye(4))
    gravity: float = GRAVITY

    def __post_init__(self) -> None:
        for name in ("T_base_sensor", "T_world_frame"):
            T = frozen_array(getattr(self, name), float)
            if not is_pose(T):
                raise InvalidInput(f"{name} must be a rigid transform (4, 4), got\n{T}")
            object.__setattr__(self, name, T)
        if not isfinite(self.gravity):
            raise InvalidInput(f"gravity must be finite, got {self.gravity}")
        W, B = self.T_world_frame, self.T_base_sensor
        frames = np.concatenate([B[:3, :3].ravel(), W[:3, :3].ravel(), W[:3, 3], [self.gravity]])
        object.__setattr__(self, "frames", frozen_array(frames))
        object.__setattr__(self, "lever", frozen_array(B[:3, 3]))

    frames: Array = field(init=False, repr=False, compare=False)  # (22,) as the kernels take it
    lever: Array = field(init=False, repr=False, compare=False)  # (3,) m, place of the sensor in base_link


_ORIGIN = frozen_array(np.zeros(3))
_DIRECT = frozen_array(np.empty(0))


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """Values of some state components at one time.

    Args:
        source: name of the sensor, for counting and reports.
        index: (m,) indices into `STATE`.
        value: (m,) what was measured; positions in map, velocities, rates and accelerations in base_link.
        covariance: (m, m).
        lever: (3,) m, point of base_link whose position and velocity are meant (a GNSS antenna).
        gate: largest Mahalanobis distance that is accepted.
        mount: when given, it takes the place of `lever`: positions are in the sensor's own frame of the world,
            velocities, rates and specific forces (with centripetal part and gravity) along the sensor's axes.
            Attitudes are roll, pitch, yaw of base_link in either case.
    """

    stamp: float
    source: str
    index: Array
    value: Array
    covariance: Array
    lever: Array = field(default_factory=lambda: _ORIGIN)
    gate: float = inf
    mount: Mount | None = None

    def __post_init__(self) -> None:
        if self.mount is not None:
            object.__setattr__(self, "lever", self.mount.lever)
        for name, dtype in (("index", np.int64), ("value", float), ("covariance", float), ("lever", float)):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype))
        m = self.index.size
        if m == 0 or self.value.shape != (m,) or self.covariance.shape != (m, m) or self.lever.shape != (3,):
            raise InvalidInput(
                f"{self.source}: {m} components need values ({m},), covariance ({m}, {m}) and lever (3,), got "
                f"{self.value.shape}, {self.covariance.shape}, {self.lever.shape}"
            )
        if not all(0 <= i < len(STATE) for i in self.index.tolist()):
            raise InvalidInput(f"{self.source}: indices must lie in 0 .. {len(STATE) - 1}, got {self.index}")

    @property
    def frames(self) -> Array:
        """The mount as the kernels take it."""
        return _DIRECT if self.mount is None else self.mount.frames

    @property
    def usable(self) -> bool:
        """Whether the numbers are finite and the covariance is symmetric and positive definite."""
        from grape.localization.ekf_kernels import usable

        return isfinite(self.stamp) and usable(self.value, self.covariance, self.lever)


class Verdict(StrEnum):
    """What the filter did with a measurement."""

    ACCEPTED = "accepted"
    GATED = "gated"
    NOT_FINITE = "not_finite"
    TOO_OLD = "too_old"
    TOO_NEW = "too_new"


class Correction(NamedTuple):
    """The verdict and the Mahalanobis distance of the innovation (nan when it was not computed)."""

    verdict: Verdict
    distance: float = np.nan

    @property
    def accepted(self) -> bool:
        return self.verdict is Verdict.ACCEPTED


class Belief(NamedTuple):
    """Mean (15,) and covariance (15, 15) at a time; read-only."""

    stamp: float
    mean: Array
    covariance: Array
