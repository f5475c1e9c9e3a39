import numpy as np
import pytest

from grape.control import DifferentialIk, DifferentialIkOptions, damped_inverse, shift_twist
from grape.errors import InvalidInput
from grape.geometry import pose_error
from grape.kinematics import ROTATION_WEIGHT

from .conftest import VELOCITY

SLOW = np.array([0.01, 0.005, -0.01, 0.05, 0.0, -0.05])


def test_the_hand_moves_as_asked(arm, q_front):
    command = DifferentialIk.for_arm(arm, VELOCITY).solve(q_front, SLOW)
    moved = pose_error(arm.fk(q_front + 1e-4 * command.velocity), arm.fk(q_front)) / 1e-4
    assert np.allclose(moved, SLOW, atol=1e-4)
    assert command.scale == 1.0
    assert not command.held_joints


def test_too_fast_a_wish_is_scaled_as_a_whole(arm, q_front):
    command = DifferentialIk.for_arm(arm, VELOCITY).solve(q_front, np.array([3.0, 0, 4.0, 0, 0, 0]))
    achieved = arm.jacobian(q_front) @ command.velocity
    assert np.linalg.norm(achieved[:3]) <= 0.15 + 1e-9
    assert (np.abs(command.velocity) <= VELOCITY + 1e-12).all()
    assert np.allclose(achieved[:3] / np.linalg.norm(achieved[:3]), [0.6, 0, 0.8], atol=1e-6)
    assert command.scale == pytest.approx(np.linalg.norm(achieved[:3]) / 5.0)


def test_near_a_singularity_speeds_stay_small():
    J = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 1e-6])
    velocity, sigma = damped_inverse(J, np.array([0, 0, 0, 0, 0, 0.1]), 0.02)
    assert sigma == pytest.approx(ROTATION_WEIGHT * 1e-6)
    assert abs(velocity[5]) < 1e-3
    exact, _ = damped_inverse(np.eye(6), SLOW, 0.02)
    assert np.allclose(exact, SLOW)


@pytest.mark.parametrize("joints", [5, 6, 7])
def test_damped_velocities_are_those_of_the_singular_value_decomposition(joints):
    rng = np.random.default_rng(joints)
    for flat in (1.0, 1e-2, 1e-9, 0.0):
        J, twist = rng.normal(size=(6, joints)), rng.normal(size=6)
        J[:, -1] = flat * J[:, -1] + (1.0 - flat) * J[:, 0]
        weights = np.array([1.0, 1.0, 1.0, *3 * [ROTATION_WEIGHT]])
        U, sigma, Vt = np.linalg.svd(weights[:, None] * J, full_matrices=False)
        damping = max(0.02**2 - sigma[-1] ** 2, 0.0)
        expected = Vt.T @ (sigma / np.maximum(sigma**2 + damping, 1e-12) * (U.T @ (weights * twist)))
        velocity, smallest = damped_inverse(J, twist, 0.02)
        assert smallest == pytest.approx(sigma[-1], abs=1e-12)
        np.testing.assert_allclose(velocity, expected, rtol=1e-10, atol=1e-10)


def test_a_joint_at_its_limit_is_not_pushed_further(arm, q_front):
    solver = DifferentialIk.for_arm(arm, VELOCITY)
    q = q_front.copy()
    q[2] = arm.position_min[2] + 0.05
    pushes = [solver.solve(q, sign * SLOW) for sign in (1.0, -1.0)]
    assert sorted(bool(command.held_joints) for command in pushes) == [False, True]
    assert all(command.velocity[2] >= 0.0 for command in pushes)


def test_motion_stops_before_an_obstacle_but_may_leave_it(arm, q_front):
    wall = arm.fk(q_front)[0, 3] + 0.012
    solver = DifferentialIk.for_arm(arm, VELOCITY, clearance=lambda q: wall - arm.fk(q)[0, 3])
    slowed = solver.solve(q_front, np.array([0.05, 0, 0, 0, 0, 0]))
    stopped = solver.solve(q_front, np.array([0.10, 0, 0, 0, 0, 0]))
    leaving = solver.solve(q_front, np.array([-0.05, 0, 0, 0, 0, 0]))
    assert 0.0 < slowed.scale < 0.2
    assert not stopped.velocity.any()
    assert leaving.scale == 1.0


def test_shifting_a_twist_agrees_with_a_rigid_motion():
    twist, lever = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), np.array([0.0, -0.1, 0.2])
    shifted = shift_twist(twist, np.zeros(3), lever)
    assert np.allclose(shifted[:3], twist[:3] + np.cross(twist[3:], lever))
    assert np.allclose(shift_twist(shifted, lever, np.zeros(3)), twist)


@pytest.mark.parametrize("twist", [np.zeros(5), np.full(6, np.nan)])
def test_a_malformed_twist_is_refused(arm, q_front, twist):
    with pytest.raises(InvalidInput):
        DifferentialIk.for_arm(arm).solve(q_front, twist)


def test_a_stop_distance_beyond_the_slow_distance_is_refused():
    with pytest.raises(InvalidInput):
        DifferentialIkOptions(clearance_slow_m=0.01, clearance_stop_m=0.02)


def test_motion_slows_towards_a_singularity_and_halts_but_may_leave_it(arm, q_front):
    sigma = arm.sigma_min(q_front)
    J, twists = arm.jacobian(q_front), []
    for sign in (1.0, -1.0):  # along which joint motion the arm comes nearer to a singularity
        gradient = np.array([arm.sigma_min(q_front + 1e-4 * e) - sigma for e in np.eye(6)])
        twists.append(J @ (-sign * 0.3 * gradient / np.linalg.norm(gradient)))

    def solve(slow, stop, twist):
        options = DifferentialIkOptions(sigma_slow=slow, sigma_stop=stop, damping_sigma=1e-6)
        return DifferentialIk.for_arm(arm, VELOCITY, options).solve(q_front, twist)

    towards, away = twists
    slowed = solve(1.2 * sigma, 0.5 * sigma, towards)
    halted = solve(1.2 * sigma, 1.1 * sigma, towards)
    assert 0.0 < slowed.scale < solve(0.1 * sigma, 0.0, towards).scale
    assert slowed.hindrance == halted.hindrance == "singularity"
    assert not halted.velocity.any()
    assert solve(1.2 * sigma, 1.1 * sigma, away).hindrance == ""


def test_an_obstacle_is_named_as_what_hinders(arm, q_front):
    solver = DifferentialIk.for_arm(arm, VELOCITY, clearance=lambda q: 0.004)
    command = solver.solve(q_front, SLOW)
    assert command.hindrance == "obstacle" and not command.velocity.any()
