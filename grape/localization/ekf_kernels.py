"""Compiled steps of the 15-state filter; the state order is `state.STATE`.

Source: Moore and Stouch, A generalized extended Kalman filter implementation for the Robot Operating System, 2014.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.localization.ekf_observation import DIRECT, N, observe, rotated_by_rpy, rotation, wrap
from grape.messages import Array

__all__ = ["DIRECT", "advance", "correct", "flatten", "fuse", "observe", "predict", "rotation", "usable"]

LEAST_COS_PITCH = 1e-3  # Euler angles end at pitch 90 degrees; short of it the rates stay finite


@njit(cache=True)
def predict(x: Array, P: Array, noise: Array, motion_noise: Array, turn_noise: Array, dt: float) -> tuple[Array, Array]:
    """Mean and covariance after `dt` seconds of constant body acceleration and constant body rates.

    The process noise grows with time (`noise`, per s), way (`motion_noise`, per m) and turning (`turn_noise`, per rad).
    """
    R = rotation(x[3], x[4], x[5])
    cr, sr = np.cos(x[3]), np.sin(x[3])
    cp, tp = np.cos(x[4]), np.tan(x[4])
    if abs(cp) < LEAST_COS_PITCH:
        cp = LEAST_COS_PITCH
        tp = np.sin(x[4]) / cp
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
    A, Qt = np.zeros((N, N)), np.zeros((N, N))
    for i in range(N):
        for k in range(N):
            if F[i, k] != 0.0:
                for j in range(N):
                    A[i, j] += F[i, k] * P[k, j]
    At = A.T.copy()  # the transposed product, so that innermost loops run along rows
    for j in range(N):
        for k in range(N):
            if F[j, k] != 0.0:
                for i in range(N):
                    Qt[j, i] += At[k, i] * F[j, k]
    Q = Qt.T.copy()
    for i in range(N):
        Q[i, i] += (noise[i] + motion_noise[i] * speed + turn_noise[i] * rate) * dt
    return y, Q


@njit(cache=True)
def flatten(x: Array, P: Array) -> None:
    """Hold what leaves the plane (z, roll, pitch, their rates, az) at zero, in place."""
    for i in (2, 3, 4, 8, 9, 10, 14):
        x[i] = 0.0
        for j in range(N):
            P[i, j] = P[j, i] = 0.0
        P[i, i] = 1e-9


@njit(cache=True)
def advance(x: Array, P: Array, noises: Array, duration: float, steps: int, two_d: bool) -> tuple[Array, Array]:
    """Mean and covariance after `duration` seconds in so many equal steps; `noises` (3, 15) as of `predict`."""
    y, C = x.copy(), P.copy()
    for _ in range(steps):
        y, C = predict(y, C, noises[0], noises[1], noises[2], duration / steps)
    if two_d:
        flatten(y, C)
    return y, C


@njit(cache=True)
def usable(value: Array, covariance: Array, lever: Array) -> bool:
    """Whether all numbers are finite and the covariance is symmetric and positive definite."""
    m = value.shape[0]
    for k in range(3):
        if not np.isfinite(lever[k]):
            return False
    L = np.zeros((m, m))
    for i in range(m):
        if not np.isfinite(value[i]):
            return False
        for j in range(i + 1):
            c = covariance[i, j]
            if not np.isfinite(c) or abs(c - covariance[j, i]) > 1e-9 * (abs(c) + abs(covariance[j, i])):
                return False
            for k in range(j):
                c -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = c / L[j, j]
            elif c <= 0.0:
                return False
            else:
                L[i, i] = np.sqrt(c)
    return True


@njit(cache=True)
def correct(
    x: Array, P: Array, index: Array, z: Array, R: Array, lever: Array, gate: float, frames: Array
) -> tuple[Array, Array, float]:
    """Kalman update with the values z (m,) and covariance R (m, m); returns mean, covariance, Mahalanobis distance.

    Beyond the distance `gate` the mean and covariance come back unchanged.
    """
    m = index.shape[0]
    h, H = observe(x, index, lever, frames)
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
    y, C, Bt = x.copy(), P.copy(), B.T.copy()
    for i in range(N):
        for k in range(m):
            y[i] += B[i, k] * u[k]
            for j in range(N):
                C[i, j] -= B[i, k] * Bt[k, j]
    for i in range(3, 6):
        y[i] = wrap(y[i])
    return y, 0.5 * (C + C.T), distance


@njit(cache=True)
def fuse(
    x: Array,
    P: Array,
    noises: Array,
    duration: float,
    steps: int,
    two_d: bool,
    index: Array,
    z: Array,
    R: Array,
    lever: Array,
    gate: float,
    frames: Array,
) -> tuple[Array, Array, float]:
    """`advance` and then `correct`, in one call; the distance is nan when the measurement is not `usable`."""
    if not usable(z, R, lever):
        return x.copy(), P.copy(), np.nan
    y, C = advance(x, P, noises, duration, steps, False)
    if two_d and steps > 0:
        flatten(y, C)
    y, C, distance = correct(y, C, index, z, R, lever, gate, frames)
    if two_d:
        flatten(y, C)
    return y, C, distance
