"""What a mounted sensor should see of the 15 states, with its Jacobian; the state order is `state.STATE`."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array

N = 15
DIRECT = np.empty(0)  # `frames` of values that are state components as they stand


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
def base_attitude(rpy: Array, yaw_offset: float, R_world_frame: Array, R_base_sensor: Array) -> Array:
    """Roll, pitch and yaw (3,) of base_link in the world when those of a sensor in its frame of the world are `rpy`."""
    S = rotation(rpy[0], rpy[1], rpy[2] + yaw_offset)
    R = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for a in range(3):
                for b in range(3):
                    R[i, j] += R_world_frame[i, a] * S[a, b] * R_base_sensor[j, b]
    if abs(R[2, 0]) > 1.0 - 1e-12:
        return np.array([0.0, -np.sign(R[2, 0]) * np.pi / 2, np.arctan2(-R[0, 1], R[1, 1])])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])])


@njit(cache=True)
def wrap(angle: float) -> float:
    """The angle in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@njit(cache=True)
def observe(x: Array, index: Array, lever: Array, frames: Array) -> tuple[Array, Array]:
    """Expected values (m,) of the components `index` at the point `lever` (m, base frame), and their Jacobian.

    `frames` is `DIRECT`, or (22,): R_base_sensor and R_world_frame row by row, p_world_frame (m), gravity (m/s^2).
    Then positions are in that frame of the world; velocities, rates and specific forces along the sensor's axes.
    """
    m = index.shape[0]
    h, H = np.empty(m), np.zeros((m, N))
    R, J = np.zeros((3, 3)), np.zeros((3, 3))
    for k in range(m):
        if index[k] < 3 or index[k] >= 12:  # nothing else depends on the attitude as a whole
            R = rotation(x[3], x[4], x[5])
            J = rotated_by_rpy(R, x[3], lever)
            break
    if frames.shape[0]:
        for k in range(m):
            h[k] = _observe_mounted(x, index[k], lever, frames, R, J, H[k])
        return h, H
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
def _observe_mounted(x: Array, i: int, lever: Array, frames: Array, R: Array, J: Array, row: Array) -> float:
    """Expected value of component `i` as a mounted sensor gives it; its Jacobian goes into `row` (15,)."""
    axis = i % 3
    if 3 <= i < 6:  # Euler angles of base_link in the world: the mount has been taken off
        row[i] = 1.0
        return x[i]
    if i < 3:
        value = 0.0
        for j in range(3):
            c = frames[9 + 3 * j + axis]
            point = x[j] + R[j, 0] * lever[0] + R[j, 1] * lever[1] + R[j, 2] * lever[2]
            value += c * (point - frames[18 + j])
            row[j] = c
            for n in range(3):
                row[3 + n] += c * J[j, n]
        return value
    r = np.array([frames[axis], frames[3 + axis], frames[6 + axis]])  # the sensor's axis in base_link
    w, v = x[9:12], x[6:9]
    value, at = 0.0, 6 + 3 * ((i - 6) // 3)
    for j in range(3):
        row[at + j] = r[j]
        value += r[j] * x[at + j]
    if i < 9:
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            row[9 + j] = lever[a] * r[b] - lever[b] * r[a]
            value += row[9 + j] * w[j]
    elif i >= 12:  # specific force: a + w x v + w x (w x lever) + R^T g
        rw = r[0] * w[0] + r[1] * w[1] + r[2] * w[2]
        lw = lever[0] * w[0] + lever[1] * w[1] + lever[2] * w[2]
        rl = r[0] * lever[0] + r[1] * lever[1] + r[2] * lever[2]
        ww = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
        value += rw * lw - rl * ww
        D = rotated_by_rpy(R, x[3], r)
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            row[6 + j] = r[a] * w[b] - r[b] * w[a]
            value += row[6 + j] * v[j]
            row[9 + j] = v[a] * r[b] - v[b] * r[a] + r[j] * lw + lever[j] * rw - 2.0 * rl * w[j]
            row[3 + j] = frames[21] * D[2, j]
            value += frames[21] * R[2, j] * r[j]
    return value
