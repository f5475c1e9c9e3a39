"""Compiled steps of the particle filter: motion, weights by the likelihood field, the estimate, resampling by KLD.

Source: Thrun, Burgard and Fox, Probabilistic Robotics, 2005, tables 5.6, 6.3 and 8.4; Fox, Adapting the sample size in
particle filters through KLD-sampling, IJRR 2003; Chen and Asau, On generating random variates from an empirical
distribution, AIIE Transactions 1974 (the guide to sums of weights).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array

TURN = 2.0 * np.pi


@njit(cache=True)
def wrapped(angle: float) -> float:
    """The same angle within -pi and pi rad; quick where it is one turn off at most."""
    while angle > np.pi:
        angle -= TURN
    while angle < -np.pi:
        angle += TURN
    return angle


@njit(cache=True)
def move(poses: Array, motion: Array, std: Array, random: Array) -> Array:
    """Poses (n, 3) after a turn, a way and a turn, each particle with its own errors.

    Args:
        motion: (3,) rad, m, rad. std: (3,) of its errors. random: (3, n) of the normal distribution.
    """
    result = np.empty_like(poses)
    for i in range(poses.shape[0]):
        yaw = poses[i, 2] + motion[0] + std[0] * random[0, i]
        way = motion[1] + std[1] * random[1, i]
        result[i, 0] = poses[i, 0] + way * np.cos(yaw)
        result[i, 1] = poses[i, 1] + way * np.sin(yaw)
        result[i, 2] = wrapped(yaw + motion[2] + std[2] * random[2, i])
    return result


@njit(cache=True, fastmath=True)
def log_weights(field: Array, x_min: float, y_min: float, resolution: float, poses: Array, points: Array) -> Array:
    """Mean log-likelihood (n,) of the points (m, 2) m, given in the robot's frame, for poses (n, 3) x y yaw.

    Args:
        field: (rows + 2, columns + 2) float32; its border holds everywhere beyond the map.
        x_min, y_min: m, corner of the map, one cell inside the field.
    """
    count, width, flat = points.shape[0], np.uint64(field.shape[1]), field.ravel()
    zero, last_row, last_column = np.float32(0), np.float32(field.shape[0] - 1), np.float32(field.shape[1] - 1)
    px, py = points[:, 0].astype(np.float32), points[:, 1].astype(np.float32)
    rows, columns = np.empty(count, np.int32), np.empty(count, np.int32)
    result = np.empty(poses.shape[0])
    scale = 1.0 / resolution
    for i in range(poses.shape[0]):
        c, s = np.float32(np.cos(poses[i, 2]) * scale), np.float32(np.sin(poses[i, 2]) * scale)
        x, y = np.float32((poses[i, 0] - x_min) * scale + 1.0), np.float32((poses[i, 1] - y_min) * scale + 1.0)
        for k in range(count):
            columns[k] = np.int32(min(max(x + c * px[k] - s * py[k], zero), last_column))
            rows[k] = np.int32(min(max(y + s * px[k] + c * py[k], zero), last_row))
        total = np.float32(0)
        for k in range(count):
            total += flat[np.uint64(rows[k]) * width + np.uint64(columns[k])]
        result[i] = total / max(count, 1)
    return result


@njit(cache=True)
def kld_bound(bins: int, error: float, quantile: float) -> float:
    """Particles that keep the Kullback-Leibler distance below `error`, for so many bins with a particle."""
    if bins < 2:
        return 1.0
    part = 2.0 / (9.0 * (bins - 1))
    return (bins - 1) / (2.0 * error) * (1.0 - part + np.sqrt(part) * quantile) ** 3


@njit(cache=True)
def empty_table(entries: int) -> Array:
    """A hash table of bins with room for so many: keys, -1 where nothing is."""
    size = 1
    while size < 4 * entries:
        size *= 2
    return np.full(size, np.int64(-1))


@njit(cache=True)
def slot_of(table: Array, x: float, y: float, yaw: float, bin_size: Array) -> tuple[int, bool]:
    """Where the bin of a pose, its yaw within -pi and pi, is in the table, and whether it was put there only now."""
    key = (np.int64(np.floor(x / bin_size[0])) + 1048576) * 2097152 + np.int64(np.floor(y / bin_size[1])) + 1048576
    key = key * 1024 + np.int64((yaw + np.pi) / bin_size[2])
    slot = (key * 2654435761 >> 7) & (table.size - 1)
    while table[slot] != -1 and table[slot] != key:
        slot = (slot + 1) & (table.size - 1)
    new = bool(table[slot] == -1)
    table[slot] = key
    return int(slot), new


@njit(cache=True)
def heaviest(poses: Array, weights: Array, reach: Array) -> tuple[Array, Array, float]:
    """Mean (3,), covariance (3, 3) and weight of the particles around the heaviest bin.

    Args:
        reach: (3,) m, m, rad: size of the bins; particles count whose way and turn from the mean are below it.
    """
    table = empty_table(poses.shape[0])
    total = np.zeros(table.size)
    best, most = 0, -1.0
    for i in range(poses.shape[0]):
        slot, _ = slot_of(table, poses[i, 0], poses[i, 1], poses[i, 2], reach)
        total[slot] += weights[i]
        if total[slot] > most:
            best, most = i, total[slot]
    mean = poses[best].copy()
    square, share = np.zeros((3, 3)), 0.0
    for last in (False, False, True):
        x, y, yaw, share = 0.0, 0.0, 0.0, 0.0
        for i in range(poses.shape[0]):
            dx, dy, turn = poses[i, 0] - mean[0], poses[i, 1] - mean[1], wrapped(poses[i, 2] - mean[2])
            if dx * dx + dy * dy >= reach[0] * reach[0] or abs(turn) >= reach[2]:
                continue
            w = weights[i]
            share, x, y, yaw = share + w, x + w * dx, y + w * dy, yaw + w * turn
            if last:
                off = (dx, dy, turn)
                for a in range(3):
                    for b in range(a + 1):
                        square[a, b] += w * off[a] * off[b]
        shift = np.array([x, y, yaw]) / share
        mean += shift
    covariance = np.empty((3, 3))
    for a in range(3):
        for b in range(a + 1):
            covariance[a, b] = covariance[b, a] = square[a, b] / share - shift[a] * shift[b]
    mean[2] = wrapped(mean[2])
    return mean, covariance, share


@njit(cache=True)
def resample(
    poses: Array,
    cumulative: Array,
    uniforms: Array,
    strangers: Array,
    strange: Array,
    bin_size: Array,
    least: int,
    error: float,
    quantile: float,
) -> Array:
    """Indices (k,) of drawn particles, or -1 - j for the stranger j; stops at the KLD bound.

    Args:
        poses: (n, 3). cumulative: (n,) sums of weights, the last one 1.
        uniforms: (most,) in [0, 1), which choose the particles.
        strangers: (most, 3) poses from anywhere. strange: (most,) whether to take one, or (0,) for never.
        bin_size: (3,) m, m, rad.
    """
    most, n = uniforms.size, poses.shape[0]
    guide, at = np.empty(n, np.int64), 0
    for j in range(n):
        while at < n - 1 and cumulative[at] <= j / n:
            at += 1
        guide[j] = at
    table, bins, bound = empty_table(most), 0, 1.0
    chosen = np.empty(most, np.int64)
    for k in range(most):
        if strange.size and strange[k]:
            chosen[k] = -1 - k
            x, y, yaw = strangers[k, 0], strangers[k, 1], strangers[k, 2]
        else:
            at = guide[int(uniforms[k] * n)]
            while at < n - 1 and cumulative[at] <= uniforms[k]:
                at += 1
            chosen[k] = at
            x, y, yaw = poses[at, 0], poses[at, 1], poses[at, 2]
        if slot_of(table, x, y, yaw, bin_size)[1]:
            bins += 1
            bound = kld_bound(bins, error, quantile)
        if k + 1 >= least and k + 1 >= bound:
            return chosen[: k + 1]
    return chosen
