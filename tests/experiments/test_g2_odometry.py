"""What G2 measures, on a short drive: the log is what it says, each way knows what it may, and figures add up."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from grape.experiments import g2_discord, g2_odometry
from grape.experiments.filter_consistency import LOOKS, nees
from grape.experiments.g2_odometry import EXPERIMENT
from grape.experiments.g2_tracks import (
    WAYS,
    Track,
    at_its_fixes,
    by_filter_with_accelerations,
    by_gnss,
    by_one_filter,
    by_wheels,
)
from grape.experiments.skid_steer_log import (
    DATUM,
    PERIOD_S,
    ROW_SPACING_M,
    SLOPE,
    T_BASE_IMU,
    SkidSteerLog,
    SkidSteerNoise,
    commands,
    on_slope,
    simulate_skid_steer,
    with_accelerations,
)
from grape.localization import Fusion
from grape.localization.state import GRAVITY

SILENT = SkidSteerNoise(
    slip_std=0.0,
    track_std=0.0,
    bend_loss=0.0,
    gyro_std=0.0,
    gyro_bias_std=0.0,
    tilt_std=0.0,
    heading_std=0.0,
    heading_drift=0.0,
    acceleration_std=0.0,
    acceleration_bias_std=0.0,
    gnss_std=1e-6,
)


@pytest.fixture(scope="module")
def ride() -> SkidSteerLog:
    return simulate_skid_steer(7, 16.0)


def track(said: list[float], true: list[float]) -> Track:
    """Along x, looked at every 0.1 s, by something that takes its error for 0.1 m."""
    covariances = np.broadcast_to(0.01 * np.eye(2), (len(said), 2, 2))
    on_x, at_x = (np.column_stack([x, np.zeros(len(x))]) for x in (said, true))
    return Track(stamps=0.1 * np.arange(len(said)), said=on_x, true=at_x, covariances=covariances)


def test_a_session_is_three_rows_beside_each_other() -> None:
    motion = commands(780.0)
    yaw = np.cumsum(motion[:, 1]) * 0.02
    x, y = (np.cumsum(motion[:, 0] * turn(yaw)) * 0.02 for turn in (np.cos, np.sin))
    passes = y[np.flatnonzero(np.diff(x > 35.0))]
    assert len(motion) == 39_000 and 65.0 < x.max() < 80.0
    assert np.diff(passes) == pytest.approx([ROW_SPACING_M] * 2, abs=0.2)
    assert not motion[-50:].any()


def test_a_log_without_errors_adds_up_to_the_truth() -> None:
    log = simulate_skid_steer(1, 12.0, SILENT)
    assert by_wheels(log).errors.max() < 0.01
    assert at_its_fixes(log).errors.max() < 1e-4
    R = on_slope(log.poses[:, 2])
    np.testing.assert_allclose(R.transpose(0, 2, 1) @ R, np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(R[:, 2, 0], SLOPE * R[:, 0, 0], atol=1e-12)  # forward stays in the plane


def test_accelerations_without_errors_add_up_to_the_speed_of_the_imu() -> None:
    log = simulate_skid_steer(1, 12.0, SILENT)
    R = on_slope(log.poses[:, 2])
    forces = np.array([reading.values[12:] for reading in log.accelerations])
    speeds = np.cumsum(np.einsum("nij,nj->ni", R @ T_BASE_IMU[:3, :3], forces) - [0.0, 0.0, GRAVITY], axis=0) * PERIOD_S
    places = log.poses[:, :2] + (R @ T_BASE_IMU[:3, 3])[:, :2]
    np.testing.assert_allclose(speeds[1:, :2], np.diff(places, axis=0) / PERIOD_S, atol=0.01)
    stamps = [reading.stamp for reading in log.all_readings() if reading.sensor == "accelerometer"]
    assert stamps == log.stamps.tolist()


def test_with_accelerations_the_filter_is_as_near_and_takes_all_of_them(ride: SkidSteerLog) -> None:
    found = by_filter_with_accelerations(ride)
    assert np.sqrt(np.mean(found.between(5.0, 16.0).errors ** 2)) < 0.03
    fusion = Fusion(*with_accelerations(), datum=DATUM)
    taken = [(reading.sensor, fusion.take(reading)) for reading in ride.all_readings()]
    accepted = sum(correction.accepted for sensor, found in taken if sensor == "accelerometer" for correction in found)
    assert accepted > 0.8 * len(ride.accelerations), "all but those before the first fix"


def test_gnss_alone_trails_by_its_delay_and_half_its_period(ride: SkidSteerLog) -> None:
    held = by_gnss(ride).between(3.5, 8.5)
    assert 0.3 < held.lag_s < 0.9
    assert held.errors.max() > 0.3 > 3 * at_its_fixes(ride).errors.max()


def test_one_filter_is_near_the_truth_and_knows_nothing_before_its_first_fix(ride: SkidSteerLog) -> None:
    found = by_one_filter(ride)
    assert found.stamps[0] > 1.0
    assert np.sqrt(np.mean(found.between(5.0, 16.0).errors ** 2)) < 0.03
    assert found.within_95.mean() > 0.5


def test_lag_is_the_shift_in_time_that_fits_best() -> None:
    t = 0.1 * np.arange(100)
    speed = 0.5
    assert track((speed * (t - 0.2)).tolist(), (speed * t).tolist()).lag_s == pytest.approx(0.2)
    assert track((np.sin(t - 0.1)).tolist(), np.sin(t).tolist()).lag_s == pytest.approx(0.1, abs=0.01)


def test_the_ellipse_holds_two_and_a_half_sigmas() -> None:
    assert track([0.24, 0.25], [0.0, 0.0]).within_95.tolist() == [True, False]  # sigma 0.1 m


def test_errors_of_a_filter_on_its_own_model_are_those_that_it_expects() -> None:
    runs = np.array([nees(np.random.default_rng([1, k])) for k in range(8)])
    assert runs.shape == (8, LOOKS, 2)
    assert runs[:, :, 0].mean() == pytest.approx(15.0, abs=2.5)
    assert runs[:, :, 1].mean() == pytest.approx(3.0, abs=1.0)


def test_sessions_give_quantities_and_a_page_and_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (
        ("SESSION_S", 34.0),
        ("OUTAGES_S", ((18.0, 22.0),)),
        ("RECOVERY_S", 2.0),
        ("JUMP_EVERY_S", 13.0),
        ("NEES_RUNS", 2),
    ):
        monkeypatch.setattr(g2_odometry, name, value)
    for name, value in (("ALIAS_S", 14.0), ("HELD_S", (24.0, 29.0)), ("WATCHED_S", 6.0)):
        monkeypatch.setattr(g2_discord, name, value)
    proof = EXPERIMENT.run(range(1, 2), tmp_path, lambda share, what: None)
    figures = {quantity.name: quantity for quantity in proof.quantities}
    assert {f"{way.name}: RMSE" for way in WAYS} <= set(figures)
    assert figures["EKF: RMSE"].met and figures["EKF, 60 s without GNSS: largest error, worst"].n == 1
    assert figures["EKF with accelerations, 60 s without GNSS: largest error, worst"].met
    assert figures["EKF: moved by a jump of 0.5 m, at most"].met
    kept = json.loads((tmp_path / "session1.json").read_text())
    assert len(kept["moved"]) == len(kept["off"]) == 2 and max(kept["outages"]) > 0.02
    for key in ("alias", "held"):
        assert kept["discord"][key]["off"] < 0.1 and 0.5 < kept["discord"][key]["told_after"] < 5.0
    assert figures["EKF + AMCL, AMCL one vine off: discord told"].value == 1.0
    assert all(figure.svg.startswith("<svg") for figure in proof.figures)
    (tmp_path / "session1.json").write_text(json.dumps({**kept, "moved": [0.2, 0.01]}))
    again = {q.name: q.value for q in EXPERIMENT.run(range(1, 2), tmp_path, lambda share, what: None).quantities}
    assert again["EKF: moved by a jump of 0.5 m, at most"] == 0.2
