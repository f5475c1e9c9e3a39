"""Compiled steps of the 15-state filter; the state order is `ekf.STATE`.

Source: Moore and Stouch, A generalized extended Kalman filter implementation for the Robot Operating System, 2014.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array

N = 15


@njit(cache=True)
def rotation(roll: float, pitch: float, yaw: float) -> Array:
    """R_map_base = Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = np.cos(roll), np.sin(roll)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    R[1, 0], R[1, 1], R[1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    R[2, 0], R[2, 1], R[2, 2] = -sp, cp * sr, cp * cr
    return R


@njit(cache=True)
def rotated_by_rpy(R: Array, roll: float, b: Array) -> Array:
    """Derivative (3, 3) of R(roll, pitch, yaw) b by (roll, pitch, yaw)."""
    cr, sr = np.cos(roll), np.sin(roll)
    J = np.empty((3, 3))
    # dR/droll = R [e_x]x, dR/dpitch = R [Rx^T e_y]x, dR/dyaw = [e_z]x R
    pitch_axis = (0.0, cr, -sr)
    for i in range(3):
        J[i, 0] = -R[i, 1] * b[2] + R[i, 2] * b[1]
        J[i, 1] = (
            R[i, 0] * (pitch_axis[1] * b[2] - pitch_axis[2] * b[1])
            + R[i, 1] * (pitch_axis[2] * b[0])
            - R[i, 2] * (pitch_axis[1] * b[0])
        )
    Rb0 = R[0, 0] * b[0] + R[0, 1] * b[1] + R[0, 2] * b[2]
    Rb1 = R[1, 0] * b[0] + R[1, 1] * b[1] + R[1, 2] * b[2]
    J[0, 2], J[1, 2], J[2, 2] = -Rb1, Rb0, 0.0
    return J


@njit(cache=True)
def wrap(angle: float) -> float:
    """The angle in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@njit(cache=True)
def predict(x: Array, P: Array, noise: Array, motion_noise: Array, turn_noise: Array, dt: float) -> tuple[Array, Array]:
    """Mean and covariance after `dt` seconds of constant body acceleration and constant body rates.

    The process noise grows with time (`noise`, per s), way (`motion_noise`, per m) and turning (`turn_noise`, per rad).
    """
    R = rotation(x[3], x[4], x[5])
    cr, sr = np.cos(x[3]), np.sin(x[3])
    cp, tp = np.cos(x[4]), np.tan(x[4])
    step = x[6:9] * dt + 0.5 * dt * dt * x[12:15]
    F = np.eye(N)
    F[0:3, 3:6] = rotated_by_rpy(R, x[3], step)
    F[0:3, 6:9] = R * dt
    F[0:3, 12:15] = R * (0.5 * dt * dt)
    # Euler angle rates: rpy' = E(roll, pitch) w
    wy, wz = x[10], x[11]
    turn = sr * wy + cr * wz
    F[3, 9], F[3, 10], F[3, 11] = dt, sr * tp * dt, cr * tp * dt
    F[4, 10], F[4, 11] = cr * dt, -sr * dt
    F[5, 10], F[5, 11] = sr / cp * dt, cr / cp * dt
    F[3, 3] += (cr * wy - sr * wz) * tp * dt
    F[3, 4] += turn / (cp * cp) * dt
    F[4, 3] += -turn * dt
    F[5, 3] += (cr * wy - sr * wz) / cp * dt
    F[5, 4] += turn * tp / cp * dt
    y = x.copy()
    for i in range(3):
        y[i] += R[i, 0] * step[0] + R[i, 1] * step[1] + R[i, 2] * step[2]
        y[6 + i] += x[12 + i] * dt
        F[6 + i, 12 + i] = dt
    y[3] = wrap(x[3] + (x[9] + turn * tp) * dt)
    y[4] = wrap(x[4] + (cr * wy - sr * wz) * dt)
    y[5] = wrap(x[5] + turn / cp * dt)
    speed, rate = np.sqrt(x[6] ** 2 + x[7] ** 2), abs(x[11])
    A = np.zeros((N, N))
    for i in range(N):
        for k in range(N):
            if F[i, k] != 0.0:
                for j in range(N):
                    A[i, j] += F[i, k] * P[k, j]
    Q = np.zeros((N, N))
    for i in range(N):
        for j in range(N):
            total = 0.0
            for k in range(N):
                total += A[i, k] * F[j, k]
            Q[i, j] = total
        Q[i, i] += (noise[i] + motion_noise[i] * speed + turn_noise[i] * rate) * dt
    return y, Q


@njit(cache=True)
def observe(x: Array, index: Array, lever: Array) -> tuple[Array, Array]:
    """Expected values (m,) of the state components `index` at the point `lever` (m, base frame), and their Jacobian."""
    m = index.shape[0]
    h, H = np.empty(m), np.zeros((m, N))
    R = rotation(x[3], x[4], x[5])
    J = rotated_by_rpy(R, x[3], lever)
    w = x[9:12]
    for k in range(m):
        i = index[k]
        h[k] = x[i]
        H[k, i] = 1.0
        if i < 3:
            h[k] += R[i, 0] * lever[0] + R[i, 1] * lever[1] + R[i, 2] * lever[2]
            H[k, 3:6] = J[i]
        elif 6 <= i < 9:  # velocity of the point: v + w x lever
            a, b = (i - 6 + 1) % 3, (i - 6 + 2) % 3
            h[k] += w[a] * lever[b] - w[b] * lever[a]
            H[k, 9 + a] += lever[b]
            H[k, 9 + b] -= lever[a]
    return h, H


@njit(cache=True)
def correct(
    x: Array, P: Array, index: Array, z: Array, R: Array, lever: Array, gate: float
) -> tuple[Array, Array, float]:
    """Kalman update with the values z (m,) and covariance R (m, m); returns mean, covariance, Mahalanobis distance.

    Beyond the distance `gate` the mean and covariance come back unchanged.
    """
    m = index.shape[0]
    h, H = observe(x, index, lever)
    innovation = z - h
    for k in range(m):
        if 3 <= index[k] < 6:
            innovation[k] = wrap(innovation[k])
    PHt = np.zeros((N, m))
    for k in range(m):
        for j in range(N):
            if H[k, j] != 0.0:
                for i in range(N):
                    PHt[i, k] += P[i, j] * H[k, j]
    S = R.copy()
    for k in range(m):
        for n in range(m):
            for j in range(N):
                S[k, n] += H[k, j] * PHt[j, n]
    L = np.linalg.cholesky(0.5 * (S + S.T))
    # K S K^T = B B^T and K y = B u, with B = P H^T L^-T and u = L^-1 y
    B, u = PHt.copy(), innovation.copy()
    for k in range(m):
        for n in range(k):
            u[k] -= L[k, n] * u[n]
            for i in range(N):
                B[i, k] -= B[i, n] * L[k, n]
        u[k] /= L[k, k]
        for i in range(N):
            B[i, k] /= L[k, k]
    distance = 0.0
    for k in range(m):
        distance += u[k] * u[k]
    distance = np.sqrt(distance)
    if distance > gate:
        return x, P, distance
    y, C = x.copy(), P.copy()
    for i in range(N):
        for k in range(m):
            y[i] += B[i, k] * u[k]
        for j in range(N):
            for k in range(m):
                C[i, j] -= B[i, k] * B[j, k]
    for i in range(3, 6):
        y[i] = wrap(y[i])
    return y, 0.5 * (C + C.T), distance
