"""The description of the Husky with a Jaco2 says the same as its MJCF, and the machine drives and stands."""

from functools import cache

import mujoco
import numpy as np
import pytest

from grape.geometry import inverse, pose
from grape.robots.husky_jaco2 import DESCRIPTION


@cache
def scene():
    """The robot on flat ground with its arm at home."""
    spec = mujoco.MjSpec.from_file(str(DESCRIPTION.mjcf))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1], contype=1, conaffinity=4)
    return spec.compile()


@pytest.fixture
def robot():
    model = scene()
    data = mujoco.MjData(model)
    for joint, actuator, angle in zip(
        DESCRIPTION.arm.joints, DESCRIPTION.arm.actuators, DESCRIPTION.arm.poses["home"], strict=True
    ):
        data.joint(joint).qpos = data.actuator(actuator).ctrl = angle
    mujoco.mj_forward(model, data)
    return model, data


def site_pose(data, name):
    site = data.site(name)
    return pose(site.xmat.reshape(3, 3), site.xpos)


def run(model, data, seconds):
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)


@pytest.mark.parametrize("name", sorted(DESCRIPTION.mounts))
def test_sensor_mounts_are_the_sites_of_the_mjcf(robot, name):
    _, data = robot
    mount = DESCRIPTION.mounts[name]
    expected = inverse(site_pose(data, mount.parent)) @ site_pose(data, name)
    np.testing.assert_allclose(mount.T_parent_sensor, expected, atol=1e-6)


def test_feeder_arm_base_and_markers_are_where_the_description_says(robot):
    _, data = robot
    T_base_world = inverse(site_pose(data, "base_link"))
    np.testing.assert_allclose(
        DESCRIPTION.feeder.T_base_link_feeder, T_base_world @ site_pose(data, "feeder"), atol=1e-9
    )
    np.testing.assert_allclose(
        DESCRIPTION.arm.T_base_link_arm_base, T_base_world @ site_pose(data, "arm_base"), atol=1e-9
    )
    T_feeder_world = inverse(site_pose(data, "feeder"))
    for marker, position in zip(DESCRIPTION.feeder.marker_ids, DESCRIPTION.feeder.marker_positions, strict=True):
        expected = (T_feeder_world @ site_pose(data, f"marker_{marker}"))[:3, 3]
        np.testing.assert_allclose(position, expected, atol=1e-9)


def test_feeder_levels_rise_by_the_pitch():
    feeder = DESCRIPTION.feeder
    step = feeder.T_base_link_level(3)[:3, 3] - feeder.T_base_link_level(2)[:3, 3]
    np.testing.assert_allclose(step, (0.0, 0.0, feeder.pitch), atol=1e-12)


def test_the_camera_has_the_agreed_focal_length(robot):
    model, _ = robot
    fovy = np.radians(model.camera("wrist_camera").fovy[0])
    assert 240.0 / np.tan(fovy / 2) == pytest.approx(466.0, abs=0.01)


def test_actuators_and_torque_limits_are_those_of_the_description(robot):
    model, _ = robot
    for joint, actuator, torque in zip(
        DESCRIPTION.arm.joints, DESCRIPTION.arm.actuators, DESCRIPTION.arm.torque_max, strict=True
    ):
        assert model.jnt_actfrcrange[model.joint(joint).id, 1] == torque
        assert model.actuator(actuator).trnid[0] == model.joint(joint).id
    for joint, high in zip(DESCRIPTION.gripper.joints, DESCRIPTION.gripper.position_max, strict=True):
        assert model.joint(joint).range[1] == pytest.approx(high)


def test_what_is_only_drawn_does_not_touch_and_what_planners_use_is_hidden(robot):
    model, _ = robot
    touching = (model.geom_contype | model.geom_conaffinity) > 0
    assert not touching[model.geom_group == 1].any()
    assert set(model.geom_group[1:]) == {0, 1, 2, 3} - {0}
    assert (model.geom_group == 1).sum() < 145


def test_the_robot_stands_still_with_its_wheels_held(robot):
    model, data = robot
    run(model, data, 1.0)
    start = data.body("base_link").xpos.copy()
    run(model, data, 1.0)
    assert np.abs(data.body("base_link").xpos - start).max() < 2e-4
    assert data.body("base_link").xpos[2] == pytest.approx(0.132, abs=1e-3)
    assert data.ncon == 4


def test_it_drives_straight_at_the_commanded_speed(robot):
    model, data = robot
    for wheel in DESCRIPTION.base.wheel_actuators:
        data.actuator(wheel).ctrl = 0.5 / DESCRIPTION.base.wheel_radius
    run(model, data, 1.0)
    start = data.body("base_link").xpos.copy()
    run(model, data, 1.0)
    moved = data.body("base_link").xpos - start
    assert moved[0] == pytest.approx(0.5, rel=0.03)
    assert abs(moved[1]) < 0.01


def test_it_turns_on_the_spot_by_skidding_as_its_effective_track_says(robot):
    model, data = robot
    base, rate = DESCRIPTION.base, 0.6
    speed = 0.5 * rate * base.effective_track / base.wheel_radius
    for wheel in base.wheel_actuators:
        data.actuator(wheel).ctrl = -speed if "left" in wheel else speed
    run(model, data, 1.0)
    turned = [data.qvel[5]]
    for _ in range(5):
        run(model, data, 0.2)
        turned.append(data.qvel[5])
    assert np.mean(turned) == pytest.approx(rate, rel=0.15)


def test_descriptions_cannot_be_changed():
    with pytest.raises(ValueError):
        DESCRIPTION.arm.poses["home"][0] = 0.0
    with pytest.raises(KeyError, match="mounted on hand"):
        DESCRIPTION.T_base_link_sensor("wrist_lidar")
