"""Biases of rates and accelerations are learnt while the base stands, and only then."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import pose, rotation_from_rpy
from grape.localization import Fusion, Mount, Reading, SensorOptions, components, per_component
from grape.localization.state import GRAVITY

TILTED = pose(rotation_from_rpy(0.3, -0.4, 1.1), (0.1, 0.0, 0.2))
RATES = np.array([0.011, -0.007, 0.005])
FORCES = np.array([0.05, -0.03, 0.02])


def fusion(still_bias: tuple[bool, ...], still_bias_s: float = 300.0) -> Fusion:
    wheels = SensorOptions(components=components("vx", "wz"), std=per_component(vx=0.02, wz=0.5), still_below=0.003)
    imu = SensorOptions(
        components=components("roll", "pitch", "yaw", "wx", "wy", "wz", "ax", "ay", "az"),
        mount=Mount(T_base_sensor=TILTED),
        std=per_component(roll=0.01, pitch=0.01, yaw=1.0, wx=0.005, wy=0.005, wz=0.005, ax=0.3, ay=0.3, az=0.3),
        still_bias=still_bias,
        still_bias_s=still_bias_s,
    )
    return Fusion({"wheels": wheels, "imu": imu})


def readings(stamp: float, speed: float) -> tuple[Reading, Reading]:
    """Of a base that heads along x on flat ground; wheels say all that they say truly, the IMU with its biases."""
    wheels, imu = np.zeros(15), np.zeros(15)
    wheels[6] = speed
    R = TILTED[:3, :3]
    imu[3:6] = 0.3, -0.4, 1.1  # the sensor's own attitude
    imu[9:12] = RATES
    imu[12:15] = R.T @ np.array([0.0, 0.0, GRAVITY]) + FORCES
    given = np.zeros(15, bool)
    given[[6, 11]] = True
    known = np.zeros(15, bool)
    known[[3, 4, 5, *range(9, 15)]] = True
    return (
        Reading(stamp=stamp, sensor="wheels", values=wheels, given=given),
        Reading(stamp=stamp, sensor="imu", values=imu, given=known),
    )


def run(filter_: Fusion, first: float, last: float, speed: float) -> None:
    for stamp in np.arange(first, last, 0.02):
        for reading in readings(float(stamp), speed):
            filter_.take(reading)


def test_standing_shows_the_bias_along_the_sensors_own_axes() -> None:
    learning = fusion(components("wx", "wy", "wz", "ax", "ay", "az"))
    run(learning, 0.0, 4.0, 0.0)
    np.testing.assert_allclose(learning.bias("imu")[9:12], RATES, atol=1e-4)
    np.testing.assert_allclose(learning.bias("imu")[12:], FORCES, atol=0.01)
    assert not learning.bias("wheels").any()


def test_what_is_learnt_keeps_the_heading_on_the_way() -> None:
    turned = {}
    for flags in (components(), components("wx", "wy", "wz")):
        filter_ = fusion(flags)
        run(filter_, 0.0, 4.0, 0.0)
        before = filter_.belief().mean[5]
        run(filter_, 4.0, 24.0, 0.5)
        turned[any(flags)] = abs(filter_.belief().mean[5] - before)
    assert turned[False] > 0.02 > 5 * turned[True]


def test_nothing_is_learnt_while_it_moves_or_nobody_says_that_it_stands() -> None:
    moving = fusion(components("wz"))
    run(moving, 0.0, 3.0, 0.5)
    assert not moving.bias("imu").any()
    silent = fusion(components("wz"))
    run(silent, 0.0, 0.1, 0.0)  # too short to have settled
    for stamp in np.arange(0.3, 3.0, 0.02):
        silent.take(readings(float(stamp), 0.0)[1])
    assert not silent.bias("imu").any()


def test_numbers_that_are_none_are_not_learnt_from() -> None:
    filter_ = fusion(components("wx", "wy", "wz"))
    run(filter_, 0.0, 2.0, 0.0)
    wheels, imu = readings(2.0, 0.0)
    filter_.take(wheels)
    filter_.take(Reading(stamp=2.0, sensor="imu", values=np.full(15, np.nan), given=imu.given))
    assert np.isfinite(filter_.bias("imu")).all()
    assert filter_.verdicts["imu", "not_finite"] == 1


def test_an_old_bias_is_forgotten() -> None:
    quick, slow = fusion(components("wz"), still_bias_s=1.0), fusion(components("wz"))
    for filter_ in (quick, slow):
        run(filter_, 0.0, 2.0, 0.0)
        for stamp in np.arange(2.0, 7.0, 0.02):
            wheel, reading = readings(float(stamp), 0.0)
            values = reading.values.copy()
            values[11] = 0.0
            filter_.take(wheel)
            filter_.take(Reading(stamp=reading.stamp, sensor="imu", values=values, given=reading.given))
    assert abs(quick.bias("imu")[11]) < 0.1 * RATES[2] < abs(slow.bias("imu")[11])


def test_only_rates_and_accelerations_have_a_bias() -> None:
    for wrong in ({"still_bias": components("vx")}, {"still_bias": components("wz"), "still_bias_s": 0.0}):
        with pytest.raises(InvalidInput, match="still_bias"):
            SensorOptions(components=components("vx", "wz"), **wrong)
