"""Rigid-body geometry: group axioms, maps and their inverses, what counts as a pose."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import (
    interpolate,
    inverse,
    is_pose,
    pose,
    pose_error,
    quaternion_to_rotation,
    rotation_exp,
    rotation_from_rpy,
    rotation_log,
    rotation_to_quaternion,
    rotation_to_rpy,
    transform,
    wrap_angle,
    yaw_of,
)

RNG = np.random.default_rng(5)
VECTORS = [RNG.normal(size=3) * scale for scale in (1e-9, 1e-3, 0.5, 1.0, 2.0) for _ in range(4)]


def random_pose():
    return pose(rotation_exp(RNG.normal(size=3)), RNG.normal(size=3))


def test_a_pose_times_its_inverse_is_the_identity():
    for _ in range(20):
        T = random_pose()
        assert T @ inverse(T) == pytest.approx(np.eye(4), abs=1e-12)


def test_transform_follows_the_frames():
    T_A_B, T_B_C, p_C = random_pose(), random_pose(), RNG.normal(size=(7, 3))
    assert transform(T_A_B @ T_B_C, p_C) == pytest.approx(transform(T_A_B, transform(T_B_C, p_C)))


@pytest.mark.parametrize("w", VECTORS)
def test_log_undoes_exp_below_half_a_turn(w):
    w = w * min(1.0, 3.1 / np.linalg.norm(w))
    assert rotation_log(rotation_exp(w)) == pytest.approx(w, abs=1e-8)


def test_log_of_half_a_turn_has_length_pi():
    for axis in np.eye(3):
        assert np.linalg.norm(rotation_log(rotation_exp(np.pi * axis))) == pytest.approx(np.pi)


def test_quaternions_and_rpy_come_back():
    for _ in range(50):
        R = rotation_exp(RNG.normal(size=3) * 2)
        q = rotation_to_quaternion(R)
        assert q[0] >= 0 and np.linalg.norm(q) == pytest.approx(1.0)
        assert quaternion_to_rotation(q) == pytest.approx(R, abs=1e-12)
        assert rotation_from_rpy(*rotation_to_rpy(R)) == pytest.approx(R, abs=1e-9)


def test_rpy_at_the_singularity_is_one_of_the_answers():
    for pitch in (np.pi / 2, -np.pi / 2):
        R = rotation_from_rpy(0.3, pitch, -0.8)
        assert rotation_from_rpy(*rotation_to_rpy(R)) == pytest.approx(R, abs=1e-6)


@pytest.mark.parametrize("q", [np.zeros(4), np.array([np.nan, 0, 0, 1.0]), np.array([np.inf, 0, 0, 0])])
def test_a_quaternion_that_is_none_is_refused(q):
    with pytest.raises(InvalidInput):
        quaternion_to_rotation(q)


def test_interpolation_starts_and_ends_at_its_poses():
    A, B = random_pose(), random_pose()
    assert interpolate(A, B, 0.0) == pytest.approx(A)
    assert interpolate(A, B, 1.0) == pytest.approx(B, abs=1e-9)


def test_pose_error_points_from_current_to_target():
    target = pose(rotation_exp(np.array([0, 0, 0.2])), (1.0, 0.0, 0.0))
    assert pose_error(target, np.eye(4)) == pytest.approx([1, 0, 0, 0, 0, 0.2])


def test_angles_wrap_into_the_half_open_turn():
    assert wrap_angle(np.pi) == pytest.approx(np.pi)
    assert wrap_angle(-np.pi) == pytest.approx(np.pi)
    assert wrap_angle(np.array([3 * np.pi / 2, 7.0])) == pytest.approx([-np.pi / 2, 7.0 - 2 * np.pi])


def test_yaw_is_the_heading():
    assert yaw_of(pose(rotation_from_rpy(0.1, -0.1, 1.2))) == pytest.approx(1.2)


def test_what_is_no_pose_is_told_apart():
    mirror = np.diag([1.0, 1.0, -1.0, 1.0])
    nan_rotation, nan_place, scaled, row = np.eye(4), np.eye(4), np.eye(4), np.eye(4)
    nan_rotation[0, 0] = np.nan
    nan_place[0, 3] = np.nan
    scaled[0, 0] = 1.1
    row[3, 0] = 0.5
    assert is_pose(random_pose())
    for T in (mirror, nan_rotation, nan_place, scaled, row, np.eye(3), np.full((4, 4), np.nan)):
        assert not is_pose(T)
