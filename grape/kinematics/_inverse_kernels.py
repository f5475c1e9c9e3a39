"""The compiled iteration of inverse kinematics; imported only where it is used."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def solve(placements, axes, low, high, T_target, q, iterations, position_tolerance, rotation_tolerance, step_max, damp):
    """Damped least squares from `q`; (converged, q, error (6,), iterations used). `q` (n,) is changed in place."""
    n = len(q)
    T, J, error = np.empty((4, 4)), np.empty((6, n)), np.empty(6)
    A = np.empty((6, 6))
    for iteration in range(iterations + 1):
        forward(placements, axes, q, T, J)
        _pose_error(T_target, T, error)
        distance = np.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
        angle = np.sqrt(error[3] ** 2 + error[4] ** 2 + error[5] ** 2)
        if distance < position_tolerance and angle < rotation_tolerance:
            return True, q, error, iteration
        if iteration == iterations:
            break
        damping = damp if distance + angle > 0.05 else 1e-3 * damp
        for r in range(6):
            for c in range(6):
                value = damping if r == c else 0.0
                for k in range(n):
                    value += J[r, k] * J[c, k]
                A[r, c] = value
        weights = np.linalg.solve(A, error)
        step = np.zeros(n)
        largest = 1e-12
        for k in range(n):
            for r in range(6):
                step[k] += J[r, k] * weights[r]
            largest = max(largest, abs(step[k]))
        scale = min(1.0, step_max / largest)
        for k in range(n):
            q[k] = min(max(q[k] + scale * step[k], low[k]), high[k])
    return False, q, error, iterations


@njit(cache=True)
def forward(placements, axes, q, T, J):
    """Fills the hand's pose T (4, 4) and its Jacobian J (6, n), linear rows first, both along the base axes."""
    n = len(q)
    R, p = np.eye(3), np.zeros(3)
    origins = np.empty((n, 3))
    for i in range(n):
        for r in range(3):
            for c in range(3):
                p[r] += R[r, c] * placements[i, c, 3]
        R = _product(_product(R, placements[i]), _turn(axes[i], q[i]))
        for r in range(3):
            origins[i, r] = p[r]
            J[3 + r, i] = R[r, 0] * axes[i, 0] + R[r, 1] * axes[i, 1] + R[r, 2] * axes[i, 2]
    for i in range(n):
        dx, dy, dz = p[0] - origins[i, 0], p[1] - origins[i, 1], p[2] - origins[i, 2]
        ax, ay, az = J[3, i], J[4, i], J[5, i]
        J[0, i], J[1, i], J[2, i] = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
    T[:] = 0.0
    T[3, 3] = 1.0
    for r in range(3):
        T[r, 3] = p[r]
        for c in range(3):
            T[r, c] = R[r, c]


@njit(cache=True)
def _product(A, B):
    """Product of the upper left 3 x 3 blocks."""
    C = np.zeros((3, 3))
    for r in range(3):
        for c in range(3):
            for k in range(3):
                C[r, c] += A[r, k] * B[k, c]
    return C


@njit(cache=True)
def _turn(axis, angle):
    """Rotation (3, 3) about a unit axis: Rodrigues' formula."""
    s, c = np.sin(angle), np.cos(angle)
    x, y, z = axis[0], axis[1], axis[2]
    v = 1.0 - c
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    R[1, 0], R[1, 1], R[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    R[2, 0], R[2, 1], R[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v
    return R


@njit(cache=True)
def _pose_error(T_target, T, error):
    """Fills `error` (6,): target minus current, translation, then rotation vector."""
    for r in range(3):
        error[r] = T_target[r, 3] - T[r, 3]
    rotation_between(T_target, T, error[3:])


@njit(cache=True)
def rotation_between(R_target, R, vector):
    """Fills the rotation vector (3,) of R_target R^T, angle in [0, pi]; of poses the rotation counts."""
    D = np.empty((3, 3))
    for r in range(3):
        for c in range(3):
            D[r, c] = R_target[r, 0] * R[c, 0] + R_target[r, 1] * R[c, 1] + R_target[r, 2] * R[c, 2]
    x, y, z = D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]
    trace = D[0, 0] + D[1, 1] + D[2, 2]
    sine = np.sqrt(x * x + y * y + z * z)
    angle = np.arctan2(sine, trace - 1.0)
    if sine > 1e-9:
        vector[0], vector[1], vector[2] = x / sine * angle, y / sine * angle, z / sine * angle
    elif trace > 0.0:
        vector[0], vector[1], vector[2] = 0.5 * x, 0.5 * y, 0.5 * z
    else:
        k = 0
        for i in range(1, 3):
            if D[i, i] > D[k, k]:
                k = i
        axis = np.sqrt(max(0.5 * (1.0 + D[k, k]), 1e-12))
        for i in range(3):
            vector[i] = np.pi * (axis if i == k else 0.5 * D[i, k] / axis)
