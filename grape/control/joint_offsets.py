"""How far the joints' encoders are off, from hand poses that were measured by other means than they."""

from __future__ import annotations

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import pose_error
from grape.kinematics import ArmModel
from grape.messages import Array

OFFSET_SIGMA_RAD = np.radians(2.0)  # of an encoder's zero, before anything was measured
POSE_SIGMA = np.array([5e-4, 5e-4, 5e-4, 1e-3, 1e-3, 1e-3])  # of a pose that servoing has reached, m and rad


def joint_offsets(arm: ArmModel, q: Array, T_base_hand: Array, sigma: Array = POSE_SIGMA) -> Array:
    """Most likely offsets (n,) rad by which the encoders tell more than the joints have turned.

    From one pose, six measured coordinates against as many joints: near the posture they hold well, and where the hand
    can be moved without being seen to move, the offsets stay small. Poses in several postures hold everywhere.

    Args:
        arm: kinematics.
        q: (n,) rad, what the encoders tell; or (k, n), one row a pose.
        T_base_hand: (4, 4) where the hand really is, in the arm's base frame; or (k, 4, 4).
        sigma: (6,) m and rad, of a measured pose.

    Raises:
        InvalidInput: there are not as many postures as poses.
    """
    q, measured = np.atleast_2d(np.asarray(q, float)), np.asarray(T_base_hand, float).reshape(-1, 4, 4)
    if len(q) != len(measured):
        raise InvalidInput(f"{len(q)} postures need as many hand poses, got {len(measured)}")
    offsets = np.zeros(q.shape[1])
    weight = 1.0 / np.asarray(sigma) ** 2
    for _ in range(5):
        gradient = -offsets / OFFSET_SIGMA_RAD**2
        hessian = np.eye(len(offsets)) / OFFSET_SIGMA_RAD**2
        for told, T_measured in zip(q, measured, strict=True):
            T, J = arm.fk_jacobian(told - offsets)
            error = pose_error(T, T_measured)  # what a smaller joint angle would take away
            gradient = gradient + J.T @ (weight * error)
            hessian = hessian + (J.T * weight) @ J
        offsets = offsets + np.linalg.solve(hessian, gradient)
    return offsets
