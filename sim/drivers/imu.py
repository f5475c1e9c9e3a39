"""The simulated IMU: orientation, rates and specific force at its mount."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from grape.geometry import quaternion_to_rotation, rotation_exp, rotation_to_quaternion
from grape.messages import Array, Imu
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.physics import Physics
from grape.sim.sensors.noise import FrameNoise, SlowDrift

GRAVITY = 9.81


@dataclass(frozen=True, kw_only=True)
class ImuOptions:
    """Errors of the IMU; standard deviations of each axis.

    Source: facts sheet, section 3 (Husky's IMU at 50 Hz; heading 0.005 rad; gyro bias 0.1 deg/s at start is what is
    left before calibration, a tenth of it after).
    """

    body: str = "base_link"
    site: str = "imu_link"
    period_s: float = 0.02
    tilt_sigma: float = 0.002  # rad
    heading_sigma: float = 0.005  # rad
    heading_drift: float = 0.006  # rad
    gyro_sigma: float = 0.002  # rad/s
    gyro_bias: float = 1.7e-4  # rad/s
    accel_sigma: float = 0.02  # m/s^2
    accel_bias: float = 0.005  # m/s^2


class SimulatedImu(SampledSensor[Imu]):
    """An attitude sensor with a compass; its axes are parallel to those of the body it is mounted on."""

    STATE = (*SampledSensor.STATE, "_velocity")

    def __init__(self, physics: Physics, seed: int, options: ImuOptions) -> None:
        super().__init__(physics, "imu", options.period_s)
        self._options = options
        body = physics.identify("body", options.body)
        joint = physics.model.body_jntadr[body]
        self._qpos = int(physics.model.jnt_qposadr[joint])
        self._qvel = int(physics.model.jnt_dofadr[joint])
        self._mount = physics.model.site_pos[physics.identify("site", options.site)].copy()
        self._noise = FrameNoise(seed, "imu")
        rng = self._noise.constant()
        self._gyro_bias = options.gyro_bias * rng.standard_normal(3)
        self._accel_bias = options.accel_bias * rng.standard_normal(3)
        self._heading = SlowDrift(rng, options.heading_drift, 1, (60.0, 600.0))
        self._velocity = np.full(3, np.nan)  # of the mount at the last sample

    def _snapshot(self) -> tuple[Array, Array, Array]:
        data = self._physics.data
        quaternion = data.qpos[self._qpos + 3 : self._qpos + 7].copy()
        rate = data.qvel[self._qvel + 3 : self._qvel + 6].copy()  # body axes
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, quaternion)
        velocity = data.qvel[self._qvel : self._qvel + 3] + R.reshape(3, 3) @ np.cross(rate, self._mount)
        before = velocity if np.isnan(self._velocity[0]) else self._velocity
        self._velocity = velocity
        acceleration = (velocity - before) / self._options.period_s  # the mean since the last sample
        return quaternion, rate, acceleration

    def _measure(self, index: int, stamp: float, snapshot: tuple[Array, Array, Array]) -> Imu:
        quaternion, rate, acceleration = snapshot
        options = self._options
        noise = self._noise.normal(index, 9)
        R_map_imu = quaternion_to_rotation(quaternion)
        force = R_map_imu.T @ (acceleration + np.array([0.0, 0.0, GRAVITY]))
        tilt = options.tilt_sigma * noise[:2]
        heading = options.heading_sigma * noise[2] + self._heading.at(stamp)[0]
        error = rotation_exp(np.array([tilt[0], tilt[1], heading]))
        return Imu(
            stamp=stamp,
            frame_id=options.site,
            orientation=rotation_to_quaternion(error @ R_map_imu),
            angular_velocity=rate + self._gyro_bias + options.gyro_sigma * noise[3:6],
            linear_acceleration=force + self._accel_bias + options.accel_sigma * noise[6:9],
        )
