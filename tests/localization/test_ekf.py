from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import inverse, pose, rotation_from_rpy
from grape.localization import Ekf, EkfOptions, Measurement, Mount, Verdict, components
from grape.localization import ekf_kernels as kernels


def some_state(seed: int = 1) -> np.ndarray:
    x = np.random.default_rng(seed).normal(0, 0.4, 15)
    x[5] = 2.9
    return x


def some_covariance(seed: int = 2) -> np.ndarray:
    A = np.random.default_rng(seed).normal(0, 0.1, (15, 15))
    return A @ A.T + 0.01 * np.eye(15)


def measured(stamp: float, value: float, *, std: float = 0.1, index: int = 0, gate: float = np.inf) -> Measurement:
    return Measurement(stamp=stamp, source="test", index=[index], value=[value], covariance=[[std**2]], gate=gate)


def standing(options: EkfOptions | None = None) -> Ekf:
    return Ekf(0.0, np.zeros(15), np.eye(15) * 0.01, options)


def test_prediction_jacobian_agrees_with_finite_differences():
    x, dt, h = some_state(), 0.05, 1e-6
    none = np.zeros(15)
    F = np.empty((15, 15))
    for j in range(15):
        step = np.eye(15)[j] * h
        plus, _ = kernels.predict(x + step, np.eye(15), none, none, none, dt)
        minus, _ = kernels.predict(x - step, np.eye(15), none, none, none, dt)
        F[:, j] = (plus - minus) / (2 * h)
    P = some_covariance()
    _, predicted = kernels.predict(x, P, none, none, none, dt)
    assert np.allclose(predicted, F @ P @ F.T, atol=1e-7)


MOUNT = Mount(
    T_base_sensor=pose(rotation_from_rpy(0.3, -0.8, 2.0), (-0.35, -0.2, 0.75)),
    T_world_frame=pose(rotation_from_rpy(0.1, 0.2, 0.3), (4.0, 5.0, 6.0)),
)


@pytest.mark.parametrize("frames", [kernels.DIRECT, MOUNT.frames])
def test_observation_jacobian_agrees_with_finite_differences(frames):
    x, h, index = some_state(3), 1e-6, np.arange(15)
    _, H = kernels.observe(x, index, MOUNT.lever, frames)
    for j in range(15):
        step = np.eye(15)[j] * h
        plus, _ = kernels.observe(x + step, index, MOUNT.lever, frames)
        minus, _ = kernels.observe(x - step, index, MOUNT.lever, frames)
        assert np.allclose(H[:, j], (plus - minus) / (2 * h), atol=1e-6)


def test_mounted_sensor_sees_position_velocity_rate_and_specific_force_in_its_own_frames():
    x = some_state(6)
    h, _ = kernels.observe(x, np.arange(15), MOUNT.lever, MOUNT.frames)
    R, R_sensor_base, lever = rotation_from_rpy(*x[3:6]), MOUNT.T_base_sensor[:3, :3].T, MOUNT.lever
    v, w, a = x[6:9], x[9:12], x[12:15]
    force = a + np.cross(w, v) + np.cross(w, np.cross(w, lever)) + R.T @ [0.0, 0.0, 9.80665]
    assert np.allclose(h[:3], (inverse(MOUNT.T_world_frame) @ np.r_[x[:3] + R @ lever, 1.0])[:3])
    assert np.allclose(h[6:9], R_sensor_base @ (v + np.cross(w, lever)))
    assert np.allclose(h[9:12], R_sensor_base @ w)
    assert np.allclose(h[12:], R_sensor_base @ force)


def test_covariance_that_is_none_is_refused():
    for covariance in ([[1.0, 2.0], [2.0, 1.0]], [[1.0, 0.5], [0.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]]):
        m = Measurement(stamp=0.0, source="test", index=[0, 1], value=[0.0, 0.0], covariance=covariance)
        assert standing().correct(m).verdict is Verdict.NOT_FINITE


def test_stamp_far_ahead_is_refused_and_a_long_silence_survived():
    ekf = standing(EkfOptions(longest_gap_s=3600.0))
    assert ekf.correct(measured(1e9, 0.0)).verdict is Verdict.TOO_NEW
    assert ekf.correct(measured(3500.0, 7.0)).accepted
    assert ekf.belief.mean[0] == pytest.approx(7.0, abs=0.1)


def test_late_measurement_does_not_undo_a_widening():
    ekf = Ekf(0.0, np.zeros(15), np.eye(15) * 1e-6)
    ekf.correct(measured(0.2, 0.0, std=0.001))
    ekf.widen(np.array([0]), 1.0)
    ekf.correct(measured(0.1, 0.0, std=0.001))
    assert ekf.belief.covariance[0, 0] > 0.9


