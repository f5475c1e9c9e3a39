"""Compiled steps of the 15-state filter; the state order is `state.STATE`.

Source: Moore and Stouch, A generalized extended Kalman filter implementation for the Robot Operating System, 2014.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.localization.ekf_observation import DIRECT, N, observe, rotated_by_rpy, rotation, wrap
from grape.messages import Array

__all__ = ["DIRECT", "advance", "correct", "flatten", "fuse", "observe", "predict", "rotation", "usable"]

MOVED = 9  # states that a step changes: position, attitude and velocity
LEAST_COS_PITCH = 1e-3  # Euler angles end at pitch 90 degrees; short of it the rates stay finite


@njit(cache=True)
def predict(x: Array, P: Array, noise: Array, motion_noise: Array, turn_noise: Array, dt: float) -> tuple[Array, Array]:
    """Mean and covariance after `dt` seconds of constant body acceleration and constant body rates.

    The process noise grows with time (`noise`, per s), way (`motion_noise`, per m) and turning (`turn_noise`, per rad).
    """
    y, F = _moved(x, dt)
    Q = _spread(P, F)
    speed, rate = np.sqrt(x[6] ** 2 + x[7] ** 2), abs(x[11])
    for i in range(N):
        Q[i, i] += (noise[i] + motion_noise[i] * speed + turn_noise[i] * rate) * dt
    return y, Q


@njit(cache=True)
def _moved(x: Array, dt: float) -> tuple[Array, Array]:
    """The mean after `dt` seconds, and the rows (9, 15) of its Jacobian that differ from the identity."""
    R = rotation(x[3], x[4], x[5])
    cr, sr, cp, sp = np.cos(x[3]), np.sin(x[3]), np.cos(x[4]), -R[2, 0]
    if abs(cp) < LEAST_COS_PITCH:
        cp = LEAST_COS_PITCH
    tp = sp / cp
    y, F, step = x.copy(), np.zeros((MOVED, N)), np.empty(3)
    for i in range(3):
        step[i] = x[6 + i] * dt + 0.5 * dt * dt * x[12 + i]
    D = rotated_by_rpy(R, x[3], step)
    for i in range(3):
        F[i, i] = F[3 + i, 3 + i] = F[6 + i, 6 + i] = 1.0
        y[6 + i] += x[12 + i] * dt
        F[6 + i, 12 + i] = dt
        for j in range(3):
            y[i] += R[i, j] * step[j]
            F[i, 3 + j], F[i, 6 + j], F[i, 12 + j] = D[i, j], R[i, j] * dt, R[i, j] * (0.5 * dt * dt)
    # Euler angle rates: rpy' = E(roll, pitch) w
    turn, across = sr * x[10] + cr * x[11], cr * x[10] - sr * x[11]
    F[3, 9], F[3, 10], F[3, 11] = dt, sr * tp * dt, cr * tp * dt
    F[4, 10], F[4, 11] = cr * dt, -sr * dt
    F[5, 10], F[5, 11] = sr / cp * dt, cr / cp * dt
    F[3, 3] += across * tp * dt
    F[3, 4] += turn / (cp * cp) * dt
    F[4, 3] -= turn * dt
    F[5, 3] += across / cp * dt
    F[5, 4] += turn * tp / cp * dt
    y[3] = wrap(x[3] + (x[9] + turn * tp) * dt)
    y[4] = wrap(x[4] + across * dt)
    y[5] = wrap(x[5] + turn / cp * dt)
    return y, F


@njit(cache=True)
def _spread(P: Array, F: Array) -> Array:
    """The symmetric P (15, 15) after a step whose Jacobian has the rows F (9, 15) and then those of the identity."""
    Q = P.copy()
    for i in range(MOVED):
        row = np.zeros(N)
        for k in range(N):
            f = F[i, k]
            if f != 0.0:
                for j in range(N):
                    row[j] += f * P[k, j]
        Q[i] = row
    Ft = F.T.copy()  # so that innermost loops run along rows
    for i in range(MOVED):
        row, block = Q[i].copy(), np.zeros(MOVED)
        for k in range(N):
            for j in range(MOVED):
                block[j] += row[k] * Ft[k, j]
        for j in range(i + 1):
            Q[i, j] = Q[j, i] = block[j]
        for j in range(MOVED, N):
            Q[j, i] = row[j]
    return Q


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
    HP, S = np.zeros((m, N)), R.copy()
    for k in range(m):
        for j in range(N):
            if H[k, j] != 0.0:
                for i in range(N):
                    HP[k, i] += H[k, j] * P[j, i]
    for n in range(m):
        for j in range(N):
            if H[n, j] != 0.0:
                for k in range(m):
                    S[k, n] += HP[k, j] * H[n, j]
    distance = _whitened(S, HP, innovation)
    if distance > gate:
        return x, P, distance
    y, C = x.copy(), P.copy()
    for k in range(m):
        row = HP[k]
        for i in range(N):
            gain = row[i]
            y[i] += gain * innovation[k]
            for j in range(N):
                C[i, j] -= gain * row[j]
    for i in range(3, 6):
        y[i] = wrap(y[i])
    return y, C, distance


@njit(cache=True)
def _whitened(S: Array, HP: Array, innovation: Array) -> float:
    """Puts L^-1 before HP (m, 15) and the innovation y (m,), in place, with S = L L^T; returns the length of L^-1 y.

    Then K S K^T = (L^-1 H P)^T (L^-1 H P), and K y = (L^-1 H P)^T (L^-1 y). Only the lower half of S is read, and it
    becomes L.
    """
    squared = 0.0
    for k in range(S.shape[0]):
        for n in range(k):
            for j in range(n):
                S[k, n] -= S[k, j] * S[n, j]
            factor = S[k, n] = S[k, n] / S[n, n]
            S[k, k] -= factor * factor
            innovation[k] -= factor * innovation[n]
            for i in range(N):
                HP[k, i] -= factor * HP[n, i]
        root = S[k, k] = np.sqrt(S[k, k])
        innovation[k] /= root
        for i in range(N):
            HP[k, i] /= root
        squared += innovation[k] * innovation[k]
    return np.sqrt(squared)


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
