"""Driving, braking and standing still."""

import numpy as np
import pytest

from grape.errors import InvalidInput, StaleData
from grape.geometry import yaw_of
from grape.robots.husky_jaco2 import DESCRIPTION


def beats(simulation, seconds, command=None):
    for _ in range(round(100 * seconds)):
        if command is not None:
            command()
        simulation.advance()
        simulation.referee.observe()


def pose(simulation):
    return simulation.referee.true_pose()


def test_drives_a_metre_straight_and_its_encoders_agree(simulate):
    simulation = simulate()
    base, start = simulation.drivers.base, pose(simulation)
    wheels = base.latest().position
    beats(simulation, 2.0, lambda: base.send(0.5, 0.0))
    base.stop()
    beats(simulation, 0.5)
    moved = (pose(simulation) - start)[:2, 3]
    turned = (base.latest().position - wheels) * DESCRIPTION.base.wheel_radius
    assert moved[0] == pytest.approx(1.0, abs=0.03)
    assert abs(moved[1]) < 0.02
    assert turned == pytest.approx(moved[0], abs=0.02)


@pytest.mark.parametrize("rate", [0.4, -1.0])
def test_turns_on_the_spot_as_its_effective_track_says(simulate, rate):
    simulation = simulate()
    beats(simulation, 1.0, lambda: simulation.drivers.base.send(0.0, rate))
    before = yaw_of(pose(simulation))
    beats(simulation, 1.5, lambda: simulation.drivers.base.send(0.0, rate))
    turned = np.unwrap([before, yaw_of(pose(simulation))])
    assert (turned[1] - turned[0]) / 1.5 == pytest.approx(rate, rel=0.07)


def test_stops_by_itself_when_nobody_speaks(simulate):
    simulation = simulate()
    beats(simulation, 1.0, lambda: simulation.drivers.base.send(0.5, 0.0))
    beats(simulation, 0.2)
    assert np.abs(simulation.drivers.base.latest().velocity).min() > 1.0
    beats(simulation, 0.6)
    assert np.abs(simulation.drivers.base.latest().velocity).max() < 0.1


def test_says_what_it_sent_after_limits(simulate):
    sent = simulate().drivers.base.send(9.0, -9.0)
    assert sent.linear[0] == DESCRIPTION.base.max_linear
    assert sent.angular[2] == -DESCRIPTION.base.max_angular


def test_refuses_what_is_not_a_number(simulate):
    with pytest.raises(InvalidInput, match="finite"):
        simulate().drivers.base.send(float("nan"), 0.0)


def test_stays_parked_on_a_slope(simulate):
    simulation = simulate(slope=0.03)
    start = pose(simulation)
    beats(simulation, 6.0)
    creep_mm_per_minute = 1e3 * np.linalg.norm((pose(simulation) - start)[:3, 3]) * 10
    assert creep_mm_per_minute < 2.0


def test_speeds_after_a_silence_are_those_of_now(simulate):
    from grape.sim.faults import FreezeSensor

    simulation = simulate()
    drivers, drive = simulation.drivers, lambda: simulation.drivers.base.send(0.4, 0.0)
    beats(simulation, 0.2, drive)
    for name in ("base", "imu"):
        simulation.inject(FreezeSensor(name=name))
    beats(simulation, 2.0, drive)
    silent_since = drivers.base.latest().stamp
    for name in ("base", "imu"):
        simulation.inject(FreezeSensor(name=name, frozen=False))
    beats(simulation, 0.1, drive)
    first = drivers.base.since(silent_since)[0]
    assert first.velocity * DESCRIPTION.base.wheel_radius == pytest.approx(np.full(4, 0.4), abs=0.05)
    force = drivers.imu.since(silent_since)[0].linear_acceleration
    assert abs(force[0]) < 1.0


def test_old_data_is_refused(simulate):
    from grape.sim.faults import FreezeSensor

    simulation = simulate()
    simulation.inject(FreezeSensor(name="base"))
    beats(simulation, 0.1)
    with pytest.raises(StaleData, match="old"):
        simulation.drivers.base.latest(max_age_s=0.05)
    simulation.inject(FreezeSensor(name="base", frozen=False))
    beats(simulation, 0.03)
    assert simulation.drivers.base.latest(max_age_s=0.05).stamp == pytest.approx(simulation.clock.now(), abs=0.02)
