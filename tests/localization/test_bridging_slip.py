"""Accelerations between stops tell slip from driving, with the options that docs/filter.md gives."""

from __future__ import annotations

import numpy as np
import pytest

from grape.localization import EkfOptions, Fusion, FusionOptions, Reading, SensorOptions, components, per_component
from grape.localization.state import GRAVITY

PERIOD_S, SLIP = 0.02, 0.08
LEG = np.clip(np.concatenate([np.arange(25), np.full(250, 25), np.arange(25, -100, -1)]) * PERIOD_S, 0.0, 0.5)  # m/s
SPEEDS = np.concatenate([np.zeros(50), LEG, LEG, LEG])
ATTITUDE_AND_RATES = ("roll", "pitch", "yaw", "wx", "wy", "wz")


def off_along(*, room: bool) -> float:
    """How far (m) the filter is off after three legs from stop to stop whose wheels all turn too far by `SLIP`."""
    tilt = 0.2 if room else 0.01
    attitude = per_component(roll=tilt, pitch=tilt, yaw=0.01, wx=0.01, wy=0.01, wz=0.01)
    sensors = {
        "wheels": SensorOptions(
            components=components("vx", "vy", "vz"),
            std=per_component(vx=0.02, vy=0.02, vz=0.02),
            std_per_speed=per_component(vx=0.4 if room else 0.05),
            still_below=0.003,
        ),
        "imu": SensorOptions(components=components(*ATTITUDE_AND_RATES), std=attitude),
        "accelerometer": SensorOptions(
            components=components("ax", "ay", "az"),
            std=per_component(ax=0.02, ay=0.02, az=0.02),
            delay_s=PERIOD_S,
        ),
    }
    noise, motion_noise = EkfOptions().noise.copy(), EkfOptions().motion_noise.copy()
    if room:
        noise[3:5], noise[6:9], noise[12:15] = 1e-7, 1e-5, 50.0
        motion_noise[:5] = 0.0
    fusion = Fusion(sensors, FusionOptions(filter=EkfOptions(noise=noise, motion_noise=motion_noise)))
    forces = np.zeros((len(SPEEDS), 15))
    forces[1:, 12] = np.diff(SPEEDS) / PERIOD_S  # their mean since the reading before
    forces[:, 14] = GRAVITY
    for k, speed in enumerate(SPEEDS):
        stamp, wheels = PERIOD_S * (k + 1), np.zeros(15)
        wheels[6] = speed * (1.0 + SLIP)
        for sensor, values, given in (
            ("wheels", wheels, components("vx", "vy", "vz")),
            ("imu", np.zeros(15), components(*ATTITUDE_AND_RATES)),
            ("accelerometer", forces[k], components("ax", "ay", "az")),
        ):
            fusion.take(Reading(stamp=stamp, sensor=sensor, values=values, given=np.array(given)))
    return float(fusion.belief().mean[0] - SPEEDS.sum() * PERIOD_S)


def test_accelerations_beside_the_usual_options_leave_slip_as_it_is() -> None:
    assert off_along(room=False) == pytest.approx(SLIP * SPEEDS.sum() * PERIOD_S, rel=0.05)


def test_accelerations_see_slip_where_wheels_and_motion_are_given_room() -> None:
    assert abs(off_along(room=True)) < off_along(room=False) / 3.0
