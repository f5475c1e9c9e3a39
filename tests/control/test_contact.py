"""The observer of torques from outside, on an arm of its own model."""

from __future__ import annotations

import numpy as np
import pytest

from grape.control.contact import GRAVITY, ContactObserver
from grape.errors import InvalidInput
from grape.kinematics import ArmModel
from grape.messages import JointState
from grape.robots.husky_jaco2 import DESCRIPTION

ARM = ArmModel.from_mjcf(DESCRIPTION.mjcf)
DT = 0.01


def ride(observer, outside, seconds=1.0, gravity=GRAVITY, dt=DT):
    """Joints swing freely in a sine; the motors do what the motion needs, less what turns the joints from outside."""
    inertia, friction = np.full(6, 2.0), np.full(6, 1.0)
    q0, amplitude, rate = DESCRIPTION.arm.poses["home"], np.full(6, 0.2), 3.0
    for k in range(round(seconds / dt)):
        t = k * dt
        q, dq = q0 + amplitude * np.sin(rate * t), amplitude * rate * np.cos(rate * t)
        effort = (ARM.mass_matrix(q) + np.diag(inertia)) @ (-amplitude * rate**2 * np.sin(rate * t))
        later, sooner = (ARM.mass_matrix(q + s * 1e-5 * dq) for s in (1.0, -1.0))
        change = (later - sooner) / 2e-5 @ dq  # dM/dt dq: momentum that changes with the posture
        effort = effort + change - ARM.momentum_rate(q, dq, gravity) + friction * np.tanh(dq / 0.02) - outside
        observer.update(JointState(stamp=t, name=ARM.joints, position=q, velocity=dq, effort=effort), gravity)
    return observer.torques


def observer():
    return ContactObserver(ARM, np.full(6, 2.0), np.full(6, 1.0))


def test_nothing_is_felt_where_nothing_is():
    assert np.abs(ride(observer(), np.zeros(6))).max() < 0.15


@pytest.mark.parametrize("joint", range(6))
def test_a_torque_from_outside_is_felt_at_its_joint(joint):
    outside = np.zeros(6)
    outside[joint] = -5.0
    assert np.allclose(ride(observer(), outside), outside, atol=0.2)


def test_gravity_leans_with_the_base():
    tilted = (0.0, -1.9, -9.62)
    assert np.abs(ride(observer(), np.zeros(6), gravity=tilted)).max() < 0.15


def test_it_follows_with_its_time_constant():
    outside = np.array([0.0, 8.0, 0.0, 0.0, 0.0, 0.0])
    assert 0.5 < ride(observer(), outside, seconds=0.06)[1] / 8.0 < 0.85


def test_a_slow_driver_is_heard_too():
    outside = np.array([0.0, 8.0, 0.0, 0.0, 0.0, 0.0])
    assert ride(observer(), outside, dt=0.1)[1] == pytest.approx(8.0, abs=2.0)


def test_what_is_not_newer_changes_nothing_and_a_gap_begins_anew():
    watch, zeros = observer(), np.zeros(6)
    ride(watch, np.full(6, 3.0))
    before = watch.torques
    q = DESCRIPTION.arm.poses["home"]
    same = JointState(stamp=0.99, name=ARM.joints, position=q, velocity=zeros, effort=np.full(6, 9.0))
    assert np.array_equal(watch.update(same), before)
    later = JointState(stamp=2.0, name=ARM.joints, position=q, velocity=zeros, effort=np.full(6, 9.0))
    assert not watch.update(later).any()


def test_bad_input_is_refused():
    zeros, bad = np.zeros(6), np.full(6, np.nan)
    with pytest.raises(InvalidInput):
        observer().update(JointState(stamp=0.0, name=ARM.joints, position=zeros, velocity=zeros, effort=bad))
    with pytest.raises(InvalidInput):
        ContactObserver(ARM, np.zeros(5), np.zeros(6))
    with pytest.raises(InvalidInput):
        ContactObserver(ARM, np.zeros(6), np.zeros(6), gain=0.0)


def test_the_mass_matrix_agrees_with_kinetic_energy():
    rng = np.random.default_rng(1)
    for _ in range(5):
        M = ARM.mass_matrix(rng.uniform(-3, 3, 6))
        assert np.allclose(M, M.T) and np.linalg.eigvalsh(M).min() > 0.0
