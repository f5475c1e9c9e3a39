"""Compiled kernels of the servo beat; imported only where they run, since numba is slow to load."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.kinematics._inverse_kernels import forward, rotation_between

SWEEPS = 30  # far more than are ever needed; convergence is quadratic


@njit(cache=True)
def damped_inverse(J, twist, damping_sigma, rotation_weight):
    """Joint velocities (n,) with least squared error of the twist, and the smallest singular value of the Jacobian."""
    wish = twist.copy()
    wish[3:] *= rotation_weight
    rows, U = _weighted_rows(J, rotation_weight), np.eye(6)
    squares = _orthogonalised(rows, U)
    smallest = np.sqrt(_smallest(squares, J.shape[1]))
    damping = max(damping_sigma**2 - smallest**2, 0.0)
    velocity = np.zeros(J.shape[1])
    for k in range(6):
        along = 0.0
        for r in range(6):
            along += U[k, r] * wish[r]
        along /= max(squares[k] + damping, 1e-12)
        for i in range(len(velocity)):
            velocity[i] += rows[k, i] * along
    return velocity, smallest


@njit(cache=True)
def _smallest_singular_value(J, rotation_weight):
    rows = _weighted_rows(J, rotation_weight)
    return np.sqrt(_smallest(_orthogonalised(rows, np.eye(6)), J.shape[1]))


@njit(cache=True)
def _weighted_rows(J, rotation_weight):
    rows = J.copy()
    rows[3:] *= rotation_weight
    return rows


@njit(cache=True)
def _smallest(squares, joints):
    """Smallest of as many squared singular values as there are, which fewer than six joints make fewer than six."""
    return np.sort(squares)[max(6 - joints, 0)]


@njit(cache=True)
def _orthogonalised(rows, U):
    """In place: turns rows (6, n) by plane rotations, kept in U, until they are orthogonal; their squared lengths (6,).

    With U A the rows in the end, A = U^T diag(sigma) V^T, and row k is sigma_k times row k of V^T.
    Source: Hestenes, Inversion of matrices by biorthogonalization and related results, 1958.
    """
    for _ in range(SWEEPS):
        settled = True
        for a in range(5):
            for b in range(a + 1, 6):
                aa, bb, ab = _dot(rows, a, a), _dot(rows, b, b), _dot(rows, a, b)
                if ab * ab > 1e-28 * aa * bb:
                    settled = False
                    lean = (bb - aa) / (2.0 * ab)
                    tangent = np.copysign(1.0, lean) / (abs(lean) + np.sqrt(1.0 + lean * lean))
                    _rotate(rows, a, b, tangent)
                    _rotate(U, a, b, tangent)
        if settled:
            break
    squares = np.empty(6)
    for k in range(6):
        squares[k] = _dot(rows, k, k)
    return squares


@njit(cache=True)
def _dot(rows, a, b):
    total = 0.0
    for i in range(rows.shape[1]):
        total += rows[a, i] * rows[b, i]
    return total


@njit(cache=True)
def _rotate(rows, a, b, tangent):
    """Turns two rows in their plane."""
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    sine = cosine * tangent
    for i in range(rows.shape[1]):
        one, two = rows[a, i], rows[b, i]
        rows[a, i], rows[b, i] = cosine * one - sine * two, sine * one + cosine * two


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
        ahead = _smallest_singular_value(J, options[6])
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


@njit(cache=True)
def to_camera(T_base_camera, p_base):
    """A point (3,) of the base frame in the optical frame."""
    p = np.zeros(3)
    for r in range(3):
        for c in range(3):
            p[r] += T_base_camera[c, r] * (p_base[c] - T_base_camera[c, 3])
    return p


@njit(cache=True)
def holding_twist(T_base_camera, v_camera, T_base_start, orientation_gain):
    """Twist (6,) along the base axes: a velocity of the optical frame, and the turn back to `T_base_start` (4, 4)."""
    twist = np.zeros(6)
    rotation_between(T_base_start, T_base_camera, twist[3:])
    for r in range(3):
        twist[3 + r] *= orientation_gain
        for c in range(3):
            twist[r] += T_base_camera[r, c] * v_camera[c]
    return twist
