"""The closed form of the nails agrees with the MJCF and with the measured recipe."""

import mujoco
import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import inverse, pose, transform
from grape.kinematics import HandModel
from grape.robots.husky_jaco2 import DESCRIPTION

HAND = HandModel(DESCRIPTION.gripper)


@pytest.mark.parametrize("q", [0.0, 0.3, 0.675, 0.9, 1.05])
def test_nails_are_where_mujoco_puts_them(q):
    model = mujoco.MjModel.from_xml_path(str(DESCRIPTION.mjcf))
    data = mujoco.MjData(model)
    for joint in DESCRIPTION.gripper.joints:
        data.joint(joint).qpos = q
    mujoco.mj_kinematics(model, data)
    hand = data.body("hand")
    T_hand_world = inverse(pose(hand.xmat.reshape(3, 3), hand.xpos))
    right, left = (transform(T_hand_world, data.body(name).xpos) for name in DESCRIPTION.gripper.nail_bodies)
    np.testing.assert_allclose(right, HAND.nail(q), atol=1e-6)
    np.testing.assert_allclose(left, HAND.nail(q) * (-1, 1, 1), atol=1e-6)
    np.testing.assert_allclose(0.5 * (right + left), HAND.T_hand_nails(q)[:3, 3], atol=1e-6)


def test_opening_takes_the_nails_from_9_to_49_mm_while_they_sweep_108_mm():
    g = DESCRIPTION.gripper
    assert HAND.gap(g.closed_angle) == pytest.approx(0.009, abs=5e-4)
    assert HAND.gap(g.open_angle) == pytest.approx(0.049, abs=5e-4)
    sweep = HAND.T_hand_nails(g.closed_angle)[1, 3] - HAND.T_hand_nails(g.open_angle)[1, 3]
    assert sweep == pytest.approx(0.108, abs=1e-3)


def test_an_angle_that_is_not_finite_is_refused():
    with pytest.raises(InvalidInput, match="finger angle"):
        HAND.nail(float("nan"))
