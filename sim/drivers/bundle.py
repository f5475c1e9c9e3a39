"""Every simulated driver of a robot, wired to one scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import mujoco

from grape.drivers import Drivers
from grape.errors import InvalidInput, with_suggestion
from grape.robots import RobotDescription
from grape.sim.drivers.arm import ArmDriverOptions, ArmLimits, SimulatedArm
from grape.sim.drivers.base import BaseOptions, SimulatedBase
from grape.sim.drivers.camera import CameraOptions, SimulatedCamera
from grape.sim.drivers.gnss import GnssOptions, SimulatedGnss
from grape.sim.drivers.gripper import GripperOptions, SimulatedGripper
from grape.sim.drivers.imu import ImuOptions, SimulatedImu
from grape.sim.drivers.lidar import SCANNERS, SPINNERS, Cast, SimulatedScanner, SimulatedSpinner
from grape.sim.drivers.operator import OperatorOptions, SimulatedOperator
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.physics import Physics, Replica
from grape.site import Site


@dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """Every sensor's rate, limits and errors."""

    arm: ArmDriverOptions = field(default_factory=ArmDriverOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    imu: ImuOptions = field(default_factory=ImuOptions)
    gnss: GnssOptions = field(default_factory=GnssOptions)
    operator: OperatorOptions = field(default_factory=OperatorOptions)


class SimulatedDrivers:
    """The drivers of one simulated robot: `ports` for the mission, the rest for the simulation that runs them."""

    def __init__(
        self,
        physics: Physics,
        robot: RobotDescription,
        site: Site,
        cast: Cast,
        seen: Callable[[], mujoco.MjModel],
        seed: int,
        options: SensorOptions,
    ) -> None:
        replica = Replica(physics.model)
        self.base = SimulatedBase(physics, seed, _base_options(robot))
        self.arm = SimulatedArm(physics, _arm_limits(robot), seed, options.arm)
        self.gripper = SimulatedGripper(
            physics, seed, GripperOptions(joints=robot.gripper.joints, rate=robot.gripper.velocity_max)
        )
        self.camera = SimulatedCamera(physics, seen, seed, options.camera)
        self.imu = SimulatedImu(physics, seed, options.imu)
        self.gnss = SimulatedGnss(physics, site.datum, seed, options.gnss)
        models = {name: mount.model for name, mount in robot.mounts.items() if mount.model}
        _check_models(models)
        scans = {
            name: SimulatedScanner(physics, replica, cast, seed, replace(SCANNERS[model], name=name))
            for name, model in models.items()
            if model in SCANNERS
        }
        clouds = {
            name: SimulatedSpinner(physics, replica, cast, seed, replace(SPINNERS[model], name=name))
            for name, model in models.items()
            if model in SPINNERS
        }
        self.operator = SimulatedOperator(physics, robot, site.refills, seed, options.operator)
        self.sensors: dict[str, SampledSensor] = {
            "base": self.base,
            "arm": self.arm,
            "gripper": self.gripper,
            "camera": self.camera,
            "imu": self.imu,
            "gnss": self.gnss,
            **scans,
            **clouds,
        }
        self._periods = tuple((sensor.period_steps, sensor) for sensor in self.sensors.values())
        self.ports = Drivers(
            base=self.base,
            arm=self.arm,
            gripper=self.gripper,
            camera=self.camera,
            imu=self.imu,
            gnss=self.gnss,
            scans=scans,
            clouds=clouds,
            operator=self.operator,
        )

    def actuate(self) -> None:
        """Move every actuator's reference by one physics step."""
        self.base.actuate()
        self.arm.actuate()
        self.gripper.actuate()

    def sample(self, step: int) -> None:
        """Let every sensor that is due note the present state, and the operator look what there is to do."""
        if step % self.operator.period_steps == 0:
            self.operator.look()
        for period, sensor in self._periods:
            if step % period == 0:
                sensor.sample()

    def close(self) -> None:
        """Give the graphics memory back."""
        self.camera.close()


def connect(
    physics: Physics,
    robot: RobotDescription,
    site: Site,
    cast: Cast,
    seen: Callable[[], mujoco.MjModel],
    seed: int,
    options: SensorOptions | None = None,
) -> SimulatedDrivers:
    """The simulated drivers of a robot in a scene.

    Args:
        site: its datum for GNSS, its refill points for the operator.
        cast: distances (n,) m along rays from origins (n, 3) in unit directions (n, 3), map frame, at a time (s), +inf
            for no hit.
        seen: makes the model that the camera renders.
        seed: of every sensor's noise.
    """
    return SimulatedDrivers(physics, robot, site, cast, seen, seed, options or SensorOptions())


def _check_models(models: Mapping[str, str]) -> None:
    known = (*SCANNERS, *SPINNERS)
    for name, model in models.items():
        if model not in known:
            sentence = f"{name}: no simulated {model!r}; there are {', '.join(known)}"
            raise InvalidInput(with_suggestion(sentence, model, known))


def _base_options(robot: RobotDescription) -> BaseOptions:
    base = robot.base
    return BaseOptions(
        names=base.wheel_joints,
        left=base.wheel_joints[0::2],
        right=base.wheel_joints[1::2],
        wheel_radius=base.wheel_radius,
        effective_track=base.effective_track,
        max_linear=base.max_linear,
        max_angular=base.max_angular,
        linear_acceleration=base.max_linear_acceleration,
        angular_acceleration=base.max_angular_acceleration,
        timeout_s=base.command_timeout,
        ticks_per_metre=base.ticks_per_metre,
    )


def _arm_limits(robot: RobotDescription) -> ArmLimits:
    arm = robot.arm
    return ArmLimits(
        joints=arm.joints,
        lower=arm.position_min,
        upper=arm.position_max,
        velocity=arm.velocity_max,
        acceleration=arm.acceleration_max,
        timeout_s=arm.command_timeout,
    )
