"""The simulated arm: follows joint velocities under its speed and acceleration limits, and holds when nobody speaks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, JointState
from grape.sim.arm_errors import draw_arm_errors
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.physics import STEP_S, STEPS_PER_SECOND, Physics
from grape.sim.sensors.noise import FrameNoise


@dataclass(frozen=True, kw_only=True)
class ArmLimits:
    """Joints of an arm in order, how far and fast they may move (n,) rad, rad/s, rad/s^2, and how long unattended."""

    joints: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    timeout_s: float  # after the last set-point, from which on they hold


@dataclass(frozen=True, kw_only=True)
class ArmDriverOptions:
    """Behaviour of the arm's own controller, and how imperfect the arm is (`draw_arm_errors`)."""

    beat_s: float = 0.01  # time between set-points that acceleration limits are counted over
    lead: float = 0.05  # rad that the reference may run ahead of the measured angle
    encoder_sigma: float = 1e-4  # rad
    torque_sigma: float = 0.2  # N m
    errors: float = 0.0  # level: 0 for a perfect arm, 1 for one as bad as the measured one


class SimulatedArm(SampledSensor[JointState]):
    """Position actuators that follow an integrated velocity reference, with gravity compensated as in the real arm.

    The controller lives on the motors' side of the gears and knows what its encoders tell. With errors, a link turns
    as its motor does once the play of the gear is used up, and the encoder is off by its bias.
    """

    STATE = (*SampledSensor.STATE, "_target", "_velocity", "_reference", "_link", "_last_send")

    def __init__(self, physics: Physics, limits: ArmLimits, seed: int, options: ArmDriverOptions) -> None:
        super().__init__(physics, "arm", options.beat_s)
        self._limits = limits
        self._options = options
        self._noise, self._torque_noise = FrameNoise(seed, "arm"), FrameNoise(seed, "arm_torque")
        self._qpos = physics.joint_qpos(limits.joints)
        self._qvel = physics.joint_qvel(limits.joints)
        self._actuators = physics.actuators(limits.joints)
        self._errors = draw_arm_errors(self._noise.constant(), len(limits.joints), options.errors)
        gain, bias = physics.model.actuator_gainprm, physics.model.actuator_biasprm
        self._stiffness = gain[self._actuators, 0]
        self._lead_s = -bias[self._actuators, 2] / self._stiffness * (1.0 - self._errors.trailing)
        self._timeout_steps = round(limits.timeout_s * STEPS_PER_SECOND)
        self._target = np.zeros(len(limits.joints))
        self._velocity = np.zeros(len(limits.joints))
        self._link = physics.data.qpos[self._qpos].copy()  # where the gear puts the link
        self._reference = self._link + self._errors.bias  # of the motor, by its encoder
        self._last_send = -self._timeout_steps
        rates = np.broadcast_to(self._errors.rate, len(limits.joints))
        self._joints = list(
            zip(limits.lower.tolist(), limits.upper.tolist(), limits.acceleration.tolist(), rates.tolist(), strict=True)
        )
        self._held = False  # whether the actuators have been told where the arm stands still

    def send(self, velocity: Array) -> Array:
        """Set-point of the joint velocities (n,) rad/s; returns what was sent after speed and acceleration limits.

        Raises:
            InvalidInput: wrong shape or not finite.
        """
        wanted = np.array(velocity, dtype=float)
        if wanted.shape != self._velocity.shape or not np.isfinite(wanted).all():
            raise InvalidInput(f"arm: send {self._velocity.shape[0]} finite joint velocities, got {velocity}")
        reach = self._limits.acceleration * self._options.beat_s
        fast = np.clip(wanted, -self._limits.velocity, self._limits.velocity)
        self._target = np.clip(fast, self._velocity - reach, self._velocity + reach)
        self._last_send = self._physics.clock.step
        return self._target.copy()

    def stop(self) -> None:
        """Brake as fast as the acceleration limit allows and hold."""
        self._target[:] = 0.0
        self._last_send = self._physics.clock.step - self._timeout_steps

    def actuate(self) -> None:
        """Move the reference by one physics step and hand it to the actuators."""
        if self._physics.clock.step - self._last_send >= self._timeout_steps:
            self._target[:] = 0.0
        if self._target.any() or self._velocity.any():
            self._move(self._physics.data.qpos[self._qpos])
            motor, half_play = self._reference - self._errors.bias, 0.5 * self._errors.play
            self._link = np.minimum(np.maximum(self._link, motor - half_play), motor + half_play)
        elif self._held:
            return
        self._held = not self._velocity.any()
        # A position servo with damping trails a moving reference by damping / stiffness x speed: ask for so much more.
        self._physics.data.ctrl[self._actuators] = self._link + self._lead_s * self._velocity

    def _encoders(self, links: Array) -> Array:
        """What the encoders tell when the links are at angles (n,) rad: the motors', which the play parts from them."""
        return links + (self._reference - self._link)

    def _move(self, links: Array) -> None:
        """Move the motors' reference by one step, joint by joint: on six numbers that is faster than with arrays."""
        states = zip(
            self._joints,
            self._target.tolist(),
            self._velocity.tolist(),
            self._reference.tolist(),
            self._encoders(links).tolist(),
            strict=True,
        )
        lead = self._options.lead
        velocities: list[float] = []
        references: list[float] = []
        for (lower, upper, acceleration, rate), target, velocity, reference, measured in states:
            change = acceleration * STEP_S
            wanted = velocity + min(max(target - velocity, -change), change)
            room_up = math.sqrt(2 * acceleration * max(upper - reference, 0.0))
            room_down = math.sqrt(2 * acceleration * max(reference - lower, 0.0))
            velocity = min(max(wanted, -room_down), room_up)
            ahead = reference + velocity * (1.0 + rate) * STEP_S
            ahead = min(max(ahead, measured - lead), measured + lead)
            velocities.append(velocity)
            references.append(min(max(ahead, lower), upper))
        self._velocity, self._reference = np.array(velocities), np.array(references)

    def _snapshot(self) -> tuple[Array, Array, Array]:
        data = self._physics.data
        velocity = data.qvel[self._qvel]
        # What acted in the last step is what the servos ask for where the joints are at its end: the integrator is
        # implicit in position.
        effort = data.qfrc_actuator[self._qvel] - self._stiffness * STEP_S * velocity
        return self._encoders(data.qpos[self._qpos]), velocity, effort

    def _measure(self, index: int, stamp: float, snapshot: tuple[Array, Array, Array]) -> JointState:
        position, velocity, effort = snapshot
        noise = self._noise.normal(index, 2 * position.size).reshape(2, -1) * self._options.encoder_sigma
        return JointState(
            stamp=stamp,
            name=self._limits.joints,
            position=position + noise[0],
            velocity=velocity + 10.0 * noise[1],
            effort=effort + self._options.torque_sigma * self._torque_noise.normal(index, effort.size),
        )