def test_correction_equals_the_textbook_kalman_update():
    x, P, index = some_state(4), some_covariance(), np.array([0, 5, 11])
    z, R = x[index] + [0.1, -0.05, 0.2], np.diag([0.02, 0.03, 0.04]) + 0.005
    H = np.eye(15)[index]
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    mean, covariance, distance = kernels.correct(x, P, index, z, R, np.zeros(3), np.inf, kernels.DIRECT)
    assert np.allclose(mean, x + K @ (z - x[index]))
    assert np.allclose(covariance, (np.eye(15) - K @ H) @ P)
    assert distance == pytest.approx(np.sqrt((z - x[index]) @ np.linalg.solve(S, z - x[index])))


def test_yaw_innovation_takes_the_short_way_across_pi():
    mean = np.zeros(15)
    mean[5] = np.pi - 0.01
    ekf = Ekf(0.0, mean, np.eye(15) * 0.01)
    ekf.correct(measured(0.0, -np.pi + 0.01, index=5))
    assert abs(ekf.belief.mean[5]) > np.pi - 0.011


def test_silence_keeps_predicting_and_the_covariance_grows():
    mean = np.zeros(15)
    mean[6] = 0.5
    ekf = Ekf(0.0, mean, np.eye(15) * 1e-4)
    stds = [np.sqrt(ekf.predict_to(t).covariance[0, 0]) for t in (1.0, 2.0, 4.0, 8.0)]
    assert ekf.belief.mean[0] == pytest.approx(4.0)
    assert all(b > a for a, b in pairwise(stds))


def test_looking_ahead_leaves_the_filter_as_it_is():
    ekf = standing()
    before = ekf.belief
    assert ekf.predicted(5.0).stamp == 5.0
    assert ekf.belief is before


def test_jump_beyond_the_gate_is_refused_and_moves_nothing():
    ekf = standing()
    correction = ekf.correct(measured(0.0, 5.0, gate=3.0))
    assert correction.verdict is Verdict.GATED and correction.distance > 3.0
    assert ekf.belief.mean[0] == 0.0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_measurement_that_is_not_finite_is_refused(bad):
    ekf = standing()
    assert ekf.correct(measured(0.0, bad)).verdict is Verdict.NOT_FINITE
    assert np.isfinite(ekf.belief.mean).all()


def test_late_measurement_gives_the_same_belief_as_one_in_time():
    def run(order: list[Measurement]) -> np.ndarray:
        ekf = standing()
        for m in order:
            assert ekf.correct(m).accepted
        return ekf.belief.mean

    a, b, c = measured(0.1, 0.3), measured(0.2, 0.5, index=6), measured(0.3, 0.2)
    assert np.allclose(run([a, b, c]), run([a, c, b]), atol=1e-12)


def test_measurement_older_than_the_history_is_refused():
    ekf = standing(EkfOptions(history_s=0.5))
    for k in range(100):
        ekf.correct(measured(0.1 * k, 0.0))
    assert ekf.correct(measured(1.0, 3.0)).verdict is Verdict.TOO_OLD


def test_two_dimensional_mode_holds_height_and_tilt_at_zero():
    mean = some_state(5)
    ekf = Ekf(0.0, mean, np.eye(15) * 0.01, EkfOptions(two_d=True))
    ekf.predict_to(1.0)
    ekf.correct(measured(1.0, 4.0, index=2))
    assert np.allclose(ekf.belief.mean[[2, 3, 4, 8, 9, 10, 14]], 0.0)
    assert ekf.belief.mean[0] != mean[0]


def test_widened_component_follows_the_next_measurement():
    ekf = Ekf(0.0, np.zeros(15), np.eye(15) * 1e-6)
    ekf.widen(np.array([0]), 1.0)
    ekf.correct(measured(0.0, 2.0, std=0.01))
    assert ekf.belief.mean[0] == pytest.approx(2.0, abs=0.01)


def test_unknown_component_is_named():
    with pytest.raises(InvalidInput, match="yow"):
        components("x", "yow")


@pytest.mark.parametrize(
    "arguments",
    [
        {"index": [], "value": [], "covariance": np.zeros((0, 0))},
        {"index": [0, 1], "value": [1.0], "covariance": np.eye(2)},
        {"index": [0], "value": [1.0], "covariance": np.eye(2)},
    ],
)
def test_measurement_of_wrong_shape_is_refused(arguments):
    with pytest.raises(InvalidInput):
        Measurement(stamp=0.0, source="test", **arguments)


def test_options_with_negative_noise_are_refused():
    with pytest.raises(InvalidInput, match="noise"):
        EkfOptions(noise=-np.ones(15))


@pytest.mark.parametrize(
    ("mean", "covariance"), [(np.full(15, np.nan), np.eye(15)), (np.zeros(15), np.tri(15)), (np.zeros(3), np.eye(3))]
)
def test_initial_state_that_is_none_is_refused(mean, covariance):
    with pytest.raises(InvalidInput):
        Ekf(0.0, mean, covariance)
    with pytest.raises(InvalidInput, match="eigenvalues"):
        Ekf(0.0, np.zeros(15), np.diag([-1.0, *[1.0] * 14]))
