"""From a wished twist of the hand to joint velocities, near singularities, limits and obstacles too.

Source: Nakamura and Hanafusa, Inverse kinematic solutions with singularity robustness, 1986; Maciejewski and Klein,
Numerical filtering for the operation of robotic manipulators through kinematically singular configurations, 1988.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite

import numpy as np

from grape.control.compiled import kernels
from grape.errors import InvalidInput
from grape.kinematics import ROTATION_WEIGHT, ArmModel
from grape.messages import Array, frozen_array


@dataclass(frozen=True, kw_only=True)
class DifferentialIkOptions:
    """Limits of the hand and of the joints.

    Args:
        damping_sigma: singular value (angular rows times 0.2 m/rad) below which the inverse is damped.
        sigma_slow: from this singular value down the motion is slowed when it goes nearer to the singularity ...
        sigma_stop: ... and here it stops; away from the singularity it stays free.
        linear_max: m/s of the hand's origin.
        angular_max: rad/s of the hand.
        limit_margin_rad: a joint nearer to its limit than this does not move towards it.
        clearance_slow_m: from this clearance down the motion is slowed when it goes nearer ...
        clearance_stop_m: ... and here it stops; away from the obstacle it stays free.
        look_ahead_s: how far ahead singularity and clearance are looked at.
    """

    damping_sigma: float = 0.02
    sigma_slow: float = 0.015
    sigma_stop: float = 0.003
    linear_max: float = 0.15
    angular_max: float = 1.0
    limit_margin_rad: float = 0.1
    clearance_slow_m: float = 0.03
    clearance_stop_m: float = 0.005
    look_ahead_s: float = 0.1

    def __post_init__(self) -> None:
        if not 0.0 <= self.clearance_stop_m < self.clearance_slow_m:
            raise InvalidInput(
                f"0 <= clearance_stop_m < clearance_slow_m must hold, got {self.clearance_stop_m} and "
                f"{self.clearance_slow_m}"
            )
        if not 0.0 <= self.sigma_stop < self.sigma_slow:
            raise InvalidInput(f"0 <= sigma_stop < sigma_slow must hold, got {self.sigma_stop} and {self.sigma_slow}")


@dataclass(frozen=True, kw_only=True)
class JointVelocityCommand:
    """What `DifferentialIk.solve` found.

    Attributes:
        velocity: (n,) rad/s.
        scale: 0..1, the share of the wished speed that limits, singularities and obstacles left.
        hindrance: what left nothing or little of it: "singularity", "obstacle" or, where neither did, an empty string.
        sigma_min: smallest singular value of the Jacobian, angular rows times 0.2 m/rad.
        held_joints: joints kept from moving into their limits.
    """

    velocity: Array
    scale: float
    sigma_min: float
    held_joints: tuple[int, ...] = ()
    hindrance: str = ""


@dataclass(frozen=True, kw_only=True)
class DifferentialIk:
    """Damped least squares on one arm.

    Args:
        arm: kinematics; twists are along the axes of its base frame.
        velocity_max: (n,) rad/s; infinite when None, then the driver must limit and may bend the direction.
        options: limits.
        clearance: gap (m) to the nearest obstacle at joint angles (n,), such as `StateChecker.clearance`; None without.
    """

    arm: ArmModel
    velocity_max: Array | None = None
    options: DifferentialIkOptions = field(default_factory=DifferentialIkOptions)
    clearance: Callable[[Array], float] | None = None

    @classmethod
    def for_arm(
        cls,
        arm: ArmModel,
        velocity_max: Array | None = None,
        options: DifferentialIkOptions | None = None,
        clearance: Callable[[Array], float] | None = None,
    ) -> DifferentialIk:
        """The solver with default limits where none are given."""
        return cls(
            arm=arm,
            velocity_max=None if velocity_max is None else frozen_array(velocity_max, float),
            options=options or DifferentialIkOptions(),
            clearance=clearance,
        )

    def solve(self, q: Array, twist: Array) -> JointVelocityCommand:
        """Joint velocities for a wished twist.

        Args:
            q: (n,) rad, measured.
            twist: (6,) of the hand's origin, base axes: linear m/s, angular rad/s. Too fast a wish is scaled down as a
                whole, so the direction stays.

        Raises:
            InvalidInput: the twist is not six finite numbers.
        """
        twist = np.asarray(twist, dtype=float)
        if twist.shape != (6,) or not isfinite(sum(twist.tolist())):
            raise InvalidInput(f"a twist must be six finite numbers (m/s, rad/s), got {twist}")
        q = self.arm.checked(q)
        velocity, scale, sigma, sigma_ahead, held = kernels().joint_velocities(q, twist, *self._settings)
        share, hindrance = self._free_share(q, velocity, sigma, sigma_ahead)
        return JointVelocityCommand(
            velocity=velocity * share,
            scale=scale * share,
            sigma_min=sigma,
            held_joints=tuple(held.nonzero()[0].tolist()),
            hindrance=hindrance,
        )

    @cached_property
    def _settings(self) -> tuple[Array, Array, Array, Array]:
        """Chain, bounds (3, n) and options (7,) as the kernel takes them; it takes writable arrays more quickly."""
        arm, options = self.arm, self.options
        speed = np.full(arm.dof, np.inf) if self.velocity_max is None else self.velocity_max
        limits = (
            options.damping_sigma, options.sigma_slow, options.linear_max, options.angular_max,
            options.limit_margin_rad, options.look_ahead_s, ROTATION_WEIGHT,
        )  # fmt: skip
        bounds = np.array([arm.position_min, arm.position_max, speed])
        return arm.placements.copy(), arm.axes.copy(), bounds, np.array(limits)

    def _free_share(self, q: Array, velocity: Array, sigma: float, sigma_ahead: float) -> tuple[float, str]:
        """0..1: how much of the speed singularity and clearance allow, and which of them allows less than all."""
        if not velocity.any():
            return 1.0, ""
        options, share, hindrance = self.options, 1.0, ""
        if sigma_ahead < sigma < options.sigma_slow:
            share = (sigma_ahead - options.sigma_stop) / (options.sigma_slow - options.sigma_stop)
            hindrance = "singularity"
        if self.clearance is not None:
            gap = self.clearance(q + options.look_ahead_s * velocity)
            if gap < options.clearance_slow_m and gap <= self.clearance(q) + 1e-6:
                left = (gap - options.clearance_stop_m) / (options.clearance_slow_m - options.clearance_stop_m)
                if left < share:
                    share, hindrance = left, "obstacle"
        share = min(max(share, 0.0), 1.0)
        return share, hindrance if share < 1.0 else ""


def damped_inverse(J: Array, twist: Array, damping_sigma: float) -> tuple[Array, float]:
    """Joint velocities (n,) with least squared error of the twist, and the smallest singular value of the Jacobian.

    Below `damping_sigma` the squared damping grows from 0 to `damping_sigma`^2.
    """
    return kernels().damped_inverse(np.ascontiguousarray(J), twist, damping_sigma, ROTATION_WEIGHT)


def shift_twist(twist: Array, p_from: Array, p_to: Array) -> Array:
    """The twist (6,) of a rigid body at another of its points; both points (3,) m, along the twist's axes."""
    vx, vy, vz, wx, wy, wz = np.asarray(twist, dtype=float).tolist()
    dx, dy, dz = (np.asarray(p_to) - np.asarray(p_from)).tolist()
    return np.array([vx + wy * dz - wz * dy, vy + wz * dx - wx * dz, vz + wx * dy - wy * dx, wx, wy, wz])
