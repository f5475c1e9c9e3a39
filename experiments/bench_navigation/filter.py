"""How long one predict and one update of the 15-state filter take, beside filterpy on the same measurements."""

from __future__ import annotations

from importlib.util import find_spec
from math import cos, sin
from typing import Any

import numpy as np

from grape.experiments.bench_manipulation import BenchError, seconds
from grape.localization import Ekf, EkfOptions, Measurement
from grape.messages import Array
from grape.proof import Comparison

STEPS = 200
PERIOD_S = 0.02
INDEX = np.array([3, 4, 5, 9, 10, 11])
STD = 0.02
AGREEMENT = 1e-6
QUANTITY, UNIT = "filter: predict and update, six components", "µs"
Motion = tuple[Array, Array]  # Jacobian (15, 15) and mean (15,)


def rows() -> list[Comparison]:
    """An IMU of six components at 50 Hz: `Ekf.correct` from Python, and the extended filter of filterpy if installed.

    Raises:
        BenchError: the two do not come to the same estimate.
    """
    values = np.random.default_rng(1).normal(0.0, STD, (STEPS, INDEX.size))
    covariance = np.eye(INDEX.size) * STD**2
    measurements = [
        Measurement(stamp=PERIOD_S * (k + 1), source="imu", index=INDEX, value=value, covariance=covariance)
        for k, value in enumerate(values)
    ]
    if find_spec("filterpy") is None:
        (ours,) = seconds(lambda: ours_run(measurements))
        return [Comparison(quantity=QUANTITY, unit=UNIT, value=1e6 * ours / STEPS)]
    ours_end, (theirs_end, motions) = ours_run(measurements), filterpy_run(values)
    difference = float(np.abs(ours_end - theirs_end).max())
    if not difference < AGREEMENT:
        raise BenchError(f"the filters differ by {difference:.2g} after {STEPS} steps")
    times = seconds(lambda: ours_run(measurements), lambda: filterpy_run(values), lambda: filterpy_run(values, motions))
    ours, whole, alone = (1e6 * least / STEPS for least in times)
    return [
        Comparison(
            quantity=QUANTITY, unit=UNIT, value=ours, peer="filterpy, motion in NumPy", peer_value=whole,
            ratio_goal=">= 5",
        ),
        Comparison(
            quantity=QUANTITY, unit=UNIT, value=ours, peer="filterpy, motion for nothing", peer_value=alone,
        ),
    ]  # fmt: skip


def ours_run(measurements: list[Measurement]) -> Array:
    """(15,) the mean after all measurements."""
    nothing = np.zeros(15)
    ekf = Ekf(0.0, _start(), np.eye(15) * 0.01, EkfOptions(motion_noise=nothing, turn_noise=nothing))
    for measurement in measurements:
        ekf.correct(measurement)
    return ekf.belief.mean


def filterpy_run(values: Array, motions: list[Motion] | None = None) -> tuple[Array, list[Motion]]:
    """(15,) the mean of filterpy's extended filter with the same model, and each step's motion.

    Args:
        motions: of an earlier run on the same values, so that filterpy's own arithmetic is left; None works them out.
    """
    from filterpy.kalman import ExtendedKalmanFilter

    ekf: Any = ExtendedKalmanFilter(dim_x=15, dim_z=INDEX.size)
    ekf.x, ekf.P = _start(), np.eye(15) * 0.01
    ekf.Q, ekf.R = np.diag(EkfOptions().noise * PERIOD_S), np.eye(INDEX.size) * STD**2
    H, used = np.eye(15)[INDEX], []
    for k, z in enumerate(values):
        motion = _motion(ekf.x, PERIOD_S) if motions is None else motions[k]
        used.append(motion)
        ekf.F, moved = motion
        ekf.predict_x = lambda u=0, moved=moved: setattr(ekf, "x", moved)
        ekf.predict()
        ekf.update(z, lambda x: H, lambda x: x[INDEX])
    return np.asarray(ekf.x), used


def _start() -> Array:
    mean = np.zeros(15)
    mean[6] = 0.5
    return mean


def _motion(x: Array, dt: float) -> Motion:
    """Jacobian (15, 15) and mean (15,) after `dt` seconds of constant acceleration and rates."""
    roll, pitch, yaw = x[3:6].tolist()
    wx, wy, wz = x[9:12].tolist()
    sr, cr, sp, cp, sy, cy = sin(roll), cos(roll), sin(pitch), cos(pitch), sin(yaw), cos(yaw)
    tp = sp / cp
    R = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    step = x[6:9] * dt + (0.5 * dt * dt) * x[12:15]
    moved = R @ step
    sx, sy_, sz = step.tolist()
    turn, across = sr * wy + cr * wz, cr * wy - sr * wz
    y, F = x.copy(), np.eye(15)
    y[:3] += moved
    y[3:6] += np.array([wx + turn * tp, across, turn / cp]) * dt
    y[6:9] += x[12:15] * dt
    F[:3, 3] = R[:, 2] * sy_ - R[:, 1] * sz
    F[:3, 4] = R @ np.array([cr * sz + sr * sy_, -sr * sx, -cr * sx])
    F[0, 5], F[1, 5] = -moved[1], moved[0]
    F[:3, 6:9] = R * dt
    F[:3, 12:15] = R * (0.5 * dt * dt)
    F[3:6, 9:12] = np.array([[1.0, sr * tp, cr * tp], [0.0, cr, -sr], [0.0, sr / cp, cr / cp]]) * dt
    F[6, 12] = F[7, 13] = F[8, 14] = dt
    F[3:6, 3] += np.array([across * tp, -turn, across / cp]) * dt
    F[3:6, 4] += np.array([turn / cp**2, 0.0, turn * tp / cp]) * dt
    return F, y
