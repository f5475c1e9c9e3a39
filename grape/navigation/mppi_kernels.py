"""Compiled loops of `grape.navigation.mppi`."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array
from grape.navigation.rollout_kernels import gap, nearest


@njit(cache=True, fastmath=True)
def rollouts(
    noise: Array,
    first: int,
    samples: int,
    plan: Array,
    pose: Array,
    velocity: Array,
    limits: Array,
    weights: Array,
    ahead: Array,
    field: Array,
    frame: Array,
    discs: Array,
) -> tuple[Array, Array]:
    """Costs (samples,) and controls (samples, steps, 2) float32 of noisy sequences; the first one is without noise.

    Args:
        noise: (rows, steps, 2), rows from `first` on are used, round the end.
        plan: (steps, 2) m/s, rad/s, the mean to sample around.
        limits: least v, most v, most w, and change per step of v when speeding up, when braking, and of w.
        weights: lateral, heading, speed, progress, steering, near, margin, contact, period (s), loose (m).
    """
    steps = plan.shape[0]
    lateral, heading, speed, progress = weights[0], weights[1], weights[2], weights[3]
    steering, near, margin, contact, period = weights[4], weights[5], weights[6], weights[7], weights[8]
    loose = weights[9]
    costs = np.empty(samples, dtype=np.float64)
    controls = np.empty((samples, steps, 2), dtype=np.float32)
    c0, s0 = np.cos(pose[2]), np.sin(pose[2])
    here = gap(field, frame, pose[0], pose[1], c0, s0, discs)
    touching = min(0.0, here) - 0.01
    length = ahead[ahead.shape[0] - 1, 3]
    headings = np.empty((ahead.shape[0], 2))
    for k in range(ahead.shape[0]):
        headings[k, 0], headings[k, 1] = np.cos(ahead[k, 2]), np.sin(ahead[k, 2])
    for n in range(samples):
        row = (first + n) % noise.shape[0]
        scale = 0.0 if n == 0 else 1.0
        x, y, c, s = pose[0], pose[1], c0, s0
        v, w = velocity[0], velocity[1]
        k, cost = 0, 0.0
        for t in range(steps):
            wish_v = min(limits[1], max(limits[0], plan[t, 0] + scale * noise[row, t, 0]))
            wish_w = min(limits[2], max(-limits[2], plan[t, 1] + scale * noise[row, t, 1]))
            # without branches, which noise would make unforeseeable
            braking = (abs(wish_v) < abs(v)) | (wish_v * v < 0.0)
            change = limits[3] + braking * (limits[4] - limits[3])
            v = min(v + change, max(v - change, wish_v))
            before = w
            w = min(w + limits[5], max(w - limits[5], wish_w))
            controls[n, t, 0], controls[n, t, 1] = v, w
            # half the turn before and half after the move; sine and cosine to third order, w period is small
            h = 0.5 * w * period
            ch, sh = 1.0 - 0.5 * h * h, h * (1.0 - h * h / 6.0)
            c, s = c * ch - s * sh, s * ch + c * sh
            x, y = x + v * period * c, y + v * period * s
            c, s = c * ch - s * sh, s * ch + c * sh
            cost += steering * (w - before) ** 2 / (period * period)
            if t % 2 == 0:  # every other pose is judged: they are a few centimetres apart
                continue
            left = gap(field, frame, x, y, c, s, discs)
            if left < touching:
                cost += contact * (1.0 + (steps - t) / steps) * steps
                for rest in range(t + 1, steps):
                    controls[n, rest, 0], controls[n, rest, 1] = v, w
                break
            k = nearest(ahead, k, x, y)
            off = -headings[k, 1] * (x - ahead[k, 0]) + headings[k, 0] * (y - ahead[k, 1])
            aside = abs(off)
            judged = lateral * (aside * aside if aside < loose else loose * (2.0 * aside - loose))
            judged += heading * (1.0 - c * headings[k, 0] - s * headings[k, 1]) + speed * (ahead[k, 4] - v) ** 2
            if left < margin:
                short = 1.0 - max(left, 0.0) / margin
                judged += near * short * short
            cost += 2.0 * judged
        along = headings[k, 0] * (x - ahead[k, 0]) + headings[k, 1] * (y - ahead[k, 1])
        costs[n] = cost / steps + progress * (length - ahead[k, 3] - along)
    return costs, controls


@njit(cache=True, fastmath=True)
def average(costs: Array, controls: Array, temperature: float) -> tuple[Array, float]:
    """The mean (steps, 2) of controls, weighted by exp(-cost / temperature), and the least cost."""
    least = costs.min()
    mean = np.zeros((controls.shape[1], 2))
    total = 0.0
    for n in range(costs.shape[0]):
        weight = np.exp(-(costs[n] - least) / temperature)
        if weight < 1e-4:
            continue
        total += weight
        for t in range(controls.shape[1]):
            mean[t, 0] += weight * controls[n, t, 0]
            mean[t, 1] += weight * controls[n, t, 1]
    return mean / total, least
