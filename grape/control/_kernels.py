"""Compiled kernels of the servo beat; imported only where they run, since numba is slow to load."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.kinematics._inverse_kernels import forward


@njit(cache=True)
def damped_inverse(J, twist, damping_sigma, rotation_weight):
    """Joint velocities (n,) with least squared error of the twist, and the smallest singular value of the Jacobian."""
    weighted, wish = J.copy(), twist.copy()
    weighted[3:] *= rotation_weight
    wish[3:] *= rotation_weight
    U, sigma, Vt = np.linalg.svd(weighted, False)
    smallest = sigma[-1]
    damping = max(damping_sigma**2 - smallest**2, 0.0)
    velocity = np.zeros(J.shape[1])
    for k in range(len(sigma)):
        along = 0.0
        for r in range(6):
            along += U[r, k] * wish[r]
        along *= sigma[k] / max(sigma[k] ** 2 + damping, 1e-12)
        for i in range(len(velocity)):
            velocity[i] += Vt[k, i] * along
    return velocity, smallest


@njit(cache=True)
def joint_velocities(q, twist, placements, axes, bounds, options):
    """Joint velocities of one arm before singularities and obstacles slow them down.

    Args:
        q: (n,) rad; twist: (6,), see `DifferentialIk.solve`.
        placements, axes: the chain, see `ArmModel`.
        bounds: (3, n) least and largest angles, largest speeds.
        options: (7,) damping_sigma, sigma_slow, linear_max, angular_max, limit_margin_rad, look_ahead_s, and the weight
            of angular rows.

    Returns:
        velocity (n,); scale, the share of the wish that the limits left; smallest singular value here, and, where it is
        below sigma_slow, a beat ahead (else infinite); held (n,) bool.
    """
    n = len(q)
    linear = np.sqrt(twist[0] ** 2 + twist[1] ** 2 + twist[2] ** 2)
    angular = np.sqrt(twist[3] ** 2 + twist[4] ** 2 + twist[5] ** 2)
    scale = 1.0 / max(1.0, linear / options[2], angular / options[3])
    wish = twist * scale
    T, J = np.empty((4, 4)), np.empty((6, n))
    forward(placements, axes, q, T, J)
    velocity, sigma = damped_inverse(J, wish, options[0], options[6])
    held = np.zeros(n, np.bool_)
    if _hold(q, velocity, bounds, options[4], held):  # once more with the free joints only
        reduced = J.copy()
        for i in range(n):
            if held[i]:
                reduced[:, i] = 0.0
        velocity = damped_inverse(reduced, wish, options[0], options[6])[0]
        _hold(q, velocity, bounds, options[4], held)
        for i in range(n):
            if held[i]:
                velocity[i] = 0.0
    excess = 1.0
    for i in range(n):
        excess = max(excess, abs(velocity[i]) / bounds[2, i])
    velocity /= excess
    ahead = np.inf
    if sigma < options[1]:
        forward(placements, axes, q + options[5] * velocity, T, J)
        J[3:] *= options[6]
        ahead = np.linalg.svd(J, False)[1][-1]
    return velocity, scale / excess, sigma, ahead, held


@njit(cache=True)
def _hold(q, velocity, bounds, margin, held):
    """Marks the joints that would move into their limits; whether any does."""
    found = False
    for i in range(len(q)):
        low = q[i] < bounds[0, i] + margin and velocity[i] < 0.0
        high = q[i] > bounds[1, i] - margin and velocity[i] > 0.0
        if low or high:
            held[i] = found = True
    return found


@njit(cache=True)
def interaction_matrix(xy, depth):
    """(2 n, 6): how normalised points (n, 2) at depths (n,) m move with the camera's twist (optical frame)."""
    L = np.zeros((2 * len(xy), 6))
    for i in range(len(xy)):
        x, y, iz = xy[i, 0], xy[i, 1], 1.0 / depth[i]
        a, b = 2 * i, 2 * i + 1
        L[a, 0], L[a, 2], L[a, 3], L[a, 4], L[a, 5] = -iz, x * iz, x * y, -(1 + x * x), y
        L[b, 1], L[b, 2], L[b, 3], L[b, 4], L[b, 5] = -iz, y * iz, 1 + y * y, -x * y, -x
    return L


@njit(cache=True)
def feature_twist(T_base_camera, corners, views, square):
    """The camera's twist that would take the corners of markers where they should be in one second.

    Args:
        T_base_camera: (4, 4).
        corners: (4 k, 3) m, base frame; views: (k, 4, 4) desired `T_camera_marker`; square: (4, 3) m, of a marker.

    Returns:
        L^+ (s - s*) with its sign turned, (6,) along the base axes, and the largest error in normalised coordinates.
    """
    n = len(corners)
    R = T_base_camera[:3, :3]
    middle, depth, error, largest = np.empty((n, 2)), np.empty(n), np.empty(2 * n), 0.0
    seen, wanted = np.empty(3), np.empty(3)
    for i in range(n):
        view, corner = views[i // 4], square[i % 4]
        for r in range(3):
            seen[r], wanted[r] = 0.0, view[r, 3]
            for c in range(3):
                seen[r] += R[c, r] * (corners[i, c] - T_base_camera[c, 3])
                wanted[r] += view[r, c] * corner[c]
        depth[i] = 0.5 * (seen[2] + wanted[2])
        for r in range(2):
            now, goal = seen[r] / seen[2], wanted[r] / wanted[2]
            middle[i, r], error[2 * i + r] = 0.5 * (now + goal), now - goal
            largest = max(largest, abs(now - goal))
    L = interaction_matrix(middle, depth)
    A, b = 1e-9 * np.eye(6), np.zeros(6)
    for m in range(2 * n):
        for r in range(6):
            b[r] -= L[m, r] * error[m]
            for c in range(6):
                A[r, c] += L[m, r] * L[m, c]
    v = np.linalg.solve(A, b)
    twist = np.zeros(6)
    for r in range(3):
        for c in range(3):
            twist[r] += R[r, c] * v[c]
            twist[3 + r] += R[r, c] * v[3 + c]
    return twist, largest
