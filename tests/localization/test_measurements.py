from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import rotation_from_rpy, rotation_to_quaternion
from grape.localization import (
    GnssConfig,
    ImuConfig,
    WheelConfig,
    components,
    from_gnss,
    from_imu,
    from_wheels,
)
from grape.messages import Imu, JointState, NavSatFix

NAMES = ("wheel_front_left", "wheel_front_right", "wheel_rear_left", "wheel_rear_right")


def wheels(stamp: float, left: float, right: float, names=NAMES) -> JointState:
    angles = np.array([left, right, left, right])
    return JointState(stamp=stamp, name=names, position=angles, velocity=np.zeros(4), effort=np.zeros(4))


def imu(stamp: float, R: np.ndarray, rates=(0.0, 0.0, 0.0), acceleration=(0.0, 0.0, 9.80665)) -> Imu:
    return Imu(
        stamp=stamp,
        orientation=rotation_to_quaternion(R),
        angular_velocity=np.array(rates),
        linear_acceleration=np.array(acceleration),
    )


def test_wheels_give_forward_speed_and_yaw_rate_by_the_effective_track():
    config = WheelConfig(wheel_radius=0.2, effective_track=1.0)
    m = from_wheels(wheels(0.0, 0.0, 0.0), wheels(0.1, 0.5, 1.0), config)
    by_name = dict(zip(m.index.tolist(), m.value.tolist(), strict=True))
    assert by_name[6] == pytest.approx(1.5)
    assert by_name[7] == 0.0
    assert by_name[11] == pytest.approx(1.0)


def test_standing_wheels_say_that_nothing_moves_and_say_it_firmly():
    config = WheelConfig()
    m = from_wheels(wheels(0.0, 3.0, 3.0), wheels(0.02, 3.0, 3.0), config)
    assert m.index.tolist() == [6, 7, 8, 9, 10, 11]
    assert np.allclose(m.value, 0.0)
    assert np.allclose(np.diag(m.covariance), config.still_std**2)


def test_turning_wheels_are_trusted_less():
    config = WheelConfig()
    straight = from_wheels(wheels(0.0, 0.0, 0.0), wheels(0.1, 0.3, 0.3), config)
    turning = from_wheels(wheels(0.0, 0.0, 0.0), wheels(0.1, -0.3, 0.9), config)
    assert (np.diag(turning.covariance) > np.diag(straight.covariance)).all()


def test_wheels_that_spin_are_hardly_believed_and_wheels_that_skid_as_expected_as_before():
    config, before, now = WheelConfig(), wheels(0.0, 0.0, 0.0), wheels(0.1, 0.0, 1.0)
    rate = 1.0 / 0.1 * config.wheel_radius / config.effective_track
    told = [from_wheels(before, now, config, yaw_rate=share * rate) for share in (1.0, 0.7, 0.2)]
    vx = [float(np.sqrt(m.covariance[0, 0])) for m in told]
    assert np.array_equal(told[0].covariance, from_wheels(before, now, config).covariance)
    assert vx[1] == vx[0] and vx[2] > 10 * vx[0]


def test_wheels_without_a_side_in_their_names_are_refused():
    with pytest.raises(InvalidInput, match="left"):
        from_wheels(wheels(0.0, 0, 0, ("a", "b", "c", "d")), wheels(0.1, 1, 1, ("a", "b", "c", "d")), WheelConfig())


def test_wheel_stamps_that_do_not_increase_are_refused():
    with pytest.raises(InvalidInput, match="increase"):
        from_wheels(wheels(1.0, 0, 0), wheels(1.0, 0, 0), WheelConfig())


def test_imu_mounting_is_taken_out():
    R_map_base = rotation_from_rpy(0.1, -0.2, 1.2)
    R_base_imu = rotation_from_rpy(0.0, -np.pi / 2, np.pi)
    rates_base = np.array([0.1, 0.2, 0.3])
    m = from_imu(imu(0.0, R_map_base @ R_base_imu, R_base_imu.T @ rates_base), ImuConfig(R_base_imu=R_base_imu))
    assert np.allclose(m.value, [0.1, -0.2, 1.2, *rates_base])


def test_gravity_is_removed_from_accelerations():
    R = rotation_from_rpy(0.2, 0.1, -2.0)
    felt = R.T @ [0.0, 0.0, 9.80665] + [0.5, 0.0, 0.0]
    config = ImuConfig(components=components("ax", "ay", "az"))
    assert np.allclose(from_imu(imu(0.0, R, acceleration=felt), config).value, [0.5, 0.0, 0.0], atol=1e-9)


def test_differential_attitude_gives_rates_and_no_angles():
    config = ImuConfig(differential=True, components=components("roll", "pitch", "yaw"))
    before, after = imu(0.0, rotation_from_rpy(0, 0, 0.3)), imu(0.1, rotation_from_rpy(0, 0, 0.35))
    m = from_imu(after, config, before)
    assert m.index.tolist() == [9, 10, 11]
    assert np.allclose(m.value, [0.0, 0.0, 0.5])


def test_differential_attitude_without_a_message_before_is_refused():
    with pytest.raises(InvalidInput, match="before"):
        from_imu(imu(0.0, np.eye(3)), ImuConfig(differential=True))


def test_gnss_gives_the_antenna_in_map_with_its_lever(fix, datum):
    m = from_gnss(fix(0.0, np.array([5.0, -3.0, 0.4]), np.eye(3), np.zeros(3)), datum, GnssConfig())
    assert np.allclose(m.value - m.lever, [5.0, -3.0, 0.4], atol=1e-6)


def test_gnss_can_be_limited_to_x_and_y(fix, datum):
    config = GnssConfig(components=components("x", "y"))
    assert from_gnss(fix(0.0, np.zeros(3), np.eye(3), np.zeros(3)), datum, config).index.tolist() == [0, 1]


def test_float_solution_is_trusted_less_than_its_covariance_says(fix, datum):
    config = GnssConfig(float_factor=3.0)
    fixed = from_gnss(fix(0.0, np.zeros(3), np.eye(3), np.zeros(3), std=0.2), datum, config)
    floating = from_gnss(fix(0.0, np.zeros(3), np.eye(3), np.zeros(3), status="float", std=0.2), datum, config)
    assert np.allclose(floating.covariance, 9.0 * fixed.covariance)


@pytest.mark.parametrize("status", ["none", "good"])
def test_gnss_without_a_usable_status_is_refused(fix, datum, status):
    message: NavSatFix = fix(0.0, np.zeros(3), np.eye(3), np.zeros(3), status=status)
    with pytest.raises(InvalidInput, match=status):
        from_gnss(message, datum, GnssConfig())
