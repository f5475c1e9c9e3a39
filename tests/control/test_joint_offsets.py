import numpy as np
import pytest

from grape.control.joint_offsets import joint_offsets


@pytest.mark.parametrize("seed", range(3))
def test_offsets_are_found_from_one_exact_hand_pose(arm, q_front, seed):
    bias = np.radians(np.random.default_rng(seed).uniform(-2.5, 2.5, 6))
    assert joint_offsets(arm, q_front + bias, arm.fk(q_front)) == pytest.approx(bias, abs=np.radians(0.1))


def test_a_small_error_of_the_pose_stays_small(arm, q_front):
    T = arm.fk(q_front).copy()
    T[:3, 3] += 3e-4
    assert np.abs(joint_offsets(arm, q_front, T)).max() < np.radians(0.5)
