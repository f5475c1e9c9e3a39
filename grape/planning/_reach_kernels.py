"""The compiled search for arm postures that follow a line of hand poses; imported only where it is used."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.kinematics._inverse_kernels import forward, solve
from grape.planning._collision_kernels import state_valid

POSITION_TOLERANCE, ROTATION_TOLERANCE, STEP_MAX, DAMPING = 1e-4, 1e-3, 0.4, 1e-4
JUMP_MAX = 0.6  # rad between poses of a line: farther is another branch


@njit(cache=True)
def best_margins(arm, lines, seeds, body, rotation_weight, sigma_full, limit_full, iterations):
    """(m,) the margin 0..1 with which each line (m, k, 4, 4) can be followed, and its posture (m, n) at the start."""
    placements, axes, low, high = arm
    count, n = len(lines), len(axes)
    margins, postures = np.zeros(count), np.zeros((count, n))
    for i in range(count):
        for s in range(len(seeds)):
            q = seeds[s].copy()
            for j in range(n):
                q[j] = min(max(q[j], low[j]), high[j])
            converged, q, _, _ = _solve(placements, axes, low, high, lines[i, 0], q, iterations)
            if not converged:
                continue
            start = q.copy()
            margin = _along(placements, axes, low, high, lines[i], q, body, rotation_weight,
                            sigma_full, limit_full, margins[i])  # fmt: skip
            if margin > margins[i]:
                margins[i] = margin
                postures[i] = start
            if margin >= 1.0:
                break
    return margins, postures


@njit(cache=True)
def _along(placements, axes, low, high, line, q, body, rotation_weight, sigma_full, limit_full, least):
    """The least margin along a line from the posture `q` at its start; 0 when it breaks or falls to `least`."""
    shapes, field = body
    margin = 1.0
    n = len(q)
    T, J = np.empty((4, 4)), np.empty((6, n))
    for k in range(len(line)):
        before = q.copy()
        converged, q, _, _ = _solve(placements, axes, low, high, line[k], q, 20)
        if not converged:
            return 0.0
        for j in range(n):
            if abs(q[j] - before[j]) > JUMP_MAX:
                return 0.0
            margin = min(margin, (q[j] - low[j]) / limit_full, (high[j] - q[j]) / limit_full)
        forward(placements, axes, q, T, J)
        for j in range(n):
            for r in range(3):
                J[3 + r, j] *= rotation_weight
        margin = min(margin, np.linalg.svd(J, full_matrices=False)[1][5] / sigma_full)
        if margin <= least or state_valid(q, shapes, field) < 1:
            return 0.0
    return margin


@njit(cache=True)
def _solve(placements, axes, low, high, T, q, iterations):
    return solve(
        placements, axes, low, high, T, q, iterations, POSITION_TOLERANCE, ROTATION_TOLERANCE, STEP_MAX, DAMPING
    )
