"""Compiled steps of the particle filter: weights by the likelihood field, and resampling by KLD.

Source: Thrun, Burgard and Fox, Probabilistic Robotics, 2005, tables 6.3 and 8.4; Fox, Adapting the sample size in
particle filters through KLD-sampling, IJRR 2003.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array


@njit(cache=True, fastmath=True)
def log_weights(
    field: Array, x_min: float, y_min: float, resolution: float, outside: float, poses: Array, points: Array
) -> Array:
    """Mean log-likelihood (n,) of the points (m, 2) m, given in the robot's frame, for poses (n, 3) x y yaw.

    Args:
        field: (rows, columns) float32; `outside` holds beyond it.
    """
    rows, columns = field.shape
    count = points.shape[0]
    result = np.empty(poses.shape[0])
    scale = 1.0 / resolution
    for i in range(poses.shape[0]):
        c, s = np.cos(poses[i, 2]) * scale, np.sin(poses[i, 2]) * scale
        x, y = (poses[i, 0] - x_min) * scale, (poses[i, 1] - y_min) * scale
        total = 0.0
        for k in range(count):
            # one is added before the cut to whole numbers, which rounds towards 0, not down
            column = int(x + c * points[k, 0] - s * points[k, 1] + 1.0) - 1
            row = int(y + s * points[k, 0] + c * points[k, 1] + 1.0) - 1
            if 0 <= row < rows and 0 <= column < columns:
                total += field[row, column]
            else:
                total += outside
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
def resample(
    poses: Array,
    cumulative: Array,
    uniforms: Array,
    strangers: Array,
    stranger_share: float,
    bin_size: Array,
    least: int,
    error: float,
    quantile: float,
) -> Array:
    """Indices (k,) of drawn particles, or -1 - j for the stranger j; stops at the KLD bound.

    Args:
        poses: (n, 3). cumulative: (n,) sums of weights, the last one 1.
        uniforms: (most, 2) in [0, 1): the first chooses the particle, the second whether it is a stranger.
        strangers: (most, 3) poses from anywhere; used with probability `stranger_share`.
        bin_size: (3,) m, m, rad.
    """
    most = uniforms.shape[0]
    size = 1
    while size < 4 * most:
        size *= 2
    table = np.full(size, np.int64(-1))
    chosen = np.empty(most, np.int64)
    bins = 0
    for k in range(most):
        if uniforms[k, 1] < stranger_share:
            chosen[k] = -1 - k
            x, y, yaw = strangers[k, 0], strangers[k, 1], strangers[k, 2]
        else:
            chosen[k] = min(np.searchsorted(cumulative, uniforms[k, 0], side="right"), poses.shape[0] - 1)
            x, y, yaw = poses[chosen[k], 0], poses[chosen[k], 1], poses[chosen[k], 2]
        key = (np.int64(np.floor(x / bin_size[0])) + 1048576) * 2097152 + np.int64(np.floor(y / bin_size[1])) + 1048576
        key = key * 1024 + np.int64(np.floor((yaw % (2.0 * np.pi)) / bin_size[2]))
        slot = (key * 2654435761 >> 7) & (size - 1)
        while table[slot] != -1 and table[slot] != key:
            slot = (slot + 1) & (size - 1)
        if table[slot] == -1:
            table[slot] = key
            bins += 1
        if k + 1 >= least and k + 1 >= kld_bound(bins, error, quantile):
            return chosen[: k + 1]
    return chosen
