"""Whether the filter's covariance is true: random motion by its own model, sensors with the noise that it is told."""

from __future__ import annotations

import numpy as np

from grape.geometry import pose, rotation_from_rpy
from grape.localization import Ekf, EkfOptions, Measurement, Mount
from grape.localization import ekf_kernels as kernels
from grape.messages import Array

STATES = 15
LOOKS = 20  # of a run, one a second
PERIOD_S, PER_LOOK = 0.05, 20
NOISE = np.array([*[1e-5] * 6, 0.05, *[0.02] * 4, 0.05, *[1e-3] * 3])
START_STD = np.array([*[0.5] * 3, *[0.05] * 3, *[0.2] * 3, *[0.05] * 3, *[0.05] * 3])
MEAN = np.where(np.arange(STATES) == 6, 0.5, np.where(np.arange(STATES) == 11, 0.1, 0.0))
MOUNT = Mount(T_base_sensor=pose(rotation_from_rpy(0.2, -0.3, 1.0), (-0.35, -0.2, 0.75)))
SPEEDS, ATTITUDE, PLACE = np.array([6, 7, 8, 11]), np.array([3, 4, 9, 10, 11]), np.array([0, 1, 2])
SENSORS = ((SPEEDS, 0.05, 1), (ATTITUDE, 0.03, 1), (PLACE, 0.02, 10))  # components, std, every so many steps
NONE = np.zeros(STATES)


def nees(rng: np.random.Generator) -> Array:
    """(`LOOKS`, 2) of one run: normalised estimation error squared of all 15 states, and of the position.

    Source: Bar-Shalom, Li and Kirubarajan, Estimation with applications to tracking and navigation, 2001, section 5.4.
    """
    truth = MEAN + rng.normal(size=STATES) * START_STD
    options = EkfOptions(noise=NOISE, motion_noise=NONE, turn_noise=NONE)
    ekf = Ekf(0.0, MEAN, np.diag(START_STD**2), options)
    found = []
    for step in range(1, LOOKS * PER_LOOK + 1):
        truth, _ = kernels.predict(truth, np.zeros((STATES, STATES)), NONE, NONE, NONE, PERIOD_S)
        truth = truth + rng.normal(size=STATES) * np.sqrt(NOISE * PERIOD_S)
        for index, std, every in SENSORS:
            if step % every == 0:
                ekf.correct(_measured(step * PERIOD_S, truth, index, std, rng))
        if step % PER_LOOK == 0:
            found.append(_nees(truth, *ekf.belief[1:]))
    return np.array(found)


def _measured(stamp: float, truth: Array, index: Array, std: float, rng: np.random.Generator) -> Measurement:
    exact, _ = kernels.observe(truth, index, MOUNT.lever, MOUNT.frames)
    return Measurement(
        stamp=stamp,
        source="sensor",
        index=index,
        value=exact + rng.normal(size=index.size) * std,
        covariance=np.eye(index.size) * std**2,
        mount=MOUNT,
    )


def _nees(truth: Array, mean: Array, covariance: Array) -> tuple[float, float]:
    error = truth - mean
    error[3:6] = (error[3:6] + np.pi) % (2 * np.pi) - np.pi
    whole = error @ np.linalg.solve(covariance, error)
    return float(whole), float(error[:3] @ np.linalg.solve(covariance[:3, :3], error[:3]))
