"""The simulated fingers: position set-points approached at a limited rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, GripperState
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.physics import STEP_S, Physics
from grape.sim.sensors.noise import FrameNoise


@dataclass(frozen=True, kw_only=True)
class GripperOptions:
    """Finger joints in the order thumb, 2, 3, and the fingers' own controller."""

    joints: tuple[str, ...]
    rate: float = 1.0  # rad/s
    period_s: float = 0.01
    encoder_sigma: float = 5e-4  # rad


class SimulatedGripper(SampledSensor[GripperState]):
    """Position actuators of the fingers."""

    STATE = (*SampledSensor.STATE, "_target", "_reference")

    def __init__(self, physics: Physics, seed: int, options: GripperOptions) -> None:
        super().__init__(physics, "gripper", options.period_s)
        self._options = options
        self._noise = FrameNoise(seed, "gripper")
        self._qpos = physics.joint_qpos(options.joints)
        self._qvel = physics.joint_qvel(options.joints)
        self._actuators = physics.actuators(options.joints)
        gain, bias = physics.model.actuator_gainprm, physics.model.actuator_biasprm
        self._lag_s = -bias[self._actuators, 2] / gain[self._actuators, 0]
        ranges = np.array([physics.model.jnt_range[physics.identify("joint", name)] for name in options.joints])
        self._lower, self._upper = ranges.T
        self._reference = physics.data.qpos[self._qpos].copy()
        self._target = self._reference.copy()
        self._held = False  # whether the actuators have been told where the fingers stand still

    def send(self, position: Array) -> Array:
        """Set-point of the finger angles (fingers,) rad; returns what was sent after limits.

        Raises:
            InvalidInput: wrong shape or not finite.
        """
        wanted = np.array(position, dtype=float)
        if wanted.shape != self._target.shape or not np.isfinite(wanted).all():
            raise InvalidInput(f"gripper: send {self._target.shape[0]} finite finger angles, got {position}")
        self._target = np.clip(wanted, self._lower, self._upper)
        return self._target.copy()

    def stop(self) -> None:
        """Hold the present angles."""
        self._target = self._reference.copy()

    def actuate(self) -> None:
        """Move the reference by one physics step and hand it to the actuators."""
        change = self._options.rate * STEP_S
        step = np.minimum(np.maximum(self._target - self._reference, -change), change)
        if not step.any() and self._held:
            return
        self._held = not step.any()
        self._reference += step
        self._physics.data.ctrl[self._actuators] = self._reference + self._lag_s / STEP_S * step

    def _snapshot(self) -> tuple[Array, Array]:
        return self._physics.data.qpos[self._qpos], self._physics.data.qvel[self._qvel]

    def _measure(self, index: int, stamp: float, snapshot: tuple[Array, Array]) -> GripperState:
        noise = self._noise.normal(index, self._qpos.size) * self._options.encoder_sigma
        return GripperState(stamp=stamp, position=snapshot[0] + noise, velocity=snapshot[1])
