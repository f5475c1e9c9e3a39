"""Reading chains and shapes from an MJCF."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.kinematics import read_body_pose, read_chain, read_mjcf, read_shapes
from grape.robots.husky_jaco2 import DESCRIPTION

MJCF = DESCRIPTION.mjcf


def test_the_chain_is_read_root_first_with_the_mass_on_the_hand():
    chain = read_chain(MJCF, "arm_base", "hand")
    assert tuple(link.joint for link in chain) == DESCRIPTION.arm.joints
    assert [link.name for link in chain] == ["link_1", "link_2", "link_3", "link_4", "link_5", "hand"]
    carried = sum(body.mass for body in chain[-1].inertias)
    assert 1.1 < carried < 1.4  # hand, camera, scanner and three fingers


@pytest.mark.parametrize(("base", "tip"), [("arm_base", "claw"), ("claw", "hand"), ("hand", "arm_base")])
def test_a_chain_that_is_not_there_is_refused(base, tip):
    with pytest.raises(InvalidInput):
        read_chain(MJCF, base, tip)


def test_a_body_without_its_one_hinge_breaks_the_chain():
    with pytest.raises(InvalidInput, match="needs one hinge"):
        read_chain(MJCF, "base_link", "hand")


def test_every_arm_body_has_a_capsule_and_the_base_has_boxes():
    shapes = read_shapes(MJCF)
    capsules = {shape.body for shape in shapes if shape.kind == "capsule"}
    assert {"link_1", "link_2", "link_3", "link_4", "link_5", "hand", "wrist_camera", "wrist_lidar"} <= capsules
    assert {shape.name for shape in shapes if shape.kind == "box"} >= {"chassis", "deck", "riser", "feeder"}
    assert all(shape.radius > 0.0 for shape in shapes if shape.kind == "capsule")


def test_a_shape_that_planners_cannot_use_is_refused(tmp_path):
    file = tmp_path / "robot.xml"
    file.write_text('<mujoco><worldbody><body name="a"><geom group="3" size="1"/></body></worldbody></mujoco>')
    with pytest.raises(InvalidInput, match="must be a capsule by fromto or a box"):
        read_shapes(file)


def test_a_broken_file_is_refused(tmp_path):
    file = tmp_path / "robot.xml"
    file.write_text("<mujoco>")
    with pytest.raises(InvalidInput, match="cannot read the MJCF"):
        read_shapes(file)


def test_included_files_take_the_place_of_their_include(tmp_path):
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "hand.xml").write_text('<mujoco><body name="hand" pos="0 0 1"/></mujoco>')
    file = tmp_path / "robot.xml"
    file.write_text(
        '<mujoco><worldbody><body name="base" pos="1 0 0"><include file="arm/hand.xml"/></body></worldbody></mujoco>'
    )
    assert read_body_pose(file, "hand", "base")[:3, 3] == pytest.approx([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("include", "expected"), [("gone.xml", "cannot read the MJCF"), ("robot.xml", "robot.xml is included twice")]
)
def test_includes_that_lead_nowhere_are_refused(tmp_path, include, expected):
    file = tmp_path / "robot.xml"
    file.write_text(f'<mujoco><include file="{include}"/></mujoco>')
    with pytest.raises(InvalidInput, match=expected):
        read_mjcf(file)


def test_the_pose_of_a_fixed_body():
    np.testing.assert_allclose(read_body_pose(MJCF, "arm_base", "base_link"), DESCRIPTION.arm.T_base_link_arm_base)
