"""Pinocchio's arm agrees with MuJoCo's, with the facts sheet and with finite differences."""

import mujoco
import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import inverse, pose, pose_error
from grape.kinematics import ArmModel
from grape.robots.husky_jaco2 import DESCRIPTION

END_EFFECTOR = np.array([0.0, 0.0, -0.160])  # Kinova's end effector in the hand frame


@pytest.fixture(scope="module")
def arm():
    return ArmModel.from_mjcf(DESCRIPTION.mjcf)


@pytest.fixture(scope="module")
def simulated():
    model = mujoco.MjModel.from_xml_path(str(DESCRIPTION.mjcf))
    return model, mujoco.MjData(model)


def random_angles(rng):
    q = rng.uniform(-7.0, 7.0, 6)
    q[1:3] = rng.uniform([0.83, 0.34], [5.4, 5.9])
    return q


def body_pose(data, name):
    body = data.body(name)
    return pose(body.xmat.reshape(3, 3), body.xpos)


@pytest.mark.parametrize("seed", range(20))
def test_every_link_is_where_mujoco_puts_it(arm, simulated, seed):
    model, data = simulated
    q = random_angles(np.random.default_rng(seed))
    for joint, angle in zip(DESCRIPTION.arm.joints, q, strict=True):
        data.joint(joint).qpos = angle
    mujoco.mj_kinematics(model, data)
    T_base_world = inverse(body_pose(data, "arm_base"))
    for name, T_base_link in arm.frame_poses(q).items():
        error = pose_error(T_base_world @ body_pose(data, name), T_base_link)
        assert np.abs(error).max() < 1e-6, name


def test_gravity_torque_is_what_mujoco_compensates(arm, simulated):
    model, data = simulated
    q = random_angles(np.random.default_rng(3))
    for joint, angle in zip(DESCRIPTION.arm.joints, q, strict=True):
        data.joint(joint).qpos = angle
    mujoco.mj_forward(model, data)
    dofs = [int(model.joint(joint).dofadr[0]) for joint in DESCRIPTION.arm.joints]
    np.testing.assert_allclose(arm.gravity_torque(q), data.qfrc_gravcomp[dofs], atol=1e-9)


def test_a_tilted_base_changes_the_gravity_torque(arm):
    q = DESCRIPTION.arm.poses["home"]
    tilted = arm.gravity_torque(q, (0.0, 9.81 * np.sin(0.15), -9.81 * np.cos(0.15)))
    assert np.abs(tilted - arm.gravity_torque(q)).max() > 0.1


def test_all_joints_at_half_a_turn_stretch_the_arm_upwards(arm):
    T = arm.fk(np.full(6, np.pi))
    np.testing.assert_allclose(T[:3, :3] @ END_EFFECTOR + T[:3, 3], (0.0, 0.2595, 0.8769), atol=1e-4)


def test_kinovas_home_pose(arm):
    T = arm.fk(DESCRIPTION.arm.poses["home"])
    np.testing.assert_allclose(T[:3, :3] @ END_EFFECTOR + T[:3, 3], (0.2127, -0.2566, 0.507), atol=2e-4)


@pytest.mark.parametrize("seed", range(5))
def test_the_jacobian_is_the_derivative_of_the_pose(arm, seed):
    q, h = random_angles(np.random.default_rng(seed)), 1e-6
    numeric = np.column_stack([pose_error(arm.fk(q + h * e), arm.fk(q - h * e)) / (2 * h) for e in np.eye(6)])
    np.testing.assert_allclose(arm.jacobian(q), numeric, atol=1e-7)


def test_pose_and_jacobian_of_one_pass_are_the_separate_ones(arm):
    q = DESCRIPTION.arm.poses["home"]
    T, J = arm.fk_jacobian(q)
    np.testing.assert_array_equal(T, arm.fk(q))
    np.testing.assert_array_equal(J, arm.jacobian(q))


def test_results_do_not_change_when_the_model_is_used_again(arm):
    q = DESCRIPTION.arm.poses["home"]
    T, J = arm.fk_jacobian(q)
    copies = T.copy(), J.copy()
    arm.fk_jacobian(q + 0.3)
    np.testing.assert_array_equal(T, copies[0])
    np.testing.assert_array_equal(J, copies[1])


def test_a_stretched_arm_is_singular(arm):
    assert arm.sigma_min(np.full(6, np.pi)) < 1e-6
    assert arm.sigma_min(DESCRIPTION.arm.poses["home"]) > 0.05


def test_limits_are_those_of_the_description(arm):
    np.testing.assert_allclose(arm.position_min, DESCRIPTION.arm.position_min, atol=1e-7)
    np.testing.assert_allclose(arm.position_max, DESCRIPTION.arm.position_max, atol=1e-7)
    np.testing.assert_array_equal(arm.torque_max, DESCRIPTION.arm.torque_max)
    assert not arm.within_limits(np.zeros(6))
    assert arm.limit_distance(DESCRIPTION.arm.poses["home"]) == pytest.approx(1.002 - np.radians(19), abs=1e-6)


def test_the_nearest_winding_keeps_the_hand_and_leaves_limited_joints(arm):
    q = np.array([0.1, 2.0, 3.0, -6.0, 9.0, 1.0])
    reference = np.array([6.4, 5.0, 1.0, 0.5, 3.0, -5.0])
    near = arm.nearest_winding(q, reference)
    np.testing.assert_allclose(arm.fk(near), arm.fk(q), atol=1e-12)
    assert np.abs(near - reference)[[0, 3, 4, 5]].max() <= np.pi
    np.testing.assert_array_equal(near[1:3], q[1:3])


@pytest.mark.parametrize("q", [np.zeros(5), np.array([0, 1, 1, 0, 0, np.nan])])
def test_malformed_angles_are_refused(arm, q):
    with pytest.raises(InvalidInput, match="joint angles must be 6 finite numbers"):
        arm.fk(q)
