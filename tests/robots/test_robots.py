"""The descriptions of the robots say the same as their MJCFs, and the machines drive and stand."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from grape.actions.robot import build_robot
from grape.errors import InvalidInput
from grape.geometry import inverse, pose
from grape.robots.husky_jaco2 import DESCRIPTION as HUSKY
from grape.robots.robi_jaco2 import DESCRIPTION as ROBI

on_both = pytest.mark.parametrize("description", [HUSKY, ROBI], ids=lambda description: description.name)
MOUNTS = [pytest.param(d, name, id=f"{d.name}-{name}") for d in (HUSKY, ROBI) for name in sorted(d.mounts)]


@cache
def scene(name):
    """A robot on flat ground."""
    spec = mujoco.MjSpec.from_file(str({d.name: d for d in (HUSKY, ROBI)}[name].mjcf))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1], contype=1, conaffinity=4)
    return spec.compile()


def standing(description):
    """Model and state of a robot with its arm at home."""
    model = scene(description.name)
    data = mujoco.MjData(model)
    arm = description.arm
    for joint, actuator, angle in zip(arm.joints, arm.actuators, arm.poses["home"], strict=True):
        data.joint(joint).qpos = data.actuator(actuator).ctrl = angle
    mujoco.mj_forward(model, data)
    return model, data


def site_pose(data, name):
    site = data.site(name)
    return pose(site.xmat.reshape(3, 3), site.xpos)


def run(model, data, seconds):
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)


@pytest.mark.parametrize(("description", "name"), MOUNTS)
def test_sensor_mounts_are_the_sites_of_the_mjcf(description, name):
    _, data = standing(description)
    mount = description.mounts[name]
    expected = inverse(site_pose(data, mount.parent)) @ site_pose(data, name)
    np.testing.assert_allclose(mount.T_parent_sensor, expected, atol=1e-6)


@on_both
def test_feeder_arm_base_and_markers_are_where_the_description_says(description):
    _, data = standing(description)
    T_base_world = inverse(site_pose(data, "base_link"))
    np.testing.assert_allclose(
        description.feeder.T_base_link_feeder, T_base_world @ site_pose(data, "feeder"), atol=1e-9
    )
    np.testing.assert_allclose(
        description.arm.T_base_link_arm_base, T_base_world @ site_pose(data, "arm_base"), atol=1e-9
    )
    T_feeder_world = inverse(site_pose(data, "feeder"))
    for marker, position in zip(description.feeder.marker_ids, description.feeder.marker_positions, strict=True):
        expected = (T_feeder_world @ site_pose(data, f"marker_{marker}"))[:3, 3]
        np.testing.assert_allclose(position, expected, atol=1e-9)


@on_both
def test_feeder_levels_rise_by_the_pitch(description):
    feeder = description.feeder
    step = feeder.T_base_link_level(3)[:3, 3] - feeder.T_base_link_level(2)[:3, 3]
    np.testing.assert_allclose(step, (0.0, 0.0, feeder.pitch), atol=1e-12)


@on_both
def test_the_camera_has_the_agreed_focal_length(description):
    model, _ = standing(description)
    fovy = np.radians(model.camera("wrist_camera").fovy[0])
    assert 240.0 / np.tan(fovy / 2) == pytest.approx(466.0, abs=0.01)


@on_both
def test_actuators_and_torque_limits_are_those_of_the_description(description):
    model, _ = standing(description)
    for joint, actuator, torque in zip(
        description.arm.joints, description.arm.actuators, description.arm.torque_max, strict=True
    ):
        assert model.jnt_actfrcrange[model.joint(joint).id, 1] == torque
        assert model.actuator(actuator).trnid[0] == model.joint(joint).id
    for joint, high in zip(description.gripper.joints, description.gripper.position_max, strict=True):
        assert model.joint(joint).range[1] == pytest.approx(high)


@on_both
def test_what_is_only_drawn_does_not_touch_and_what_planners_use_is_hidden(description):
    model, _ = standing(description)
    touching = (model.geom_contype | model.geom_conaffinity) > 0
    assert not touching[model.geom_group == 1].any()
    assert set(model.geom_group[1:]) == {0, 1, 2, 3} - {0}
    assert (model.geom_group == 1).sum() < 170


@on_both
def test_the_robot_stands_still_with_its_wheels_held(description):
    model, data = standing(description)
    run(model, data, 1.0)
    start = data.body("base_link").xpos.copy()
    run(model, data, 1.0)
    assert np.abs(data.body("base_link").xpos - start).max() < 2e-4
    assert data.body("base_link").xpos[2] == pytest.approx(description.base.height, abs=1e-3)
    assert data.ncon == 4


@on_both
def test_it_drives_straight_at_the_commanded_speed(description):
    model, data = standing(description)
    for wheel in description.base.wheel_actuators:
        data.actuator(wheel).ctrl = 0.5 / description.base.wheel_radius
    run(model, data, 1.0)
    start = data.body("base_link").xpos.copy()
    run(model, data, 1.0)
    moved = data.body("base_link").xpos - start
    assert moved[0] == pytest.approx(0.5, rel=0.03)
    assert abs(moved[1]) < 0.01


@on_both
def test_it_turns_on_the_spot_by_skidding_as_its_effective_track_says(description):
    model, data = standing(description)
    base, rate = description.base, 0.6
    speed = 0.5 * rate * base.effective_track / base.wheel_radius
    for wheel in base.wheel_actuators:
        data.actuator(wheel).ctrl = -speed if "left" in wheel else speed
    run(model, data, 1.0)
    turned = [data.qvel[5]]
    for _ in range(5):
        run(model, data, 0.2)
        turned.append(data.qvel[5])
    assert np.mean(turned) == pytest.approx(rate, rel=0.15)


@on_both
def test_descriptions_cannot_be_changed(description):
    with pytest.raises(ValueError):
        description.arm.poses["home"][0] = 0.0
    with pytest.raises(KeyError, match="mounted on hand"):
        description.T_base_link_sensor("wrist_lidar")


@pytest.mark.parametrize("name", ["imu_link", "gnss_link"])
def test_a_robot_without_the_mounts_that_it_is_localized_by_is_refused(name):
    mounts = {other: mount for other, mount in HUSKY.mounts.items() if other != name}
    text = f"husky_jaco2 needs a mount {name} on base_link; there are .*velodyne, front_laser"
    with pytest.raises(InvalidInput, match=text):
        build_robot(replace(HUSKY, mounts=mounts))
    with pytest.raises(InvalidInput, match=text):
        build_robot(replace(HUSKY, mounts={**mounts, name: replace(HUSKY.mounts[name], parent="hand")}))


def test_the_arm_stands_alike_on_both_so_that_stops_and_plans_are_worth_the_same():
    def over_ground_and_from_the_side(description):
        x, y, z = description.arm.T_base_link_arm_base[:3, 3]
        return x, description.base.half_width - y, z + description.base.height

    assert over_ground_and_from_the_side(ROBI) == pytest.approx(over_ground_and_from_the_side(HUSKY))
    feeders = [inverse(d.arm.T_base_link_arm_base) @ d.feeder.T_base_link_feeder for d in (HUSKY, ROBI)]
    np.testing.assert_allclose(feeders[0], feeders[1], atol=1e-9)


@on_both
def test_the_footprint_holds_base_and_wheels(description):
    base = description.base
    boxes = build_robot(description).body.boxes
    reach = np.max([np.abs(box.center) + box.half_size for box in boxes], axis=0)[:2]
    wheels = (0.5 * base.wheelbase + base.wheel_radius, 0.5 * base.track)
    assert (np.maximum(reach, wheels) <= np.abs(base.footprint).max(axis=0)).all()
    assert base.half_width <= base.footprint[:, 1].max() < base.half_width + 0.01


def test_robi_is_set_within_the_ranges_of_its_chassis():
    assert 0.25 <= ROBI.base.height <= 0.35
    assert 0.75 <= ROBI.base.track <= 1.2
    assert 0.6 <= ROBI.base.wheelbase <= 1.0


@on_both
def test_wheels_stand_where_wheelbase_and_track_have_them(description):
    model, _ = standing(description)
    base = description.base
    for joint, forward, left in zip(base.wheel_joints, (1, 1, -1, -1), (1, -1, 1, -1), strict=True):
        x, y, _ = model.body(joint).pos
        assert (2 * forward * x, 2 * left * y) == pytest.approx((base.wheelbase, base.track))
        assert model.geom(joint).size[0] == base.wheel_radius


@on_both
def test_zones_begin_at_the_footprint_and_stop_nearer_than_they_slow_down(description):
    base = description.base
    zones = {zone.name: zone for zone in base.zones}
    for way, motion, sign in (("ahead", "forward", 1.0), ("behind", "backward", -1.0)):
        end = (sign * base.footprint[:, 0]).max()
        stop, slow = zones[f"stop {way}"], zones[f"slow {way}"]
        assert stop.motions == slow.motions == (motion,)
        assert stop.speed == 0.0 < slow.speed
        for zone, reach in ((stop, 0.12), (slow, 0.50)):
            ahead = sign * zone.polygon[:, 0]
            assert (ahead.min(), ahead.max()) == pytest.approx((end, end + reach))
            assert np.ptp(zone.polygon[:, 1]) == pytest.approx(np.ptp(base.footprint[:, 1]))
