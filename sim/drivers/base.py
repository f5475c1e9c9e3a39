"""The simulated base: body velocities become wheel speeds, and encoders tell how far the wheels turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, JointState, Twist
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.physics import STEP_S, STEPS_PER_SECOND, Physics
from grape.sim.sensors.noise import FrameNoise


@dataclass(frozen=True, kw_only=True)
class BaseOptions:
    """Wheels, geometry and limits of a skid-steered base."""

    left: tuple[str, ...]  # wheel joints
    right: tuple[str, ...]
    names: tuple[str, ...]  # every wheel joint, in the order that the driver reports
    wheel_radius: float  # m
    effective_track: float  # m between ideal wheels that would turn the base as the skidding ones do
    ticks_per_metre: float
    max_linear: float = 1.0  # m/s, of every wheel too
    max_angular: float = 2.0  # rad/s
    linear_acceleration: float = 1.0  # m/s^2
    angular_acceleration: float = 2.0  # rad/s^2
    timeout_s: float = 0.25
    period_s: float = 0.02
    encoder_scale_sigma: float = 0.001  # relative error of each wheel's radius, constant during a run
    hold_gain: float = 20.0  # 1/s, pulls a wheel back to the angle that its speeds add up to
    hold_lead: float = 0.05  # rad, most that a wheel may lag
    sharing_s: float = 0.5  # time in which the wheels of a parked base share their load


class SimulatedBase(SampledSensor[JointState]):
    """Wheels driven by velocity servos that also hold their angle (the integral part of a motor controller)."""

    STATE = (*SampledSensor.STATE, "_target", "_linear", "_angular", "_reference", "_last_send", "_previous")

    def __init__(self, physics: Physics, seed: int, options: BaseOptions) -> None:
        super().__init__(physics, "base", options.period_s)
        self._options = options
        self._qpos = physics.joint_qpos(options.names)
        self._actuators = physics.actuators(options.names)
        self._side = tuple(-1.0 if name in options.left else 1.0 for name in options.names)
        scale = FrameNoise(seed, "base").constant().standard_normal(len(options.names))
        self._scale = 1.0 + options.encoder_scale_sigma * scale
        self._timeout_steps = round(options.timeout_s * STEPS_PER_SECOND)
        self._last_send = -self._timeout_steps
        self._target = (0.0, 0.0)
        self._linear = self._angular = 0.0
        self._reference: tuple[float, ...] = tuple(physics.data.qpos[self._qpos].tolist())
        self._previous = self._ticks()

    def send(self, linear_x: float, angular_z: float) -> Twist:
        """Set-point of the body velocity (m/s, rad/s); returns what was sent after limits.

        Raises:
            InvalidInput: a value is not finite.
        """
        if not (np.isfinite(linear_x) and np.isfinite(angular_z)):
            raise InvalidInput(f"base: send finite velocities, got {linear_x} m/s and {angular_z} rad/s")
        options = self._options
        v = float(np.clip(linear_x, -options.max_linear, options.max_linear))
        w = float(np.clip(angular_z, -options.max_angular, options.max_angular))
        self._target = (v, w)
        self._last_send = self._physics.clock.step
        return Twist(
            stamp=self._physics.clock.now(),
            frame_id="base_link",
            linear=np.array([v, 0.0, 0.0]),
            angular=np.array([0.0, 0.0, w]),
        )

    def stop(self) -> None:
        """Brake now and hold."""
        self._target = (0.0, 0.0)
        self._last_send = self._physics.clock.step - self._timeout_steps

    def actuate(self) -> None:
        """Move the wheels' reference by one physics step and hand it to the actuators."""
        options = self._options
        if self._physics.clock.step - self._last_send >= self._timeout_steps:
            self._target = (0.0, 0.0)
        self._linear = _towards(self._linear, self._target[0], options.linear_acceleration * STEP_S)
        self._angular = _towards(self._angular, self._target[1], options.angular_acceleration * STEP_S)
        turning = 0.5 * options.effective_track * self._angular
        fastest = options.max_linear / options.wheel_radius
        radius, lead, data = options.wheel_radius, options.hold_lead, self._physics.data
        # Plain numbers: on so few wheels each operation on arrays costs more than all of these.
        wheels = data.qpos[self._qpos].tolist()
        speeds = [min(max((self._linear + side * turning) / radius, -fastest), fastest) for side in self._side]
        lags = [
            min(max(reference + speed * STEP_S - wheel, -lead), lead)
            for reference, speed, wheel in zip(self._reference, speeds, wheels, strict=True)
        ]
        if not (self._linear or self._angular):
            # Parked wheels must share the load, or they push against each other and the base creeps.
            mean, share = sum(lags) / len(lags), STEP_S / options.sharing_s
            lags = [lag + (mean - lag) * share for lag in lags]
        self._reference = tuple(wheel + lag for wheel, lag in zip(wheels, lags, strict=True))
        gain = options.hold_gain
        data.ctrl[self._actuators] = [speed + gain * lag for speed, lag in zip(speeds, lags, strict=True)]

    def _ticks(self) -> Array:
        turned = self._physics.data.qpos[self._qpos] * self._options.wheel_radius * self._scale
        return np.floor(turned * self._options.ticks_per_metre)

    def _snapshot(self) -> tuple[Array, Array]:
        before, self._previous = self._previous, self._ticks()
        return before, self._previous

    def _measure(self, index: int, stamp: float, snapshot: tuple[Array, Array]) -> JointState:
        before, after = snapshot
        rad_per_tick = 1.0 / (self._options.ticks_per_metre * self._options.wheel_radius)
        return JointState(
            stamp=stamp,
            name=self._options.names,
            position=after * rad_per_tick,
            velocity=(after - before) * rad_per_tick / self._options.period_s,
            effort=np.zeros(after.size),
        )


def _towards(value: float, target: float, change: float) -> float:
    """`value` moved towards `target` by at most `change`."""
    return target if abs(target - value) <= change else value + (change if target > value else -change)
