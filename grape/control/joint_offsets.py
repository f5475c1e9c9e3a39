"""How far the joints' encoders are off, from one hand pose that was measured by other means than they."""

from __future__ import annotations

import numpy as np

from grape.geometry import pose_error
from grape.kinematics import ArmModel
from grape.messages import Array

OFFSET_SIGMA_RAD = np.radians(2.0)  # of an encoder's zero, before anything was measured
POSE_SIGMA = np.array([5e-4, 5e-4, 5e-4, 1e-3, 1e-3, 1e-3])  # of the measured pose, m and rad


def joint_offsets(arm: ArmModel, q: Array, T_base_hand: Array) -> Array:
    """Most likely offsets (n,) rad by which the encoders tell more than the joints have turned.

    Six measured coordinates against as many joints: near the posture they hold well, and where the hand can be moved
    without being seen to move, the offsets stay small.

    Args:
        arm: kinematics.
        q: (n,) rad, what the encoders tell.
        T_base_hand: (4, 4) where the hand really is, in the arm's base frame.
    """
    q = np.asarray(q, float)
    offsets = np.zeros_like(q)
    weight = 1.0 / POSE_SIGMA**2
    for _ in range(5):
        T, J = arm.fk_jacobian(q - offsets)
        error = pose_error(T, T_base_hand)  # what a smaller joint angle would take away
        gradient = J.T @ (weight * error) - offsets / OFFSET_SIGMA_RAD**2
        hessian = (J.T * weight) @ J + np.eye(len(q)) / OFFSET_SIGMA_RAD**2
        offsets = offsets + np.linalg.solve(hessian, gradient)
    return offsets
