"""An arm driver that feels what the arm touches: the one place between every action and the joints."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from grape.clock import Clock
from grape.control.contact import ContactObserver
from grape.drivers.ports import ArmDriver
from grape.errors import ActionFailed, InvalidInput, Reason, StaleData
from grape.messages import Array, JointState


@dataclass(frozen=True, kw_only=True)
class TouchOptions:
    """What an arm does when it touches something.

    Args:
        torque_max: (n,) N m from outside, beyond which a motion ends.
        velocity_max: (n,) rad/s, with which it lets go.
        back_s: it lets go towards where it was so long before.
        let_go: share of `torque_max` from which down it has let go ...
        let_go_s: ... and how long it tries.
        gain: 1/s, towards where it was.
    """

    torque_max: Array
    velocity_max: Array
    back_s: float = 0.3
    let_go: float = 0.5
    let_go_s: float = 1.0
    gain: float = 4.0


@dataclass(frozen=True, kw_only=True)
class Touch:
    """What was felt: the joint (from 1) that feels it most, and the torques (n,) N m on all of them."""

    joint: int
    torques: Array


class GuardedArm:
    """Ends a motion against which something outside turns the joints by more than it may.

    A command that nothing speaks against goes through unchanged. Once something is felt, the arm lets go: it turns
    back towards where it came from until the torques have gone, whatever is commanded; then `send` fails with CONTACT.
    What moves the way that the torques turn, away from what is felt, is free. Joint states without torques, or with
    zeros alone, are believed to feel nothing.

    Args:
        arm: the driver behind.
        observer: what is felt, by joint states.
        gravity: (3,) m/s^2 in the arm's base frame, now.
        on_touch: told about each touch when it begins.
        may_touch: whether the hand works by contact now, so that touches are let be.
        on_feel: told with each command what is felt, as a share of what may be, of the joint that feels most.
    """

    def __init__(
        self,
        arm: ArmDriver,
        clock: Clock,
        observer: ContactObserver,
        gravity: Callable[[], Array],
        options: TouchOptions,
        on_touch: Callable[[Touch], None] = lambda touch: None,
        may_touch: Callable[[], bool] = lambda: False,
        on_feel: Callable[[float], None] = lambda share: None,
    ) -> None:
        self._arm, self._clock, self._observer, self._gravity = arm, clock, observer, gravity
        self._options, self._on_touch, self._may_touch, self._on_feel = options, on_touch, may_touch, on_feel
        self._came: deque[JointState] = deque()  # of the last `back_s`
        self._touch: Touch | None = None
        self._since = 0.0
        self._from = np.zeros(0)  # (n,) rad, where it came from when it was touched

    def send(self, velocity: Array) -> Array:
        """Set-point of the joint velocities (n,) rad/s; returns what was sent after limits.

        Raises:
            InvalidInput: wrong shape or not finite.
            ActionFailed: CONTACT, once the arm has let go of what it touched.
        """
        joints = self._options.torque_max.shape
        if np.shape(velocity) != joints or not np.isfinite(velocity).all():
            raise InvalidInput(f"arm: send {joints[0]} finite joint velocities, got {velocity}")
        torques = self._feel()
        self._on_feel(float((np.abs(torques) / self._options.torque_max).max()))
        if self._touch is None:
            self._touch = self._judge(torques, velocity)
            if self._touch is None:
                return self._arm.send(velocity)
            self._since, self._from = self._clock.now(), self._came[0].position
            self._on_touch(self._touch)
        options = self._options
        gone = bool((np.abs(torques) <= options.let_go * options.torque_max).all())
        if gone or self._clock.now() - self._since >= options.let_go_s:
            touch, self._touch = self._touch, None
            raise self._failure(touch, torques, gone)
        back = options.gain * (self._from - self._came[-1].position)
        return self._arm.send(np.clip(back, -options.velocity_max, options.velocity_max))

    def stop(self) -> None:
        """Brake as fast as the acceleration limit allows and hold."""
        self._touch = None
        self._arm.stop()

    def latest(self, max_age_s: float | None = None) -> JointState:
        """Measured joint angles (absolute, never wrapped), speeds and torques."""
        return self._arm.latest(max_age_s)

    def _feel(self) -> Array:
        """Torques (n,) N m from outside, none where they cannot be told; remembers where the arm was."""
        try:
            joints = self._arm.latest()
            torques = self._observer.update(joints, self._gravity())
        except (StaleData, InvalidInput):
            return np.zeros_like(self._options.torque_max)
        if not np.any(joints.effort):
            return np.zeros_like(self._options.torque_max)
        while self._came and not 0.0 <= joints.stamp - self._came[0].stamp <= self._options.back_s:
            self._came.popleft()
        if not self._came or joints.stamp > self._came[-1].stamp:
            self._came.append(joints)
        return torques

    def _judge(self, torques: Array, velocity: Array) -> Touch | None:
        share = np.abs(torques) / self._options.torque_max
        worst = int(share.argmax())
        if share[worst] <= 1.0 or np.dot(velocity, torques) >= 0.0 or self._may_touch():
            return None
        return Touch(joint=worst + 1, torques=torques)

    def _failure(self, touch: Touch, torques: Array, gone: bool) -> ActionFailed:
        k = touch.joint - 1
        told = f"joint {touch.joint} feels {touch.torques[k]:.1f} N m from outside, allowed are "
        still = "" if gone else f"; still {torques[k]:.1f} after {self._options.let_go_s:g} s of letting go"
        return ActionFailed(Reason.CONTACT, f"{told}{self._options.torque_max[k]:g}{still}")
