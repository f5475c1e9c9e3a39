"""Compiled steps of the particle filter: motion, weights by the likelihood field, the estimate, resampling by KLD.

Source: Thrun, Burgard and Fox, Probabilistic Robotics, 2005, tables 5.6, 6.3 and 8.4; Fox, Adapting the sample size in
particle filters through KLD-sampling, IJRR 2003; Chen and Asau, On generating random variates from an empirical
distribution, AIIE Transactions 1974 (the guide to sums of weights); Steele, Lea and Flood, Fast splittable pseudorandom
number generators, OOPSLA 2014 (SplitMix64).
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from numba import njit

from grape.messages import Array

TURN = 2.0 * np.pi
QUARTER = 0.5 * np.pi
C = tuple(np.float32(1.0 / k) for k in (1, -2, 24, -720, 40320))  # Taylor's series of the cosine and the sine
S = tuple(np.float32(1.0 / k) for k in (1, -6, 120, -5040))
SPREAD = np.uint64(0x9E3779B97F4A7C15)  # Fibonacci hashing: 2^64 by the golden ratio; the upper bits are well mixed
MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))  # of SplitMix64, whose step is SPREAD
LEVELS = np.array([NormalDist().inv_cdf((k + 0.5) / 1024) for k in range(1024)])
QUANTILES = (LEVELS / (np.sqrt(2.0) * LEVELS.std())).astype(np.float32)  # two of them add up to a variance of 1
BLOCK = 256  # particles weighed together: their numbers stay in the nearest cache


@njit(cache=True)
def wrapped(angle: float) -> float:
    """The same angle within -pi and pi rad; quick where it is one turn off at most."""
    while angle > np.pi:
        angle -= TURN
    while angle < -np.pi:
        angle += TURN
    return angle


@njit(cache=True, fastmath=True)
def cos_sin(angles: Array) -> tuple[Array, Array]:
    """Cosines and sines (n,) float32 of angles (n,) of a few turns, within 1e-6.

    Taylor's series of what is left beside the nearest quarter turn: plain arithmetic becomes vector instructions.
    """
    cosines, sines = np.empty(angles.size, np.float32), np.empty(angles.size, np.float32)
    for i in range(angles.size):
        quarter = np.floor(angles[i] / QUARTER + 0.5)
        rest = np.float32(angles[i] - quarter * QUARTER)
        q = rest * rest
        c = C[0] + q * (C[1] + q * (C[2] + q * (C[3] + q * C[4])))
        s = rest * (S[0] + q * (S[1] + q * (S[2] + q * S[3])))
        which = np.int32(quarter)
        along, across = (s, c) if which & 1 else (c, s)
        cosines[i] = -along if (which + 1) & 2 else along
        sines[i] = -across if which & 2 else across
    return cosines, sines


@njit(cache=True)
def normals(seed: np.uint64, n: int) -> Array:
    """Numbers (3, n) float32 of the normal distribution, the same for the same seed.

    Each is the sum of two quantiles, which 20 bits of SplitMix64 choose: never beyond 4.7, else within 0.0005 of the
    normal distribution.
    """
    result, ten = np.empty((3, n), np.float32), np.uint64(10)
    for i in range(n):
        word = np.uint64(seed) + np.uint64(i + 1) * SPREAD
        word = (word ^ (word >> np.uint64(30))) * MIX[0]
        word = (word ^ (word >> np.uint64(27))) * MIX[1]
        word ^= word >> np.uint64(31)
        for k in range(3):
            result[k, i] = QUANTILES[word & np.uint64(1023)] + QUANTILES[(word >> ten) & np.uint64(1023)]
            word >>= np.uint64(20)
    return result


@njit(cache=True)
def move(poses: Array, motion: Array, std: Array, seed: np.uint64) -> Array:
    """Poses (n, 3) after a turn, a way and a turn, each particle with its own errors.

    Args:
        motion: (3,) rad, m, rad. std: (3,) of its errors. seed: what the errors are drawn by.
    """
    random, result = normals(seed, poses.shape[0]), np.empty_like(poses)
    courses = poses[:, 2] + motion[0] + std[0] * random[0]
    cosines, sines = cos_sin(courses)
    for i in range(poses.shape[0]):
        way = motion[1] + std[1] * random[1, i]
        result[i, 0] = poses[i, 0] + way * cosines[i]
        result[i, 1] = poses[i, 1] + way * sines[i]
        result[i, 2] = wrapped(courses[i] + motion[2] + std[2] * random[2, i])
    return result


@njit(cache=True, fastmath=True)
def log_weights(field: Array, x_min: float, y_min: float, resolution: float, poses: Array, points: Array) -> Array:
    """Mean log-likelihood (n,) of the points (m, 2) m, given in the robot's frame, for poses (n, 3) x y yaw.

    Goes beam by beam over blocks of particles, first all their cells, which becomes vector instructions, and then what
    stands in them, for four beams at once.

    Args:
        field: (rows + 2, columns + 2) float32; its border holds everywhere beyond the map.
        x_min, y_min: m, corner of the map, one cell inside the field.
    """
    n, m, scale = poses.shape[0], points.shape[0], 1.0 / resolution
    width, flat = np.uint32(field.shape[1]), field.ravel()
    zero, last_row, last_column = np.float32(0), np.float32(field.shape[0] - 1), np.float32(field.shape[1] - 1)
    x = ((poses[:, 0] - x_min) * scale + 1.0).astype(np.float32)
    y = ((poses[:, 1] - y_min) * scale + 1.0).astype(np.float32)
    px, py = (points[:, 0] * scale).astype(np.float32), (points[:, 1] * scale).astype(np.float32)
    c, s = cos_sin(poses[:, 2].copy())
    total, cells = np.zeros(n, np.float32), np.empty((4, BLOCK), np.uint32)
    for start in range(0, n, BLOCK):
        block = slice(start, min(start + BLOCK, n))
        bx, by, bc, bs, sums = x[block], y[block], c[block], s[block], total[block]
        for first in range(0, m, 4):
            beams = min(4, m - first)
            for k in range(beams):
                ahead, left, at = px[first + k], py[first + k], cells[k]
                for i in range(sums.size):
                    column = np.int32(min(max(bx[i] + bc[i] * ahead - bs[i] * left, zero), last_column))
                    row = np.int32(min(max(by[i] + bs[i] * ahead + bc[i] * left, zero), last_row))
                    at[i] = np.uint32(np.uint32(row) * width) + np.uint32(column)
            if beams == 4:
                for i in range(sums.size):
                    sums[i] += flat[cells[0, i]] + flat[cells[1, i]] + flat[cells[2, i]] + flat[cells[3, i]]
            else:
                for k in range(beams):
                    for i in range(sums.size):
                        sums[i] += flat[cells[k, i]]
    return total / max(m, 1)


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


@njit(cache=True, fastmath=True)
def bins_of(poses: Array, bin_size: Array) -> Array:
    """Numbers (n,) of the bins that poses (n, 3), their yaw within -pi and pi, lie in."""
    numbers = np.empty(poses.shape[0], np.int64)
    in_x, in_y, in_yaw = 1.0 / bin_size[0], 1.0 / bin_size[1], 1.0 / bin_size[2]
    for i in range(poses.shape[0]):
        x, y = np.int64(np.floor(poses[i, 0] * in_x)) + 1048576, np.int64(np.floor(poses[i, 1] * in_y)) + 1048576
        numbers[i] = (x * 2097152 + y) * 1024 + np.int64((poses[i, 2] + np.pi) * in_yaw)
    return numbers


@njit(cache=True)
def slot_of(table: Array, number: int) -> int:
    """Where a bin is in the table, or where it belongs if it is not there yet."""
    slot = np.int64((np.uint64(number) * SPREAD) >> np.uint64(40)) & (table.size - 1)
    while table[slot] != -1 and table[slot] != number:
        slot = (slot + 1) & (table.size - 1)
    return int(slot)


@njit(cache=True, fastmath=True)
def moments(columns: Array, weights: Array, mean: Array, reach: Array) -> Array:
    """Weight, means (3) and products (6) of x y yaw (3, n) relative to `mean`, of the particles within reach of it."""
    x, y, yaw = columns[0], columns[1], columns[2]
    far, turned = reach[0] * reach[0], reach[2]
    share = sx = sy = st = xx = xy = yy = xt = yt = tt = 0.0
    for i in range(weights.size):
        dx, dy, t = x[i] - mean[0], y[i] - mean[1], yaw[i] - mean[2]
        t -= TURN * np.floor(t / TURN + 0.5)
        w = weights[i] if dx * dx + dy * dy < far and abs(t) < turned else 0.0
        share, sx, sy, st = share + w, sx + w * dx, sy + w * dy, st + w * t
        xx, xy, yy = xx + w * dx * dx, xy + w * dx * dy, yy + w * dy * dy
        xt, yt, tt = xt + w * dx * t, yt + w * dy * t, tt + w * t * t
    return np.array([share, sx, sy, st, xx, xy, yy, xt, yt, tt])


@njit(cache=True)
def heaviest(poses: Array, weights: Array, reach: Array) -> tuple[Array, Array, float]:
    """Mean (3,), covariance (3, 3) and weight of the particles around the heaviest bin.

    Args:
        reach: (3,) m, m, rad: size of the bins; particles count whose way and turn from the mean are below it.
    """
    table, bins = empty_table(poses.shape[0]), bins_of(poses, reach)
    total = np.zeros(table.size)
    best, most = 0, -1.0
    for i in range(poses.shape[0]):
        slot = slot_of(table, bins[i])
        table[slot] = bins[i]
        total[slot] += weights[i]
        if total[slot] > most:
            best, most = i, total[slot]
    mean, columns = poses[best].copy(), poses.T.copy()
    for _ in range(2):
        sums = moments(columns, weights, mean, reach)
        mean += sums[1:4] / sums[0]
    sums = moments(columns, weights, mean, reach)
    share, shift = sums[0], sums[1:4] / sums[0]
    covariance, entry = np.empty((3, 3)), 4
    for a in range(3):
        for b in range(a + 1):
            covariance[a, b] = covariance[b, a] = sums[entry] / share - shift[a] * shift[b]
            entry += 1
    mean += shift
    mean[2] = wrapped(mean[2])
    return mean, covariance, share


@njit(cache=True)
def resample(
    poses: Array,
    weights: Array,
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
        poses: (n, 3). weights: (n,), of any sum above 0.
        uniforms: (most,) in [0, 1), which choose the particles.
        strangers: (most, 3) poses from anywhere. strange: (most,) whether to take one, or (0,) for never.
        bin_size: (3,) m, m, rad.
    """
    most, n, cumulative = uniforms.size, poses.shape[0], np.cumsum(weights)
    cumulative /= cumulative[-1]
    guide, found = np.zeros(n + 1, np.int64), 0  # the particle to search from, for each n-th of the sums
    for i in range(n - 1):
        guide[min(int(cumulative[i] * n) + 1, n)] = i + 1
    for j in range(n):
        found = max(found, guide[j])
        guide[j] = found
    bins, strange_bins = bins_of(poses, bin_size), bins_of(strangers, bin_size)
    table, count, bound = empty_table(most), 0, 1.0
    chosen = np.empty(most, np.int64)
    for k in range(most):
        if strange.size and strange[k]:
            chosen[k], number = -1 - k, strange_bins[k]
        else:
            at = guide[int(uniforms[k] * n)]
            while at < n - 1 and cumulative[at] <= uniforms[k]:
                at += 1
            chosen[k], number = at, bins[at]
        slot = slot_of(table, number)
        if table[slot] == -1:
            table[slot] = number
            count += 1
            bound = kld_bound(count, error, quantile)
        if k + 1 >= least and k + 1 >= bound:
            return chosen[: k + 1]
    return chosen
