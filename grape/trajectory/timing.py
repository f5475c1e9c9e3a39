"""Time parametrisation of joint paths: as quick as speed and acceleration limits allow.

Source: Pham and Pham, A new approach to time-optimal path parameterization based on reachability analysis, 2018.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from grape.errors import ActionFailed, InvalidInput, Reason
from grape.messages import Array
from grape.trajectory.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class TimingOptions:
    """How a polyline becomes a motion.

    Args:
        speed: fraction of the speed limits that is used.
        acceleration: fraction of the acceleration limits that is used.
        blend_rad: joint distance before and after a corner within which it is rounded.
        spacing_rad: distance between the points through which the path is interpolated.
        grid: grid points of the parametrisation; more are used where corners need them.
        period_s: knots of the result.
    """

    speed: float = 1.0
    acceleration: float = 1.0
    blend_rad: float = 0.15
    spacing_rad: float = 0.04
    grid: int = 100
    period_s: float = 0.01

    def __post_init__(self) -> None:
        if not (0.0 < self.speed <= 1.0 and 0.0 < self.acceleration <= 1.0):
            raise InvalidInput(f"speed and acceleration must be in (0, 1], got {self.speed} and {self.acceleration}")


def time_path(
    waypoints: Array,
    velocity_max: Array,
    acceleration_max: Array,
    options: TimingOptions | None = None,
    *,
    edge_valid: Callable[[Array, Array], bool] | None = None,
) -> Trajectory:
    """The quickest motion along a polyline whose corners are rounded as far as the way is free.

    Args:
        waypoints: (k, n) rad, absolute; repeated points are dropped.
        velocity_max: (n,) rad/s.
        acceleration_max: (n,) rad/s^2.
        options: speed share, rounding and grid.
        edge_valid: check of a straight joint motion; the rounded path is checked with it and the rounding halved until
            it passes. Without it the rounding stays as asked.

    Raises:
        InvalidInput: shapes or numbers are wrong.
        ActionFailed: NO_PLAN when no parametrisation exists, IN_COLLISION when no rounding is free.
    """
    options = options or TimingOptions()
    points = _checked(waypoints, velocity_max, acceleration_max)
    if len(points) == 1:
        return Trajectory(times=np.zeros(1), positions=points, velocities=np.zeros_like(points))
    v_max = options.speed * np.asarray(velocity_max, float)
    a_max = options.acceleration * np.asarray(acceleration_max, float)
    for blend in options.blend_rad * 0.5 ** np.arange(6):
        dense = densify(
            points, blend, min(options.spacing_rad, 0.3 * blend) if len(points) > 2 else options.spacing_rad
        )
        if edge_valid is None or all(edge_valid(a, b) for a, b in pairwise(dense)):
            return _parametrize(dense, v_max, a_max, options)
    raise ActionFailed(Reason.IN_COLLISION, f"the path is not free even with corners rounded by only {blend:.3f} rad")


def densify(points: Array, blend: float, spacing: float) -> Array:
    """Points (m, n) at most `spacing` apart along the polyline (k, n), corners replaced by parabolas.

    A parabola starts and ends `blend` rad from its corner, or half-way to the next one where that is nearer.
    """
    pieces = [points[:1]]
    last = points[0]
    for previous, corner, following in zip(points[:-2], points[1:-1], points[2:], strict=True):
        before, after = previous - corner, following - corner
        enter = corner + before * min(0.5, blend / np.linalg.norm(before))
        leave = corner + after * min(0.5, blend / np.linalg.norm(after))
        pieces.append(_line(last, enter, spacing))
        count = int(np.ceil((np.linalg.norm(enter - corner) + np.linalg.norm(leave - corner)) / spacing)) + 1
        s = np.linspace(0.0, 1.0, max(count, 4))[1:, None]
        pieces.append((1 - s) ** 2 * enter + 2 * s * (1 - s) * corner + s**2 * leave)
        last = leave
    pieces.append(_line(last, points[-1], spacing))
    dense = np.concatenate(pieces)
    keep = np.r_[True, np.linalg.norm(np.diff(dense, axis=0), axis=1) > 1e-9]
    return dense[keep]


def _line(a: Array, b: Array, spacing: float) -> Array:
    """Points after `a` up to and with `b`."""
    count = max(int(np.ceil(np.linalg.norm(b - a) / spacing)), 1)
    return a + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a)


def _checked(waypoints: Array, velocity_max: Array, acceleration_max: Array) -> Array:
    points = np.asarray(waypoints, dtype=float)
    if points.ndim != 2 or len(points) < 1 or not np.isfinite(points).all():
        raise InvalidInput(f"waypoints must be finite with shape (k >= 1, n), got shape {points.shape}")
    for name, limit in (("velocity_max", velocity_max), ("acceleration_max", acceleration_max)):
        limit = np.asarray(limit, float)
        if limit.shape != points.shape[1:] or not (limit > 0).all():
            raise InvalidInput(f"{name} must be {points.shape[1]} positive numbers, got {limit}")
    keep = np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6]
    return points[keep]


def _parametrize(dense: Array, v_max: Array, a_max: Array, options: TimingOptions) -> Trajectory:
    import toppra
    import toppra.algorithm
    import toppra.constraint

    toppra.setup_logging("ERROR")
    s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))]
    path = toppra.SplineInterpolator(s, dense)
    limits = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-v_max, v_max])),
        toppra.constraint.JointAccelerationConstraint(np.column_stack([-a_max, a_max])),
    ]
    grid = np.linspace(0.0, s[-1], int(np.clip(len(dense), options.grid, 4 * options.grid)) + 1)
    algorithm = toppra.algorithm.TOPPRA(limits, path, gridpoints=grid, parametrizer="ParametrizeSpline")
    timed = algorithm.compute_trajectory(0.0, 0.0)
    if timed is None:
        raise ActionFailed(Reason.NO_PLAN, f"the path of {len(dense)} points and {s[-1]:.2f} rad cannot be timed")
    count = max(int(np.ceil(timed.duration / options.period_s)), 2)
    times = np.linspace(0.0, timed.duration, count + 1)
    positions, velocities, accelerations = (timed(times, order) for order in range(3))
    stretch = max(
        1.0,
        float((np.abs(velocities) / v_max).max()),
        float(np.sqrt((np.abs(accelerations) / a_max).max())),  # between grid points the limits are not enforced
    )
    velocities[[0, -1]] = 0.0
    return Trajectory(times=stretch * times, positions=positions, velocities=velocities / stretch)
