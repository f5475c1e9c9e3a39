import numpy as np
import pytest

from grape.control.joint_offsets import joint_offsets
from grape.errors import InvalidInput


@pytest.mark.parametrize("seed", range(3))
def test_offsets_are_found_from_one_exact_hand_pose(arm, q_front, seed):
    bias = np.radians(np.random.default_rng(seed).uniform(-2.5, 2.5, 6))
    assert joint_offsets(arm, q_front + bias, arm.fk(q_front)) == pytest.approx(bias, abs=np.radians(0.1))


def test_a_small_error_of_the_pose_stays_small(arm, q_front):
    T = arm.fk(q_front).copy()
    T[:3, 3] += 3e-4
    assert np.abs(joint_offsets(arm, q_front, T)).max() < np.radians(0.5)


def test_poses_in_several_postures_show_offsets_that_hold_everywhere(arm, q_front):
    rng = np.random.default_rng(5)
    bias = np.radians(rng.uniform(-2.5, 2.5, 6))
    postures = q_front + rng.uniform(-0.3, 0.3, (7, 6))
    poses = np.array([arm.fk(q) for q in postures])
    poses[:, :3, 3] += rng.normal(0.0, 5e-4, (7, 3))
    offsets = joint_offsets(arm, postures + bias, poses, np.full(6, 1.5e-3))
    assert offsets == pytest.approx(bias, abs=np.radians(0.25))


def test_each_pose_needs_its_posture(arm, q_front):
    with pytest.raises(InvalidInput, match="2 postures need as many hand poses, got 1"):
        joint_offsets(arm, np.array([q_front, q_front]), arm.fk(q_front))
