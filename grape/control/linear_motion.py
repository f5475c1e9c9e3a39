"""Inverted differential kinematics: the hand on a straight line at constant orientation, at 100 Hz."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.control.approach import ApproachWatch
from grape.control.differential_ik import DifferentialIk
from grape.errors import ActionFailed, InvalidInput, Reason
from grape.geometry import is_pose, rotation_log
from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class LinearMotionOptions:
    """How a straight motion runs.

    Args:
        speed: m/s.
        acceleration: m/s^2 of the trapezoidal speed profile.
        position_gain, orientation_gain: 1/s.
        lead_max_m: the set-point waits when it is this far ahead of the hand.
        stop_distance_m: done when the hand is nearer to the target than this and the profile has ended.
        grace_m: the distance to the target may grow over the first centimetres, until this much was travelled ...
        growth_max_m: ... after that, this much above the smallest distance so far ends the motion.
        stall_s: time without progress after which the motion is given up.
    """

    speed: float = 0.08
    acceleration: float = 0.2
    position_gain: float = 3.0
    orientation_gain: float = 2.0
    lead_max_m: float = 0.02
    stop_distance_m: float = 0.002
    grace_m: float = 0.025
    growth_max_m: float = 0.006
    stall_s: float = 2.0

    def __post_init__(self) -> None:
        if not (self.speed > 0 and self.acceleration > 0):
            raise InvalidInput(f"speed and acceleration must be positive, got {self.speed} and {self.acceleration}")


@dataclass(frozen=True, kw_only=True)
class LinearMotionStep:
    """Joint velocities (n,) rad/s to send, the distance left (m), progress 0..1, and whether it is done."""

    velocity: Array
    distance_m: float
    progress: float
    done: bool


class LinearMotion:
    """One straight motion of the hand from where it is to a position; the orientation at the start is held.

    Args:
        solver: differential inverse kinematics of the arm.
        q_start: (n,) rad, measured at the start.
        p_base_target: (3,) m, where the hand's origin ends, in the arm's base frame.
        options: speed and stops.
        R_base_hand: (3, 3) orientation to hold; the one at the start when None.
    """

    def __init__(
        self,
        solver: DifferentialIk,
        q_start: Array,
        p_base_target: Array,
        options: LinearMotionOptions | None = None,
        R_base_hand: Array | None = None,
    ) -> None:
        target = np.array(p_base_target, dtype=float)
        if target.shape != (3,) or not np.isfinite(target).all():
            raise InvalidInput(f"the target must be three finite numbers in m, got {p_base_target}")
        T_start = solver.arm.fk(q_start)
        if not is_pose(T_start):
            raise InvalidInput(f"the arm's pose at the start is not rigid: {T_start}")
        self.options = options or LinearMotionOptions()
        self._solver = solver
        self._start, self._target = T_start[:3, 3].copy(), target
        self._rotation = (T_start[:3, :3] if R_base_hand is None else np.asarray(R_base_hand, float)).copy()
        self.length = float(np.linalg.norm(target - self._start))
        self._direction = (target - self._start) / max(self.length, 1e-9)
        self._s, self._speed, self._scale = 0.0, 0.0, 1.0  # m and m/s along the line; share of it that was possible
        self._approach = ApproachWatch(self._start, target, self.options.grace_m, self.options.growth_max_m)
        self._still_s = 0.0

    def step(self, q: Array, dt: float) -> LinearMotionStep:
        """The command for measured joint angles `q` (n,) rad, `dt` seconds after the last one.

        Raises:
            ActionFailed: DISTANCE_GROWS when the hand moves away from the target, UNREACHABLE when it does not move on.
        """
        T = self._solver.arm.fk(q)
        distance = self._watch(T[:3, 3], dt)
        progress = 1.0 if self.length < 1e-9 else float(np.clip(1.0 - distance / self.length, 0.0, 1.0))
        if self._s >= self.length - 1e-9 and distance < self.options.stop_distance_m:
            rest = np.zeros_like(np.asarray(q, float))
            return LinearMotionStep(velocity=rest, distance_m=distance, progress=1.0, done=True)
        self._advance(T, dt)
        command = self._solver.solve(q, self._twist(T))
        self._scale = command.scale
        return LinearMotionStep(velocity=command.velocity, distance_m=distance, progress=progress, done=False)

    def _watch(self, p: Array, dt: float) -> float:
        """The distance left (m) of a hand at `p`; abort rules: growing distance, or none of it gained."""
        least = self._approach.least_m
        distance = self._approach.observe(p)
        self._still_s = 0.0 if distance < least - 5e-4 else self._still_s + dt
        if self._still_s > self.options.stall_s and distance >= self.options.stop_distance_m:
            raise ActionFailed(Reason.UNREACHABLE, f"the hand stays {distance * 1e3:.1f} mm from the target")
        return distance

    def _advance(self, T: Array, dt: float) -> None:
        """Move the set-point by the trapezoidal profile, as far as the arm followed."""
        options = self.options
        left = self.length - self._s
        braking = np.sqrt(2.0 * options.acceleration * max(left, 0.0))
        self._speed = min(self._speed + options.acceleration * dt, options.speed, braking) if left > 1e-9 else 0.0
        ahead = self._s - float(self._direction @ (T[:3, 3] - self._start))
        if ahead < options.lead_max_m:
            self._s = min(self._s + self._speed * self._scale * dt, self.length)
            if self.length - self._s < 1e-4:
                self._s = self.length

    def _twist(self, T: Array) -> Array:
        """Feed-forward along the line and corrections of position and orientation, (6,) base axes."""
        options = self.options
        reference = self._start + self._s * self._direction
        feed_forward = self._speed * self._direction if self._s < self.length else np.zeros(3)
        linear = feed_forward + options.position_gain * (reference - T[:3, 3])
        return np.r_[linear, options.orientation_gain * rotation_log(self._rotation @ T[:3, :3].T)]
