from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.experiments.skid_steer_log import DATUM, SkidSteerLog, simulate_skid_steer, skid_steer_sensors
from grape.frames import FrameTree
from grape.localization import (
    Cascade,
    EkfOptions,
    Fusion,
    FusionOptions,
    Mount,
    SensorOptions,
    Verdict,
    components,
    per_component,
)
from grape.localization import reading_of_components as said

NORTH_HALF_A_METRE = np.array([0.5 / 111_000, 0.0, 0.0])


@pytest.fixture(scope="module")
def ride() -> SkidSteerLog:
    return simulate_skid_steer(7, 20.0)


def placed(gate: float = np.inf, **options) -> Fusion:
    """A filter with a sensor of x and y, and one of vx."""
    sensors = {
        "place": SensorOptions(components=components("x", "y"), std=per_component(x=0.1, y=0.1), pose_gate=gate),
        "speed": SensorOptions(components=components("vx"), std=per_component(vx=0.05)),
    }
    return Fusion(sensors, FusionOptions(**options))


def errors(log: SkidSteerLog, fusion: Fusion | Cascade, readings=None) -> np.ndarray:
    """Distance to the truth (m) at each stamp after the first three seconds."""
    found, k = [], 0
    for reading in log.readings if readings is None else readings:
        while fusion.started and log.stamps[k] < reading.stamp:
            found.append((log.stamps[k], *(fusion.odometry(log.stamps[k]).pose[:2, 3] - log.poses[k, :2])))
            k += 1
        fusion.take(reading)
        if not fusion.started:
            k = int(np.searchsorted(log.stamps, reading.stamp))
    table = np.array(found)
    return np.hypot(*table[table[:, 0] > 3.0, 1:].T)


def test_wheels_imu_and_late_gnss_give_the_place_within_three_centimetres(ride):
    fusion = Fusion(skid_steer_sensors(), datum=DATUM)
    assert np.sqrt(np.mean(errors(ride, fusion) ** 2)) < 0.03
    assert {verdict for (_, verdict), n in fusion.verdicts.items() if n} == {"accepted"}


def test_one_jump_of_half_a_metre_moves_the_estimate_less_than_five_centimetres(ride):
    clean, jumped = Fusion(skid_steer_sensors(), datum=DATUM), Fusion(skid_steer_sensors(), datum=DATUM)
    worst = 0.0
    for reading in (r for r in ride.readings if r.stamp < 12.0):
        clean.take(reading)
        off = reading.sensor == "gnss" and 7.5 < reading.stamp < 8.5
        jumped.take(replace(reading, geodetic=reading.geodetic + NORTH_HALF_A_METRE) if off else reading)
        if jumped.started:
            worst = max(worst, float(np.abs(clean.belief().mean[:2] - jumped.belief().mean[:2]).max()))
    assert worst < 0.05
    assert jumped.verdicts["gnss", "gated"] == 1


def test_filter_begins_when_each_absolute_component_was_seen():
    fusion = placed()
    assert fusion.waiting_for == ("x", "y")
    fusion.take(said(0.0, "speed", vx=0.5))
    assert not fusion.started
    with pytest.raises(InvalidInput, match="waiting for x, y"):
        fusion.belief()
    fusion.take(said(0.1, "place", x=300.0, y=-200.0))
    assert fusion.started and fusion.waiting_for == ()
    assert np.allclose(fusion.belief().mean[:2], [300.0, -200.0], atol=1e-3)


def test_filter_without_absolute_sensors_begins_at_zero():
    fusion = Fusion({"speed": SensorOptions(components=components("vx"), std=per_component(vx=0.05))})
    for k in range(11):
        fusion.take(said(0.1 * k, "speed", vx=1.0))
    assert fusion.belief().mean[0] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_none_are_counted_and_move_nothing(bad):
    fusion = placed()
    fusion.take(said(0.0, "place", x=0.0, y=0.0))
    before = fusion.belief()
    fusion.take(said(0.0, "place", x=bad, y=0.0))
    fusion.take(said(bad, "place", x=1.0, y=0.0))
    assert fusion.verdicts["place", "not_finite"] == 2
    assert np.array_equal(fusion.belief().mean, before.mean)


