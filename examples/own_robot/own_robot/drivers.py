"""Adapters between the machine and grape: what it tells becomes messages, what grape sends becomes its calls."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from grape.clock import Clock
from grape.drivers import Drivers, Mailbox
from grape.errors import InvalidInput
from grape.geometry import rotation_to_quaternion, rotation_z
from grape.messages import Array, GripperState, Imu, JointState, LaserScan, NavSatFix, RgbdImage, Twist
from own_robot.machine import Machine

BEAMS = 271  # one degree apart
FIX_S, SCAN_S = 0.2, 0.05


class Readings:
    """One mailbox for each device; the machine's thread fills them."""

    def __init__(self, robot: Any, clock: Clock) -> None:
        self._robot, self._clock = robot, clock
        self.wheels: Mailbox[JointState] = Mailbox("wheels", clock)
        self.arm: Mailbox[JointState] = Mailbox("arm", clock)
        self.gripper: Mailbox[GripperState] = Mailbox("gripper", clock)
        self.imu: Mailbox[Imu] = Mailbox("imu", clock)
        self.gnss: Mailbox[NavSatFix] = Mailbox("gnss", clock)
        self.laser: Mailbox[LaserScan] = Mailbox("front_laser", clock)
        self.camera: Mailbox[RgbdImage] = Mailbox("camera", clock)  # stays empty: this machine has none
        self._turned = np.zeros(4)  # rad, of the wheels
        self._told_s = self._fix_s = self._scan_s = clock.now()

    def take(self, machine: Machine) -> None:
        """What the machine calls: a message to each mailbox whose device has measured."""
        robot, now = self._robot, self._clock.now()
        v, w = machine.velocity
        left, right = (v + side * w * robot.base.effective_track / 2 for side in (-1, 1))
        speeds = np.array([left, right, left, right]) / robot.base.wheel_radius  # front left, front right, rear …
        self._turned, self._told_s = self._turned + speeds * (now - self._told_s), now
        self.wheels.put(
            JointState(
                stamp=now, name=robot.base.wheel_joints, position=self._turned, velocity=speeds, effort=np.zeros(4)
            )
        )
        self.arm.put(
            JointState(
                stamp=now,
                name=robot.arm.joints,
                position=machine.joints,
                velocity=machine.joint_velocity,
                effort=np.zeros(6),
            )
        )
        self.gripper.put(GripperState(stamp=now, position=machine.fingers, velocity=np.zeros(3)))
        self.imu.put(
            Imu(
                stamp=now,
                orientation=rotation_to_quaternion(rotation_z(machine.place[2])),  # yaw 0 is east
                angular_velocity=np.array([0.0, 0.0, w]),
                linear_acceleration=np.array([0.0, 0.0, 9.81]),
            )
        )
        if now - self._fix_s >= FIX_S:
            self._fix_s = now
            latitude, longitude, altitude = machine.fix()
            self.gnss.put(
                NavSatFix(
                    stamp=now, latitude=latitude, longitude=longitude, altitude=altitude, covariance=1e-4 * np.eye(3)
                )
            )
        if now - self._scan_s >= SCAN_S:
            self._scan_s = now
            self.laser.put(
                LaserScan(
                    stamp=now,
                    angle_min=np.radians(-135.0),
                    angle_increment=np.radians(1.0),
                    range_min=0.1,
                    range_max=30.0,
                    ranges=np.full(BEAMS, np.inf),  # nothing within reach
                )
            )


class Base:
    """Body velocities to the machine."""

    def __init__(self, machine: Machine, readings: Readings, clock: Clock) -> None:
        self._machine, self._clock = machine, clock
        self.latest, self.since = readings.wheels.latest, readings.wheels.since

    def send(self, linear_x: float, angular_z: float) -> Twist:
        self._machine.drive(linear_x, angular_z)
        now = self._clock.now()
        return Twist(stamp=now, linear=np.array([linear_x, 0.0, 0.0]), angular=np.array([0.0, 0.0, angular_z]))

    def stop(self) -> None:
        self._machine.drive(0.0, 0.0)


class Arm:
    """Joint velocities to the machine, within the arm's limits."""

    def __init__(self, machine: Machine, readings: Readings, limits: Any) -> None:
        self._machine, self._limits = machine, limits
        self.latest = readings.arm.latest

    def send(self, velocity: Array) -> Array:
        if not np.isfinite(velocity).all():
            raise InvalidInput(f"arm: send finite joint velocities, got {velocity}")
        sent = np.clip(velocity, -self._limits.velocity_max, self._limits.velocity_max)
        self._machine.turn_joints(sent)
        return sent

    def stop(self) -> None:
        self._machine.turn_joints(np.zeros(6))


class Gripper:
    """Finger angles to the machine."""

    def __init__(self, machine: Machine, readings: Readings, limits: Any) -> None:
        self._machine, self._limits = machine, limits
        self.latest = readings.gripper.latest

    def send(self, position: Array) -> Array:
        if not np.isfinite(position).all():
            raise InvalidInput(f"gripper: send finite finger angles, got {position}")
        sent = np.clip(position, self._limits.position_min, self._limits.position_max)
        self._machine.fingers = sent
        return sent

    def stop(self) -> None:
        """It holds by itself."""


@contextmanager
def connect(robot: Any, clock: Clock) -> Iterator[Drivers]:
    """The robot's drivers, for as long as the block lasts; grape calls this for `drivers: machine`.

    Args:
        robot: `grape.robots.RobotDescription`.
        clock: the mission's; every message is stamped by it.
    """
    readings = Readings(robot, clock)
    machine = Machine(readings.take)
    machine.open()
    try:
        yield Drivers(
            base=Base(machine, readings, clock),
            arm=Arm(machine, readings, robot.arm),
            gripper=Gripper(machine, readings, robot.gripper),
            camera=readings.camera,
            imu=readings.imu,
            gnss=readings.gnss,
            scans={"front_laser": readings.laser},
        )
    finally:
        machine.close()
