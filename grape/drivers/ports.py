"""The protocols that a driver implements and the bundle of them that a robot offers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

from grape.errors import DriverError
from grape.messages import (
    Array,
    GripperState,
    Imu,
    JointState,
    LaserScan,
    Message,
    NavSatFix,
    PointCloud,
    Refilled,
    RgbdImage,
    Twist,
)

M_co = TypeVar("M_co", bound=Message, covariant=True)


class SensorDriver(Protocol[M_co]):
    """A source of stamped messages."""

    def latest(self, max_age_s: float | None = None) -> M_co:
        """The newest message.

        Raises:
            StaleData: there is none yet, or it is older than `max_age_s`.
        """
        ...

    def since(self, stamp: float) -> tuple[M_co, ...]:
        """Every buffered message newer than `stamp`, oldest first (the buffer holds about two seconds)."""
        ...


class CameraDriver(SensorDriver[RgbdImage], Protocol):
    """A camera; frames cost time, so they are taken only when somebody reads them. `since` may hold one frame only."""


class BaseDriver(Protocol):
    """A mobile base that follows a body velocity."""

    def send(self, linear_x: float, angular_z: float) -> Twist:
        """Set-point of the body velocity (m/s, rad/s); returns what was sent after limits.

        The base stops by itself when the last set-point is older than its time-out (Husky: 0.25 s).
        """
        ...

    def stop(self) -> None:
        """Brake now and hold."""
        ...

    def latest(self, max_age_s: float | None = None) -> JointState:
        """Wheel angles and speeds from the encoders, names in the robot's order."""
        ...

    def since(self, stamp: float) -> tuple[JointState, ...]:
        """Buffered wheel states newer than `stamp`, oldest first."""
        ...


class ArmDriver(Protocol):
    """An arm that follows joint velocities at 100 Hz (Jaco2: below that rate it undershoots, above it overruns)."""

    def send(self, velocity: Array) -> Array:
        """Set-point of the joint velocities, (n,) rad/s; returns what was sent after speed and acceleration limits.

        The arm stops by itself when the last set-point is older than its time-out (Jaco2: 0.05 s).
        """
        ...

    def stop(self) -> None:
        """Brake as fast as the acceleration limit allows and hold."""
        ...

    def latest(self, max_age_s: float | None = None) -> JointState:
        """Measured joint angles (absolute, never wrapped), speeds and torques."""
        ...


class GripperDriver(Protocol):
    """The fingers of a hand."""

    def send(self, position: Array) -> Array:
        """Set-point of the finger angles, (fingers,) rad; returns what was sent after limits."""
        ...

    def stop(self) -> None:
        """Hold the present angles."""
        ...

    def latest(self, max_age_s: float | None = None) -> GripperState:
        """Measured finger angles."""
        ...


class OperatorDriver(Protocol):
    """A person at the refill point, reached by a lamp and a button."""

    def call(self) -> None:
        """Show that the robot stands still and waits for a refill; ends by itself unless it is renewed every 0.5 s."""
        ...

    def refilled(self, after: int = 0) -> tuple[Refilled, ...]:
        """Every refill that was confirmed and has a number above `after`, oldest first; none is ever forgotten."""
        ...


class NoOperator:
    """Nobody comes."""

    def call(self) -> None:
        """Nobody sees it."""

    def refilled(self, after: int = 0) -> tuple[Refilled, ...]:
        """Nothing, ever."""
        return ()


@dataclass(frozen=True, kw_only=True)
class Drivers:
    """Every driver of one robot. Optional sensors are absent from their mapping, never None inside it."""

    base: BaseDriver
    arm: ArmDriver
    gripper: GripperDriver
    camera: CameraDriver
    imu: SensorDriver[Imu]
    gnss: SensorDriver[NavSatFix]
    scans: Mapping[str, SensorDriver[LaserScan]] = field(default_factory=dict)  # "front_laser", "wrist_lidar"
    clouds: Mapping[str, SensorDriver[PointCloud]] = field(default_factory=dict)  # "velodyne"
    operator: OperatorDriver = field(default_factory=NoOperator)

    def stop_all(self) -> None:
        """Stop every actuator, each whatever becomes of the others; called when anything goes wrong.

        Raises:
            DriverError: one or more could not be stopped; names each and its error.
        """
        failed: list[tuple[str, Exception]] = []
        for name, actuator in (("base", self.base), ("arm", self.arm), ("gripper", self.gripper)):
            try:
                actuator.stop()
            except Exception as error:
                failed.append((name, error))
        if failed:
            texts = "; ".join(f"{name}: {type(error).__name__}: {error}" for name, error in failed)
            raise DriverError(f"could not be stopped: {texts}") from failed[0][1]
