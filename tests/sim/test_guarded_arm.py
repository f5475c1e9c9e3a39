"""The simulated arm behind the guard of missions: it lets go of a post, and feels nothing where nothing is."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from grape.actions.robot import build_robot
from grape.errors import ActionFailed, Reason
from grape.messages import Odometry
from grape.mission.guard import guarded
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.drivers import SensorOptions
from grape.sim.drivers.arm import ArmDriverOptions
from grape.world import World
from tests.sim.test_referee import beats, move_base

ROBOT = build_robot(DESCRIPTION)
REACHING = np.array([5.144, 1.255, 3.445, 5.988, 0.685, 5.072])  # hand 0.85 m to the left, 0.45 m above base_link
JOINT_1 = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def reach_out(simulation):
    """Put the arm where it reaches out, at rest."""
    physics, arm = simulation._physics, simulation.drivers.arm
    physics.data.qpos[arm._qpos] = physics.data.ctrl[arm._actuators] = arm._link[:] = REACHING
    arm._reference = REACHING + arm._errors.bias
    mujoco.mj_forward(physics.model, physics.data)
    beats(simulation, 50)


def watched(simulation):
    told = []
    log = SimpleNamespace(event=lambda kind, **fields: told.append((kind, fields)))
    zero = np.zeros(3)
    there = Odometry(
        stamp=0.0, frame_id="map", child_frame_id="base_link", pose=simulation.referee.true_pose(), linear=zero,
        angular=zero, pose_covariance=np.zeros((6, 6)), twist_covariance=np.zeros((6, 6)),
    )  # fmt: skip
    world = World(site=simulation.world.site, odometry=there)
    return guarded(simulation.drivers, ROBOT, world, simulation.clock, log).arm, told


def test_an_arm_at_a_post_lets_go(simulate):
    simulation = simulate()
    post = next(piece for piece in simulation.world.capsules if "post" in piece.name)
    move_base(simulation, -3.0, -3.0)
    reach_out(simulation)
    hand, J = ROBOT.hand_pose(REACHING)[:2, 3], ROBOT.arm.jacobian(REACHING)
    ahead = DESCRIPTION.arm.T_base_link_arm_base[:2, :2] @ J[:2, 0]
    move_base(simulation, *(np.array(post.p0[:2]) - hand - 0.16 * ahead / np.linalg.norm(ahead)))
    arm, told = watched(simulation)
    with pytest.raises(ActionFailed) as ended:
        for _ in range(300):
            arm.send(0.05 * JOINT_1)
            beats(simulation, 1)
    arm.stop()
    assert ended.value.reason == Reason.CONTACT and "joint 1 feels -" in ended.value.detail
    assert [kind for kind, _ in told] == ["arm_contact"] and told[0][1]["joint"] == 1
    touched = [c for c in simulation.referee.collisions if c.b == post.name]
    assert len(touched) == 1 and simulation.clock.now() - touched[0].time_s < 1.0
    beats(simulation, 50)
    effort = arm.latest().effort - ROBOT.arm.gravity_torque(arm.latest().position)
    assert abs(effort[0]) < DESCRIPTION.arm.touch.torque_max[0]  # bare, it presses on with 30.5 N m


@pytest.mark.parametrize("errors", [0.0, 1.0])
def test_an_arm_in_free_space_feels_nothing(simulate, errors):
    simulation = simulate(sensors=SensorOptions(arm=ArmDriverOptions(errors=errors)), slope=0.1)
    reach_out(simulation)
    arm, told = watched(simulation)
    rng = np.random.default_rng(0)
    for _ in range(6):
        goal = REACHING + rng.uniform(-0.4, 0.4, 6)
        for _ in range(60):
            arm.send(np.clip(6.0 * (goal - arm.latest().position), -0.6, 0.6))
            beats(simulation, 1)
    assert not told and not simulation.referee.collisions
