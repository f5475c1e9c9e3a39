"""An arm with the flaws of a real one: what it reports is not where its links are."""

import numpy as np
import pytest

from grape.actions.robot import build_robot
from grape.errors import InvalidInput
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.arm_errors import ArmErrors, draw_arm_errors
from grape.sim.drivers import SensorOptions
from grape.sim.drivers.arm import ArmDriverOptions


def links(simulation):
    physics = simulation._physics
    return physics.data.qpos[physics.joint_qpos(DESCRIPTION.arm.joints)].copy()


@pytest.fixture
def flawed(simulate):
    def build(seed=1, level=1.0):
        return simulate(seed=seed, sensors=SensorOptions(arm=ArmDriverOptions(errors=level)))

    return build


def test_the_hand_is_0_to_5_cm_beside_what_the_encoders_tell():
    robot, rng = build_robot(DESCRIPTION), np.random.default_rng(0)
    off = []
    for seed in range(200):
        q = np.array([*rng.uniform(0, 2 * np.pi, 1), *rng.uniform(1.0, 5.2, 2), *rng.uniform(0, 2 * np.pi, 3)])
        bias = draw_arm_errors(np.random.default_rng(seed), 6).bias
        off.append(np.linalg.norm(robot.hand_pose(q)[:3, 3] - robot.hand_pose(q - bias)[:3, 3]))
    assert 0.010 < np.mean(off) < 0.025
    assert 0.030 < np.max(off) < 0.060


def test_the_encoders_are_off_by_a_constant_that_the_seed_decides(flawed):
    first, again, other = flawed(1), flawed(1), flawed(2)
    biases = [s.drivers.arm.latest().position - links(s) for s in (first, again, other)]
    assert np.abs(biases[0]).max() > 0.01
    assert biases[0] == pytest.approx(biases[1], abs=1e-12)
    assert np.abs(biases[0] - biases[2]).max() > 0.005


def test_a_link_follows_a_reversal_only_when_the_play_is_used_up(flawed):
    simulation = flawed()
    play = draw_arm_errors(simulation._drivers.arm._noise.constant(), 6).play[0]
    arm, gaps = simulation.drivers.arm, []
    for speed in (0.2, -0.2):
        for beat in range(80):
            arm.send(np.array([speed if beat < 40 else 0.0, 0, 0, 0, 0, 0]))
            simulation.advance()
        gaps.append(np.mean([arm.latest().position[0] - links(simulation)[0] for _ in range(3)]))
    assert gaps[0] - gaps[1] == pytest.approx(play, abs=5e-4)


def test_a_joint_overruns_its_set_point_and_its_encoder_tells(flawed):
    simulation = flawed()
    arm, speed = simulation.drivers.arm, 0.3
    rate = draw_arm_errors(simulation._drivers.arm._noise.constant(), 6).rate[3]
    positions = []
    for _ in range(150):
        arm.send(np.array([0, 0, 0, speed, 0, 0]))
        simulation.advance()
        positions.append(arm.latest().position[3])
    assert (positions[-1] - positions[-101]) / 1.0 == pytest.approx(speed * (1 + rate), abs=0.003)


def test_without_errors_encoders_tell_the_truth(simulate):
    simulation = simulate()
    arm = simulation.drivers.arm
    for _ in range(50):
        arm.send(np.full(6, 0.2))
        simulation.advance()
    assert arm.latest().position == pytest.approx(links(simulation), abs=1e-3)


def test_wrong_errors_are_refused():
    with pytest.raises(InvalidInput, match="level"):
        draw_arm_errors(np.random.default_rng(0), 6, -1.0)
    with pytest.raises(InvalidInput, match="play"):
        ArmErrors(bias=np.zeros(6), play=np.full(6, -0.1), rate=np.zeros(6))
    with pytest.raises(InvalidInput, match="6"):
        ArmErrors(bias=np.zeros(6), play=np.zeros(5), rate=np.zeros(6))