def test_late_readings_are_fused_and_too_late_ones_counted():
    fusion = placed()
    for k in range(40):
        fusion.take(said(0.1 * k, "place", x=0.0, y=0.0))
    assert [c.verdict for c in fusion.take(said(3.5, "speed", vx=0.0))] == [Verdict.ACCEPTED]
    assert [c.verdict for c in fusion.take(said(0.5, "speed", vx=0.0))] == [Verdict.TOO_OLD]
    assert fusion.stamp == pytest.approx(3.9)


def test_one_wrong_stamp_is_passed_over_but_a_silence_is_believed():
    fusion = placed()
    fusion.take(said(0.0, "place", x=0.0, y=0.0))
    fusion.take(said(500.0, "place", x=9.0, y=0.0))
    fusion.take(said(0.1, "place", x=0.0, y=0.0))
    assert fusion.verdicts["place", "too_new"] == 1 and fusion.stamp == pytest.approx(0.1)
    fusion.take(said(600.0, "place", x=9.0, y=0.0))
    fusion.take(said(600.1, "place", x=9.0, y=0.0))
    assert fusion.stamp == pytest.approx(600.1)
    assert fusion.belief().mean[0] == pytest.approx(9.0, abs=0.2)


def test_filter_begins_anew_when_time_starts_over():
    fusion = placed(restart_after=5)
    for start in (1000.0, 0.0):
        for k in range(20):
            fusion.take(said(start + 0.1 * k, "place", x=start, y=0.0))
    assert fusion.stamp == pytest.approx(1.9)
    assert fusion.belief().mean[0] == pytest.approx(0.0, abs=0.1)


def test_a_reading_of_several_measurements_may_make_the_filter_begin_anew():
    gates = {"pose_gate": 5.0, "twist_gate": 5.0, "acceleration_gate": 5.0}
    std = per_component(x=0.1, y=0.1, vx=0.1, ax=0.1)
    fusion = Fusion(
        {"all": SensorOptions(components=components("x", "y", "vx", "ax"), std=std, **gates)},
        FusionOptions(restart_after=5),
    )
    for start in (1000.0, 0.0):
        for k in range(20):
            fusion.take(said(start + 0.1 * k, "all", x=start, y=0.0, vx=0.0, ax=0.0))
    assert fusion.belief().mean[0] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("std", [0.1, 3.0])
def test_filter_begins_where_it_is_seen_however_far_that_is(std):
    place = SensorOptions(components=components("x", "y"), std=per_component(x=std, y=std), pose_gate=5.0)
    fusion = Fusion({"place": place})
    for k in range(20):
        fusion.take(said(0.1 * k, "place", x=6e5, y=4.8e6))
    assert fusion.belief().mean[:2] == pytest.approx([6e5, 4.8e6], abs=1e-3)


def test_a_place_that_is_given_at_the_start_counts_beside_the_first_one_seen():
    fusion = placed(initial={"x": 4.0}, initial_std={"x": 1e-3})
    fusion.take(said(0.0, "place", x=9.0, y=0.0))
    assert fusion.belief().mean[0] == pytest.approx(4.0, abs=0.1)


def test_silence_is_noticed_and_the_estimate_goes_on():
    fusion = placed()
    fusion.take(said(0.0, "place", x=0.0, y=0.0))
    fusion.take(said(0.1, "speed", vx=1.0))
    fusion.take(said(4.0, "speed", vx=1.0))
    assert fusion.silent(4.0, 2.0) == ("place",)
    assert fusion.belief(6.0).covariance[0, 0] > fusion.belief().covariance[0, 0]
    assert fusion.belief(6.0).mean[0] > 5.0


