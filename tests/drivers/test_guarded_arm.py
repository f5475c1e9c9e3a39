"""The guard before the arm's joints, on an arm on paper: its torques are those of its own motion and of a push."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from grape.control.contact import GRAVITY, ContactObserver
from grape.drivers.guarded_arm import GuardedArm, Touch, TouchOptions
from grape.errors import ActionFailed, InvalidInput, Reason, StaleData
from grape.kinematics import ArmModel
from grape.messages import Array, JointState
from grape.robots.husky_jaco2 import DESCRIPTION

ARM = ArmModel.from_mjcf(DESCRIPTION.mjcf)
TOUCH = DESCRIPTION.arm.touch
assert TOUCH is not None
LIMIT, FRICTION, INERTIA = TOUCH.torque_max, TOUCH.friction, TOUCH.motor_inertia
BEAT = 0.01
JOINT_2 = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])


class PaperArm:
    """Joints that follow their set-points at once; motors do what that needs, and what a push from outside needs."""

    def __init__(self, push: Callable[[Array], Array] = lambda q: np.zeros(6)) -> None:
        self.t, self.q, self.dq, self.acceleration = 0.0, DESCRIPTION.arm.poses["home"].copy(), np.zeros(6), np.zeros(6)
        self.push, self.sent, self.told = push, np.zeros(6), True
        self.spoil: Callable[[Array], Array] = lambda effort: effort

    def now(self) -> float:
        return self.t

    def send(self, velocity: Array) -> Array:
        self.sent = np.array(velocity)
        return self.sent

    def stop(self) -> None:
        self.sent = np.zeros(6)

    def latest(self, max_age_s: float | None = None) -> JointState:
        if not self.told:
            raise StaleData("not told")
        needed = (ARM.mass_matrix(self.q) + np.diag(INERTIA)) @ self.acceleration - ARM.momentum_rate(self.q, self.dq)
        effort = self.spoil(needed + FRICTION * np.sign(self.dq) - self.push(self.q))
        return JointState(stamp=self.t, name=ARM.joints, position=self.q, velocity=self.dq, effort=effort)

    def step(self) -> None:
        change = np.clip(self.sent - self.dq, -0.02, 0.02)
        self.acceleration, self.dq = change / BEAT, self.dq + change
        self.q = self.q + self.dq * BEAT
        self.t += BEAT


def wall(joint: int, angle: float, stiffness: float = 4000.0) -> Callable[[Array], Array]:
    """What turns a joint back once it is beyond an angle (rad)."""

    def push(q: Array) -> Array:
        torques = np.zeros(6)
        torques[joint] = -stiffness * max(q[joint] - angle, 0.0)
        return torques

    return push


def guard(arm: PaperArm, touches: list[Touch] | None = None) -> GuardedArm:
    options = TouchOptions(torque_max=LIMIT, velocity_max=DESCRIPTION.arm.set_point_max)
    felt = [] if touches is None else touches
    observer = ContactObserver(ARM, INERTIA, FRICTION)
    return GuardedArm(arm, arm, observer, lambda: np.array(GRAVITY), options, felt.append)


def drive(arm: PaperArm, guarded: GuardedArm, velocity: Array, beats: int) -> int:
    """Beats that were sent before the guard ended the motion."""
    for beat in range(beats):
        try:
            guarded.send(velocity)
        except ActionFailed as failed:
            assert failed.reason == Reason.CONTACT
            guarded.stop()
            return beat
        arm.step()
    return beats


def test_free_motion_passes_unchanged_whatever_its_speed():
    rng = np.random.default_rng(0)
    arm, touches = PaperArm(), []
    guarded = guard(arm, touches)
    for _ in range(20):
        velocity = rng.uniform(-0.6, 0.6, 6)
        for _ in range(40):
            assert guarded.send(velocity) is arm.sent
            assert np.array_equal(arm.sent, velocity)
            arm.step()
    assert not touches


@pytest.mark.parametrize("speed", [0.02, 0.1, 0.5])
def test_an_arm_that_touches_lets_go_and_the_motion_ends(speed):
    start = DESCRIPTION.arm.poses["home"][1]
    touches: list[Touch] = []
    arm = PaperArm(wall(1, start + 0.05))
    guarded = guard(arm, touches)
    assert drive(arm, guarded, speed * JOINT_2, 1000) < 1000
    assert [touch.joint for touch in touches] == [2] and touches[0].torques[1] < -LIMIT[1]
    assert abs(arm.push(arm.q)[1]) <= LIMIT[1]


def test_after_a_touch_the_way_out_is_free_and_the_way_in_is_not():
    arm = PaperArm(lambda q: -20.0 * JOINT_2)  # whatever pushes there goes on pushing
    guarded = guard(arm)
    assert drive(arm, guarded, 0.1 * JOINT_2, 200) < 200
    assert drive(arm, guarded, -0.1 * JOINT_2, 100) == 100
    assert drive(arm, guarded, 0.1 * JOINT_2, 200) < 200


def test_a_touch_that_does_not_end_is_told_as_such():
    arm = PaperArm(lambda q: -20.0 * JOINT_2)
    guarded = guard(arm)
    with pytest.raises(ActionFailed, match=r"joint 2 feels -\d+\.\d N m .* allowed are 12; still -\d+\.\d after 1 s"):
        for _ in range(200):
            guarded.send(0.1 * JOINT_2)
            arm.step()


@pytest.mark.parametrize(
    "spoil", [np.zeros_like, lambda effort: effort * np.nan, lambda effort: effort[:3]], ids=["zeros", "nan", "three"]
)
def test_an_arm_that_tells_no_torques_feels_nothing(spoil):
    arm = PaperArm(wall(1, DESCRIPTION.arm.poses["home"][1] + 0.02))
    arm.spoil = spoil
    assert drive(arm, guard(arm), 0.1 * JOINT_2, 200) == 200


def test_work_by_contact_is_let_be_until_it_is_over():
    arm, touches = PaperArm(wall(1, DESCRIPTION.arm.poses["home"][1] + 0.02)), []
    options = TouchOptions(torque_max=LIMIT, velocity_max=DESCRIPTION.arm.set_point_max)
    works = [True]
    observer, shares = ContactObserver(ARM, INERTIA, FRICTION), []
    guarded = GuardedArm(
        arm, arm, observer, lambda: np.array(GRAVITY), options, touches.append, lambda: works[0], shares.append
    )
    assert drive(arm, guarded, 0.05 * JOINT_2, 60) == 60 and not touches
    assert max(shares[:30]) < 0.1
    assert shares[-1] == pytest.approx(np.abs(observer.torques / LIMIT).max()) and shares[-1] > 1.0
    works[0] = False
    assert drive(arm, guarded, 0.05 * JOINT_2, 60) < 60 and touches


@pytest.mark.parametrize("velocity", [np.full(6, np.nan), np.full(6, np.inf), np.zeros(3)], ids=["nan", "inf", "three"])
def test_a_set_point_that_is_no_number_does_not_reach_the_arm(velocity):
    arm = PaperArm()
    guarded = guard(arm)
    guarded.send(0.1 * JOINT_2)
    with pytest.raises(InvalidInput, match="arm: send 6 finite joint velocities"):
        guarded.send(velocity)
    assert np.array_equal(arm.sent, 0.1 * JOINT_2)


def test_an_arm_that_tells_nothing_is_driven_as_before():
    arm = PaperArm()
    arm.told = False
    assert drive(arm, guard(arm), 0.1 * JOINT_2, 50) == 50


def test_a_pause_between_two_motions_is_no_touch():
    arm = PaperArm()
    guarded = guard(arm)
    for _ in range(5):
        assert drive(arm, guarded, 0.3 * JOINT_2, 40) == 40
        guarded.stop()
        for _ in range(60):
            arm.step()
        assert drive(arm, guarded, -0.3 * JOINT_2, 40) == 40
