"""Torques on an arm from outside, by what its motors do and how its links move: the arm feels what it touches.

Source: A. De Luca, A. Albu-Schaeffer, S. Haddadin, G. Hirzinger, "Collision detection and safe reaction with the
DLR-III lightweight manipulator arm", IROS 2006: the observer of the generalized momentum, which needs no acceleration.
"""

from __future__ import annotations

import numpy as np

from grape.errors import InvalidInput
from grape.kinematics import ArmModel
from grape.messages import Array, JointState

GRAVITY = (0.0, 0.0, -9.81)  # m/s^2
SLOW = 0.02  # rad/s, around which friction changes its sign


class ContactObserver:
    """Estimates the torques (n,) N m by which something outside turns an arm's joints; positive turns them on.

    Args:
        arm: the arm with all that it carries.
        motor_inertia: (n,) kg m^2 that turn with the motors, as felt at the joints; 0 where torques are measured behind
            the gears.
        friction: (n,) N m between the measured torques and the links.
        gain: 1/s; the estimate follows with this time constant.
        gap_s: after a longer time without joint states, or when their time goes back, it begins anew.
    """

    def __init__(
        self, arm: ArmModel, motor_inertia: Array, friction: Array, gain: float = 25.0, gap_s: float = 0.25
    ) -> None:
        self._arm, self._gain, self._gap_s = arm, gain, gap_s
        self._inertia, self._friction = arm.checked(motor_inertia), arm.checked(friction)
        if not (0.0 < gain < np.inf and 0.0 < gap_s < np.inf):
            raise InvalidInput(f"gain and gap_s must be above 0 and finite, got {gain} and {gap_s}")
        self._stamp, self._momentum = -np.inf, np.zeros(arm.dof)
        self.torques = np.zeros(arm.dof)

    def update(self, joints: JointState, gravity: Array | tuple[float, float, float] = GRAVITY) -> Array:
        """The torques (n,) N m after one more joint state; the same one again changes nothing.

        Args:
            joints: angles, speeds and the motors' torques, with what holds the arm against gravity in them.
            gravity: (3,) m/s^2 in the arm's base frame.

        Raises:
            InvalidInput: a value is not finite, or there are not as many as joints.
        """
        if joints.stamp == self._stamp:
            return self.torques
        q, dq, effort = (self._arm.checked(values) for values in (joints.position, joints.velocity, joints.effort))
        momentum = self._arm.mass_matrix(q) @ dq + self._inertia * dq
        dt, self._stamp = joints.stamp - self._stamp, joints.stamp
        gained, self._momentum = momentum - self._momentum, momentum
        if not 0.0 < dt <= self._gap_s:
            self.torques = np.zeros(self._arm.dof)
            return self.torques
        driven = effort - self._friction * np.tanh(dq / SLOW) + self._arm.momentum_rate(q, dq, gravity)
        share = 1.0 - np.exp(-self._gain * dt)
        self.torques = self.torques + share * (gained / dt - driven - self.torques)
        return self.torques