def test_position_is_given_up_after_many_refused_poses():
    sensors = {
        "place": SensorOptions(
            components=components("x", "y"), std=per_component(x=0.02, y=0.02), pose_gate=5.0, relocate_after=5
        )
    }
    fusion = Fusion(sensors)
    for k in range(40):
        fusion.take(said(0.1 * k, "place", x=0.0 if k < 10 else 30.0, y=0.0))
    assert fusion.verdicts["place", "gated"] >= 5
    assert fusion.belief().mean[0] == pytest.approx(30.0, abs=0.1)


def test_disabled_and_unknown_sensors():
    fusion = placed()
    fusion.enable("place", False)
    fusion.take(said(0.0, "place", x=5.0, y=0.0))
    assert fusion.verdicts["place", "disabled"] == 1 and not fusion.started
    with pytest.raises(InvalidInput, match="plaice"):
        fusion.take(said(0.0, "plaice", x=5.0))


def test_accelerometer_with_gravity_finds_the_tilt_and_removes_it():
    mount = Mount(T_base_sensor=np.eye(4))
    sensors = {
        "imu": SensorOptions(
            components=components("wx", "wy", "wz", "ax", "ay", "az"),
            mount=mount,
            std=per_component(wx=0.01, wy=0.01, wz=0.01, ax=0.1, ay=0.1, az=0.1),
        ),
        "wheels": SensorOptions(components=components("vx", "vy", "vz"), std=per_component(vx=0.01, vy=0.01, vz=0.01)),
    }
    fusion, g = Fusion(sensors), 9.80665
    for k in range(300):
        force = {"ax": -g * np.sin(0.1), "ay": 0.0, "az": g * np.cos(0.1)}
        fusion.take(said(0.02 * k, "imu", wx=0.0, wy=0.0, wz=0.0, **force))
        fusion.take(said(0.02 * k, "wheels", vx=0.0, vy=0.0, vz=0.0))
    assert fusion.belief().mean[4] == pytest.approx(0.1, abs=0.02)
    assert np.abs(fusion.belief().mean[12:]).max() < 0.15


def test_two_dimensional_filter_stays_in_the_plane(ride):
    fusion = Fusion(skid_steer_sensors(), FusionOptions(filter=EkfOptions(two_d=True)), datum=DATUM)
    for reading in ride.readings[:600]:
        fusion.take(reading)
    assert not fusion.belief().mean[[2, 3, 4, 8, 9, 10, 14]].any()
    assert fusion.verdicts["gnss", "gated"] == 0


def test_cascade_spans_map_odom_and_base_without_lag(ride):
    sensors = skid_steer_sensors()
    local = {name: options for name, options in sensors.items() if name != "gnss"}
    local["imu"] = replace(local["imu"], differential=True, std=per_component(wx=0.01, wy=0.01, wz=0.01))
    cascade = Cascade(Fusion(local, FusionOptions(frame_id="odom")), Fusion(sensors, datum=DATUM))
    steps, before = [], None
    for reading in (r for r in ride.readings if r.stamp < 8.0):
        cascade.take(reading)
        if cascade.started and reading.sensor == "wheels":
            now = cascade.local.odometry(reading.stamp).pose[:2, 3]
            steps.append(0.0 if before is None else float(np.hypot(*(now - before))))
            before = now
    assert max(steps) < 0.02 + 0.01  # 0.7 m/s for 20 ms: odom never jumps
    frames = FrameTree()
    cascade.push(frames)
    whole = cascade.odometry(cascade.local.stamp)
    assert np.allclose(frames.lookup("map", "base_link"), whole.pose, atol=1e-9)
    assert np.hypot(*(whole.pose[:2, 3] - ride.poses[ride.index(cascade.local.stamp), :2])) < 0.08


def test_cascade_of_the_same_frame_is_refused():
    with pytest.raises(InvalidInput, match="two different frames"):
        Cascade(placed(), placed())


def test_geodetic_estimate_agrees_with_the_place(ride):
    fusion = Fusion(skid_steer_sensors())
    for reading in ride.readings[:200]:
        fusion.take(reading)
    first = next(r for r in ride.readings if r.sensor == "gnss")
    assert np.allclose(fusion.geodetic()[:2], first.geodetic[:2], atol=1e-5)
