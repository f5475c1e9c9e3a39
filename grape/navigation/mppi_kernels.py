"""Compiled loops of `grape.navigation.mppi`: sequences driven side by side, so that a processor does some at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from grape.messages import Array
from grape.navigation.rollout_kernels import gap

LANES = 256  # sequences driven side by side: their bases stay in the innermost cache
_FAR = 1e3


class Prices(NamedTuple):
    """See `MppiOptions`, whose names these are."""

    lateral: float
    heading: float
    speed: float
    progress: float
    steering: float
    near: float
    margin: float
    contact: float
    period: float
    loose: float


class Bases(NamedTuple):
    """(lanes,) each: poses, headings as cosine and sine, velocities, costs so far, and where they are on the path."""

    x: Array
    y: Array
    c: Array
    s: Array
    v: Array
    w: Array
    cost: Array
    free: Array  # 1.0, and 0.0 after contact: who touches something stays there
    share: Array  # of the noise that is taken
    left: Array  # m to the nearest lethal cell
    nearest: Array  # index of the nearest pose ahead
    beside: Array  # (5, lanes) x, y, wanted speed, cosine and sine of it


@njit(cache=True, fastmath=True)
def rollouts(
    noise: Array,
    first: int,
    samples: int,
    plan: Array,
    pose: Array,
    velocity: Array,
    limits: Array,
    prices: Prices,
    ahead: Array,
    field: Array,
    frame: Array,
    discs: Array,
) -> tuple[Array, Array]:
    """Costs (samples,) and controls (2, steps, samples) float32 of noisy sequences; the first one is without noise.

    Args:
        noise: (2, steps, rows) on v and w, rows from `first` on are used, round the end.
        plan: (steps, 2) m/s, rad/s, the mean to sample around.
        limits: least v, most v, most w, and change per step of v when speeding up, when braking, and of w.
    """
    steps, rows = plan.shape[0], noise.shape[2]
    costs, controls = np.empty(samples), np.empty((2, steps, samples), np.float32)
    here = gap(field, frame, pose[0], pose[1], np.cos(pose[2]), np.sin(pose[2]), discs)
    touching = min(0.0, here) - 0.01
    headings = np.column_stack((np.cos(ahead[:, 2]), np.sin(ahead[:, 2])))
    most = 2 + int(2.0 * limits[1] * prices.period / (ahead[1, 3] - ahead[0, 3]))  # poses passed between two looks
    since = 0
    while since < samples:
        row = (first + since) % rows
        count = min(LANES, samples - since, rows - row)
        bases = _standing(count, pose, velocity)
        if since == 0:
            bases.share[0] = 0.0
        for t in range(steps):
            noise_v, noise_w = noise[0, t, row : row + count], noise[1, t, row : row + count]
            sent_v, sent_w = controls[0, t, since : since + count], controls[1, t, since : since + count]
            _drive(bases, noise_v, noise_w, plan[t], limits, prices, sent_v, sent_w)
            if t % 2 == 1:  # every other pose is judged: they are a few centimetres apart
                _look_around(bases, field, frame, discs)
                _advance(bases, ahead, headings, most)
                _judge(bases, prices, touching, 2.0 * steps - t)
        _finish(bases, ahead, prices.progress, steps, costs[since : since + count])
        since += count
    return costs, controls


@njit(cache=True)
def _standing(count: int, pose: Array, velocity: Array) -> Bases:
    """So many bases at one pose."""
    x, y, v, w = pose[0], pose[1], velocity[0], velocity[1]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return Bases(
        np.full(count, x), np.full(count, y), np.full(count, c), np.full(count, s), np.full(count, v),
        np.full(count, w), np.zeros(count), np.ones(count), np.ones(count), np.empty(count),
        np.zeros(count, np.int64), np.empty((5, count)),
    )  # fmt: skip


@njit(cache=True, fastmath=True)
def _drive(
    bases: Bases,
    noise_v: Array,
    noise_w: Array,
    plan: Array,
    limits: Array,
    prices: Prices,
    sent_v: Array,
    sent_w: Array,
) -> None:
    """All drive for one period, and pay for changes of their yaw rate; without branches, which noise would mislead."""
    x, y, c, s, v, w, cost = bases.x, bases.y, bases.c, bases.s, bases.v, bases.w, bases.cost
    free, share, period = bases.free, bases.share, prices.period
    plan_v, plan_w, least_v, most_v, most_w = plan[0], plan[1], limits[0], limits[1], limits[2]
    speeding, braking, steering, price = limits[3], limits[4], limits[5], prices.steering / (period * period)
    for n in range(x.size):
        wish_v = min(most_v, max(least_v, plan_v + share[n] * noise_v[n]))
        wish_w = min(most_w, max(-most_w, plan_w + share[n] * noise_w[n]))
        slower = (abs(wish_v) < abs(v[n])) | (wish_v * v[n] < 0.0)
        most = braking if slower else speeding
        v[n] += free[n] * min(most, max(-most, wish_v - v[n]))
        change = free[n] * min(steering, max(-steering, wish_w - w[n]))
        w[n] += change
        cost[n] += price * change * change
        sent_v[n], sent_w[n] = v[n], w[n]
        # half the turn before and half after the move; sine and cosine to third order, w period is small
        h, way = 0.5 * w[n] * period, free[n] * v[n] * period
        ch, sh = 1.0 - 0.5 * h * h, h * (1.0 - h * h / 6.0)
        half_c, half_s = c[n] * ch - s[n] * sh, s[n] * ch + c[n] * sh
        x[n], y[n] = x[n] + way * half_c, y[n] + way * half_s
        c[n], s[n] = half_c * ch - half_s * sh, half_s * ch + half_c * sh


@njit(cache=True, fastmath=True)
def _look_around(bases: Bases, field: Array, frame: Array, discs: Array) -> None:
    """Metres from each footprint to the nearest lethal cell; see `rollout_kernels.gap`."""
    x, y, c, s, left, flat = bases.x, bases.y, bases.c, bases.s, bases.left, field.ravel()
    x_min, y_min, per_metre, cell = frame[0], frame[1], 1.0 / frame[2], np.empty(x.size, np.int32)
    width, columns, rows = np.int32(field.shape[1]), float(field.shape[1]), float(field.shape[0])
    left[:] = _FAR
    for d in range(discs.size - 1):
        offset = discs[d]
        for n in range(x.size):
            column, row = (x[n] + offset * c[n] - x_min) * per_metre, (y[n] + offset * s[n] - y_min) * per_metre
            inside = (column >= 0.0) & (column < columns) & (row >= 0.0) & (row < rows)
            cell[n] = np.int32(row) * width + np.int32(column) if inside else np.int32(-1)
        for n in range(x.size):
            if cell[n] >= 0:
                left[n] = min(left[n], flat[np.uint64(cell[n])])
    left -= discs[discs.size - 1]


@njit(cache=True, fastmath=True)
def _advance(bases: Bases, ahead: Array, headings: Array, most: int) -> None:
    """Finds the nearest poses ahead, `most` after the last ones or one before, and copies them; without branches."""
    beside, one, last = bases.beside, np.uint64(1), np.uint64(len(ahead) - 1)
    for n in range(bases.x.size):
        k, x, y = np.uint64(bases.nearest[n]), bases.x[n], bases.y[n]
        for _ in range(most):
            after = min(k + one, last)
            k = after if _squared(ahead, after, x, y) < _squared(ahead, k, x, y) else k
        before = max(k, one) - one
        k = before if _squared(ahead, before, x, y) < _squared(ahead, k, x, y) else k
        bases.nearest[n] = k
        beside[0, n], beside[1, n], beside[2, n] = ahead[k, 0], ahead[k, 1], ahead[k, 4]
        beside[3, n], beside[4, n] = headings[k, 0], headings[k, 1]


@njit(cache=True, fastmath=True, forceinline=True)
def _squared(ahead: Array, k: np.uint64, x: float, y: float) -> float:
    return (ahead[k, 0] - x) ** 2 + (ahead[k, 1] - y) ** 2


@njit(cache=True, fastmath=True)
def _judge(bases: Bases, prices: Prices, touching: float, steps_lost: float) -> None:
    """What the poses cost; who comes nearer than `touching` pays for the steps that are lost, and stays there."""
    x, y, c, s, v, cost, free, left = bases.x, bases.y, bases.c, bases.s, bases.v, bases.cost, bases.free, bases.left
    beside, loose, contact = bases.beside, prices.loose, prices.contact * steps_lost
    pose_x, pose_y, wanted, cosine, sine = beside[0], beside[1], beside[2], beside[3], beside[4]
    for n in range(x.size):
        aside = abs(cosine[n] * (y[n] - pose_y[n]) - sine[n] * (x[n] - pose_x[n]))
        tight, slow = min(aside, loose), wanted[n] - v[n]
        short = max(0.0, 1.0 - max(left[n], 0.0) / prices.margin)
        judged = prices.lateral * tight * (2.0 * aside - tight) + prices.speed * slow * slow
        judged += prices.heading * (1.0 - c[n] * cosine[n] - s[n] * sine[n]) + prices.near * short * short
        hit = left[n] < touching
        cost[n] += free[n] * (contact if hit else 2.0 * judged)
        free[n] = 0.0 if hit else free[n]


@njit(cache=True, fastmath=True)
def _finish(bases: Bases, ahead: Array, progress: float, steps: int, costs: Array) -> None:
    """Fills in the costs (lanes,): a step, and for what is left of the path."""
    beside, length = bases.beside, ahead[len(ahead) - 1, 3]
    for n in range(costs.size):
        along = beside[3, n] * (bases.x[n] - beside[0, n]) + beside[4, n] * (bases.y[n] - beside[1, n])
        costs[n] = bases.cost[n] / steps + progress * (length - ahead[bases.nearest[n], 3] - along)


@njit(cache=True, fastmath=True)
def average(costs: Array, controls: Array, temperature: float) -> tuple[Array, float]:
    """The mean (steps, 2) of controls (2, steps, samples), weighted by exp(-cost / temperature), and the least cost."""
    least = costs.min()
    shares = np.exp((least - costs) / temperature)
    shares /= shares.sum()
    mean = np.empty((controls.shape[1], 2))
    for part in range(2):
        for t in range(controls.shape[1]):
            row, total = controls[part, t], 0.0
            for n in range(row.size):
                total += shares[n] * row[n]
            mean[t, part] = total
    return mean, least
