"""The arm's velocity interface, its limits and its watchdog; the fingers."""

from dataclasses import replace

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.robots.husky_jaco2 import DESCRIPTION

ARM = DESCRIPTION.arm


def beats(simulation, count, command=None):
    for _ in range(count):
        if command is not None:
            command()
        simulation.advance()


def test_follows_velocities_without_drift(simulate):
    simulation = simulate()
    arm = simulation.drivers.arm
    velocity = np.array([0.3, -0.2, 0.2, 0.4, -0.3, 0.5])
    expected, before = arm.latest().position, np.zeros(6)
    for beat in range(120):
        sent = arm.send(velocity if beat < 80 else 0 * velocity)
        expected, before = expected + 0.005 * (sent + before), sent
        simulation.advance()
        assert np.abs(arm.latest().position - expected).max() < 0.02
    assert arm.latest().position == pytest.approx(expected, abs=0.003)


def test_says_what_it_sent_after_speed_and_acceleration_limits(simulate):
    simulation = simulate()
    arm = simulation.drivers.arm
    assert arm.send(np.full(6, 9.0)) == pytest.approx(0.01 * ARM.acceleration_max)
    beats(simulation, 60, lambda: arm.send(np.full(6, 9.0)))
    assert arm.send(np.full(6, 9.0)) == pytest.approx(ARM.velocity_max)
    assert np.all(arm.send(np.full(6, -9.0)) > 0), "one beat is not enough to reverse"


def test_a_second_set_point_in_one_beat_gains_no_acceleration(simulate):
    arm = simulate().drivers.arm
    first = arm.send(np.full(6, 9.0))
    assert arm.send(np.full(6, 9.0)) == pytest.approx(first)


def test_stops_by_itself_when_nobody_speaks_and_holds(simulate):
    simulation = simulate()
    arm = simulation.drivers.arm
    beats(simulation, 40, lambda: arm.send(np.full(6, 0.2)))
    beats(simulation, 30)
    held = arm.latest().position
    beats(simulation, 50)
    assert arm.latest().position == pytest.approx(held, abs=0.002)


def test_is_left_unattended_for_as_long_as_its_description_says(simulate):
    simulation = simulate(robot=replace(DESCRIPTION, arm=replace(ARM, command_timeout=0.3)))
    arm = simulation.drivers.arm
    beats(simulation, 40, lambda: arm.send(np.full(6, 0.2)))
    beats(simulation, 28)
    assert arm.latest().velocity == pytest.approx(np.full(6, 0.2), abs=0.05)
    beats(simulation, 30)
    assert arm.latest().velocity == pytest.approx(np.zeros(6), abs=0.05)


def test_stops_at_its_joint_limits(simulate):
    simulation = simulate()
    arm = simulation.drivers.arm
    simulation.advance()
    push = np.zeros(6)
    push[2] = 1.0 if ARM.position_max[2] - arm.latest().position[2] < arm.latest().position[2] else -1.0
    for _ in range(800):
        arm.send(push)
        simulation.advance()
    position = arm.latest().position[2]
    assert ARM.position_min[2] - 0.02 < position < ARM.position_max[2] + 0.02


@pytest.mark.parametrize("wrong", [np.zeros(5), np.full(6, np.nan)])
def test_refuses_wrong_velocities(simulate, wrong):
    with pytest.raises(InvalidInput, match="6 finite joint velocities"):
        simulate().drivers.arm.send(wrong)


def test_fingers_move_at_their_rate_and_stay_within_limits(simulate):
    simulation = simulate()
    gripper = simulation.drivers.gripper
    start = gripper.latest().position
    sent = gripper.send([0.9, 9.0, 0.3])
    assert sent[1] == pytest.approx(DESCRIPTION.gripper.position_max[1])
    beats(simulation, 30)
    assert np.abs(gripper.latest().position - start).max() < 0.35
    beats(simulation, 150)
    assert gripper.latest().position == pytest.approx([0.9, sent[1], 0.3], abs=0.03)


def test_fingers_hold_when_stopped(simulate):
    simulation = simulate()
    gripper = simulation.drivers.gripper
    gripper.send([0.5, 0.3, 0.3])
    beats(simulation, 30)
    gripper.stop()
    held = gripper.latest().position
    beats(simulation, 30)
    assert gripper.latest().position == pytest.approx(held, abs=0.03)
