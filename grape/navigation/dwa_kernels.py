"""Compiled loop of `grape.navigation.dwa`."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array
from grape.navigation.rollout_kernels import gap, nearest


@njit(cache=True)
def arc_costs(
    arcs: Array,
    steps: int,
    period: float,
    weights: Array,
    goal: int,
    pose: Array,
    ahead: Array,
    field: Array,
    frame: Array,
    discs: Array,
) -> Array:
    """Costs (n,) of arcs (n, 2) m/s, rad/s that are kept for `steps` periods (s); inf where one comes into contact.

    Args:
        weights: path, goal, heading, obstacle, scaling, speed.
        goal: index of the local goal in `ahead` (k, 5): x, y, heading, distance, speed.
    """
    costs = np.empty(arcs.shape[0])
    here = gap(field, frame, pose[0], pose[1], np.cos(pose[2]), np.sin(pose[2]), discs)
    touching = min(0.0, here) - 0.01
    for n in range(arcs.shape[0]):
        v, w = arcs[n, 0], arcs[n, 1]
        x, y, yaw = pose[0], pose[1], pose[2]
        least, k, touched = here, 0, False
        for _ in range(steps):
            yaw += 0.5 * w * period
            x, y = x + v * period * np.cos(yaw), y + v * period * np.sin(yaw)
            yaw += 0.5 * w * period
            left = gap(field, frame, x, y, np.cos(yaw), np.sin(yaw), discs)
            if left < touching:
                touched = True
                break
            least = min(least, left)
            k = nearest(ahead, k, x, y)
        if touched:
            costs[n] = np.inf
            continue
        off = np.sqrt((x - ahead[k, 0]) ** 2 + (y - ahead[k, 1]) ** 2)
        away = np.sqrt((x - ahead[goal, 0]) ** 2 + (y - ahead[goal, 1]) ** 2)
        cost = weights[0] * off + weights[1] * away + weights[2] * (1.0 - np.cos(yaw - ahead[k, 2]))
        cost += weights[3] * np.exp(-weights[4] * max(least, 0.0)) + weights[5] * max(0.0, ahead[0, 4] - v)
        costs[n] = cost
    return costs
