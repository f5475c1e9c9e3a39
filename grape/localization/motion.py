"""How particles move with odometry.

Source: Thrun, Burgard and Fox, Probabilistic Robotics, 2005, table 5.6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class OdometryNoise:
    """Variances: of a turn `turn_by_turn` · turn² + `turn_by_way` · way², of a way `way_by_way` · way² +
    `way_by_turn` · turn²."""

    turn_by_turn: float = 0.1
    turn_by_way: float = 0.05
    way_by_way: float = 0.1
    way_by_turn: float = 0.05
    least_way: float = 0.005  # m and rad: what odometry is off by at least
    least_turn: float = 0.005

    def __post_init__(self) -> None:
        if min(vars(self).values()) < 0:
            raise InvalidInput(f"noise must not be negative, got {self}")


def moved(poses: Array, step: Array, noise: OdometryNoise, rng: np.random.Generator) -> Array:
    """Poses (n, 3) after a step (3,) x y yaw of odometry in the robot's own axes, each with its own error."""
    from grape.localization.amcl_kernels import move

    x, y, turn = step.tolist()
    way = math.hypot(x, y)
    heading = math.atan2(y, x) if way > 0.01 else 0.0
    rest = math.remainder(turn - heading, math.tau)
    bend, unbend = _least_turn(heading), _least_turn(rest)  # driving backwards is no turn
    first = math.sqrt(noise.turn_by_turn * bend**2 + noise.turn_by_way * way**2)
    second = math.sqrt(noise.turn_by_turn * unbend**2 + noise.turn_by_way * way**2)
    along = math.sqrt(noise.way_by_way * way**2 + noise.way_by_turn * (bend**2 + unbend**2))
    std = np.array([first, along + noise.least_way, second + noise.least_turn])
    return move(poses, np.array([heading, way, rest]), std, rng.integers(2**64, dtype=np.uint64))


def _least_turn(angle: float) -> float:
    return min(abs(angle), abs(abs(angle) - math.pi))
