"""Compiled least squares of `grape.navigation.teb`."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array
from grape.navigation.rollout_kernels import nearest, smooth_gap

_RESIDUALS = 11
_BLOCK = 12  # three poses of x, y, yaw and the time to the next one


@njit(cache=True)
def _residuals(
    block: Array,
    three: bool,
    first: bool,
    start: Array,
    limits: Array,
    weights: Array,
    speed: float,
    near: Array,
    field: Array,
    frame: Array,
    discs: Array,
    out: Array,
) -> None:
    """Residuals (11,) of a pose, the next one and, where there are `three`, the one after that.

    Args:
        block: (12,) x, y, yaw, time to the next (s) of each pose.
        start: (2,) m/s, rad/s at the first pose of the band.
        limits: most backwards speed, most yaw rate, acceleration, yaw acceleration.
        weights: nonholonomic, velocity, acceleration, time, obstacle, margin (m), path, heading, backwards.
        speed: m/s, the most on this piece.
        near: (3,) x, y, heading of the path beside the second pose.
    """
    dx, dy = block[4] - block[0], block[5] - block[1]
    c0, s0, c1, s1 = np.cos(block[2]), np.sin(block[2]), np.cos(block[6]), np.sin(block[6])
    dt = max(block[3], 1e-3)
    v = 0.5 * ((c0 + c1) * dx + (s0 + s1) * dy) / dt
    w = (block[6] - block[2]) / dt
    out[0] = weights[0] * ((c0 + c1) * dy - (s0 + s1) * dx)
    out[1] = weights[1] * (max(0.0, v - speed) + max(0.0, -limits[0] - v))
    out[2] = weights[1] * max(0.0, abs(w) - limits[1])
    out[3] = weights[3] * block[3] + 10.0 * weights[1] * max(0.0, 0.05 - block[3])
    left = smooth_gap(field, frame, block[4], block[5], c1, s1, discs)
    out[4] = weights[4] * max(0.0, weights[5] - left)
    out[5] = weights[6] * (-np.sin(near[2]) * (block[4] - near[0]) + np.cos(near[2]) * (block[5] - near[1]))
    out[6] = weights[7] * np.sin(block[6] - near[2])
    out[7] = weights[8] * max(0.0, -v)
    out[8] = out[9] = out[10] = 0.0
    if first:
        out[8] = weights[2] * max(0.0, abs(v - start[0]) / dt - limits[2])
        out[9] = weights[2] * max(0.0, abs(w - start[1]) / dt - limits[3])
    if three:
        dx2, dy2 = block[8] - block[4], block[9] - block[5]
        dt2 = max(block[7], 1e-3)
        v2 = 0.5 * ((c1 + np.cos(block[10])) * dx2 + (s1 + np.sin(block[10])) * dy2) / dt2
        w2 = (block[10] - block[6]) / dt2
        out[8] += weights[2] * max(0.0, 2.0 * abs(v2 - v) / (dt + dt2) - limits[2])
        out[10] = weights[2] * max(0.0, 2.0 * abs(w2 - w) / (dt + dt2) - limits[3])


@njit(cache=True)
def _linearised(
    band: Array,
    start: Array,
    limits: Array,
    weights: Array,
    ahead: Array,
    field: Array,
    frame: Array,
    discs: Array,
    H: Array,
    g: Array,
    derive: bool,
) -> float:
    """Cost of a band (n, 4); with `derive` its Gauss-Newton matrix, lower band H (4 n, 12), and gradient g (4 n,)."""
    n = band.shape[0]
    flat = band.reshape(-1)
    here, there = np.empty(_RESIDUALS), np.empty(_RESIDUALS)
    J = np.empty((_RESIDUALS, _BLOCK))
    block = np.zeros(_BLOCK)
    cost, k = 0.0, 0
    if derive:
        H[:] = 0.0
        g[:] = 0.0
    for i in range(n - 1):
        three = i + 2 < n
        size = _BLOCK if three else 8
        for a in range(size):
            block[a] = flat[4 * i + a]
        k = nearest(ahead, k, block[4], block[5])
        near = ahead[k, :3]
        _residuals(block, three, i == 0, start, limits, weights, ahead[k, 4], near, field, frame, discs, here)
        for r in range(_RESIDUALS):
            cost += here[r] * here[r]
        if not derive:
            continue
        for a in range(size):
            kept = block[a]
            block[a] = kept + 1e-4
            _residuals(block, three, i == 0, start, limits, weights, ahead[k, 4], near, field, frame, discs, there)
            block[a] = kept
            for r in range(_RESIDUALS):
                J[r, a] = (there[r] - here[r]) * 1e4
        for a in range(size):
            for r in range(_RESIDUALS):
                g[4 * i + a] += J[r, a] * here[r]
            for b in range(a + 1):
                total = 0.0
                for r in range(_RESIDUALS):
                    total += J[r, a] * J[r, b]
                H[4 * i + a, a - b] += total
    return cost


@njit(cache=True)
def _solved(H: Array, g: Array, damping: float, fixed: Array) -> Array:
    """The step -(H + damping diag)⁻¹ g by banded Cholesky; `fixed` variables do not move. H[i, d] is of (i, i - d)."""
    n, width = H.shape
    L = np.zeros((n, width))
    x = np.zeros(n)
    for i in range(n):
        for j in range(max(0, i - width + 1), i + 1):
            total = H[i, i - j]
            if fixed[i] or fixed[j]:
                total = 1.0 if i == j else 0.0
            elif i == j:
                total += damping * (1e-3 + H[i, 0])
            for m in range(max(0, i - width + 1, j - width + 1), j):
                total -= L[i, i - m] * L[j, j - m]
            if i == j:
                L[i, 0] = np.sqrt(max(total, 1e-9))
            else:
                L[i, i - j] = total / L[j, 0]
    for i in range(n):
        total = 0.0 if fixed[i] else -g[i]
        for m in range(max(0, i - width + 1), i):
            total -= L[i, i - m] * x[m]
        x[i] = total / L[i, 0]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for m in range(i + 1, min(n, i + width)):
            total -= L[m, m - i] * x[m]
        x[i] = total / L[i, 0]
    return x


@njit(cache=True)
def optimise(
    band: Array,
    iterations: int,
    start: Array,
    limits: Array,
    weights: Array,
    ahead: Array,
    field: Array,
    frame: Array,
    discs: Array,
) -> tuple[Array, float]:
    """Levenberg-Marquardt on a band (n, 4) whose ends stay; the better band and its cost. Arguments as `_residuals`."""
    size = 4 * band.shape[0]
    H, g = np.empty((size, _BLOCK)), np.empty(size)
    fixed = np.zeros(size, dtype=np.bool_)
    for a in range(3):
        fixed[a] = fixed[size - 4 + a] = True
    fixed[size - 1] = True
    damping = 1e-2
    best = band.copy()
    cost = _linearised(best, start, limits, weights, ahead, field, frame, discs, H, g, True)
    for _ in range(iterations):
        step = _solved(H, g, damping, fixed)
        tried = best + step.reshape(-1, 4)
        for i in range(tried.shape[0]):
            tried[i, 3] = max(tried[i, 3], 0.02)
        new = _linearised(tried, start, limits, weights, ahead, field, frame, discs, H, g, False)
        if new < cost:
            settled = cost - new < 1e-4 * cost
            best, damping = tried, max(damping / 4.0, 1e-6)
            if settled:
                cost = new
                break
            cost = _linearised(best, start, limits, weights, ahead, field, frame, discs, H, g, True)
        else:
            damping *= 5.0
            if damping > 1e6:
                break
    return best, cost


@njit(cache=True)
def least_gap(band: Array, until: float, field: Array, frame: Array, discs: Array) -> float:
    """Metres left between the footprint and lethal cells on the band within `until` s, looked at every few cm."""
    least, passed = 1e3, 0.0
    for i in range(band.shape[0] - 1):
        pieces = 4
        for n in range(pieces):
            a = n / pieces
            x = (1.0 - a) * band[i, 0] + a * band[i + 1, 0]
            y = (1.0 - a) * band[i, 1] + a * band[i + 1, 1]
            yaw = (1.0 - a) * band[i, 2] + a * band[i + 1, 2]
            least = min(least, smooth_gap(field, frame, x, y, np.cos(yaw), np.sin(yaw), discs))
        passed += band[i, 3]
        if passed > until:
            break
    return least
