"""What a robot is, as data: the MJCF that describes its body, and the names, mounts and limits that code needs.

A robot package holds one `DESCRIPTION = RobotDescription(...)`. Nothing here imports a simulator or opens a device;
drivers are named by string (`package.module:factory`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal

import numpy as np

from grape.geometry import pose
from grape.messages import Array, frozen_array


class _Frozen:
    """Copies every array of a frozen dataclass and makes it read-only."""

    def __post_init__(self) -> None:
        for item in fields(self):  # type: ignore[arg-type]
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, item.name, frozen_array(value, float))


@dataclass(frozen=True, kw_only=True)
class Mount(_Frozen):
    """Where a sensor sits: `T_parent_sensor` (4, 4), x forward for scanners, z forward for `camera_optical`.

    `model` is what its maker calls it, for sensors of which a driver knows several.
    """

    parent: str
    T_parent_sensor: Array
    model: str = ""


@dataclass(frozen=True, kw_only=True)
class SafetyZone(_Frozen):
    """An area around the base in which whatever a scanner sees slows the base down, or stops it.

    It counts for the motions it names: `forward` and `backward`, also in bends, and `turn` in place.
    """

    name: str
    polygon: Array  # (n, 2) m in base_link
    motions: tuple[Literal["forward", "backward", "turn"], ...]
    speed: float = 0.0  # m/s that is allowed, of the outermost corner when turning; 0 stops


def driving_zones(footprint: Array) -> tuple[SafetyZone, ...]:
    """Stop zones of 0.12 m and slow zones of 0.50 m before and behind a base, as broad as its `footprint` (n, 2) m."""
    (rear, right), (front, left) = np.min(footprint, axis=0), np.max(footprint, axis=0)

    def strip(near: float, far: float) -> Array:
        return np.array([[near, right], [far, right], [far, left], [near, left]])

    return (
        SafetyZone(name="stop ahead", polygon=strip(front, front + 0.12), motions=("forward",)),
        SafetyZone(name="slow ahead", polygon=strip(front, front + 0.50), motions=("forward",), speed=0.3),
        SafetyZone(name="stop behind", polygon=strip(rear, rear - 0.12), motions=("backward",)),
        SafetyZone(name="slow behind", polygon=strip(rear, rear - 0.50), motions=("backward",), speed=0.2),
    )


@dataclass(frozen=True, kw_only=True)
class BaseDescription(_Frozen):
    """A four-wheeled skid-steer base.

    `effective_track` is the track that turns wheel speeds into yaw rate on firm ground: skidding makes it longer than
    the geometric one.
    """

    height: float  # m, base_link over flat ground
    wheel_joints: tuple[str, ...]  # front left, front right, rear left, rear right
    wheel_actuators: tuple[str, ...]
    wheel_radius: float  # m
    wheelbase: float  # m
    track: float  # m
    effective_track: float  # m
    max_linear: float  # m/s
    max_angular: float  # rad/s
    max_linear_acceleration: float  # m/s^2
    max_angular_acceleration: float  # rad/s^2
    half_width: float  # m, base_link to the side from which the distance to a row is told
    footprint: Array  # (4, 2) m in base_link, counter-clockwise
    command_timeout: float  # s
    ticks_per_metre: float  # of the wheel encoders, along the ground
    zones: tuple[SafetyZone, ...] = ()


@dataclass(frozen=True, kw_only=True)
class TouchDescription(_Frozen):
    """How an arm feels what it touches, by the torques that its driver measures; per joint (n,)."""

    motor_inertia: Array  # kg m^2 that turn with the motor, as felt at the joint; 0: measured behind the gear
    friction: Array  # N m between the measured torque and the link
    torque_max: Array  # N m from outside, beyond which a motion ends


@dataclass(frozen=True, kw_only=True)
class ArmDescription(_Frozen):
    """A serial arm. Angles are absolute: continuous joints are never wrapped."""

    base_frame: str
    tip_frame: str
    T_base_link_arm_base: Array  # (4, 4)
    joints: tuple[str, ...]
    actuators: tuple[str, ...]
    position_min: Array  # (n,) rad, -inf for a continuous joint
    position_max: Array  # (n,) rad, +inf for a continuous joint
    velocity_max: Array  # (n,) rad/s
    headroom: float  # share of velocity_max that set-points leave to a joint that overruns them
    acceleration_max: Array  # (n,) rad/s^2
    torque_max: Array  # (n,) N m
    servo_lag: float  # s by which the joint servo trails a moving set-point (kv / kp)
    command_timeout: float  # s
    poses: Mapping[str, Array]  # (n,) rad: home, travel, ready_feeder, ready_left_fore, ready_left_aft
    cable_turns: float  # rad that a continuous joint may be away from its unwound angle
    unwound: Array  # (n,) rad: the winding that every cable starts from
    touch: TouchDescription | None = None  # None: the arm measures no torques

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "poses", {name: frozen_array(q, float) for name, q in self.poses.items()})

    @property
    def set_point_max(self) -> Array:
        """Joint velocities (n,) rad/s that may be asked for, so that the arm keeps to `velocity_max`."""
        return (1.0 - self.headroom) * self.velocity_max


@dataclass(frozen=True, kw_only=True)
class GripperDescription(_Frozen):
    """A hand whose fingers 2 and 3 carry nails that open inside a loop.

    The nail of finger 2 turns about `pivot` (hand frame) with direction `axis`; at the finger angle `reference` it
    hangs straight under the pivot by `radius`, at `nail_x` beside the hand's centre plane. Finger 3 mirrors it in x.
    """

    joints: tuple[str, ...]  # thumb, finger 2, finger 3
    actuators: tuple[str, ...]
    nail_bodies: tuple[str, ...]  # on finger 2 (+x), finger 3 (-x)
    position_min: Array  # (3,) rad
    position_max: Array  # (3,) rad
    velocity_max: float  # rad/s
    open_angle: float  # rad, nails 49 mm apart
    closed_angle: float  # rad, nails 9 mm apart
    thumb_clear: float  # rad, thumb folded between the fingers: clear of the feeder and of a held loop
    pivot: Array  # (3,) m, hand frame, finger 2
    axis: Array  # (3,) unit vector, hand frame, finger 2
    radius: float  # m
    reference: float  # rad
    nail_x: float  # m
    nail_radius: float  # m, about the groove, with all that surrounds it
    stem_radius: float  # m, of what carries the groove
    stem_length: float  # m, from the groove up


@dataclass(frozen=True, kw_only=True)
class FeederDescription(_Frozen):
    """A magazine of loops, stacked upwards; loops lie along y of the feeder frame and leave towards -x.

    The feeder frame is the centre of the lowest loop, axes parallel to base_link.
    """

    T_base_link_feeder: Array  # (4, 4)
    levels: int
    pitch: float  # m
    marker_ids: tuple[int, ...]
    marker_positions: Array  # (markers, 3) m, centre of each face in the feeder frame, facing +z, x to the right
    marker_side: float  # m, black square
    marker_dictionary: str

    def T_base_link_level(self, level: int) -> Array:
        """Pose (4, 4) of the centre of the loop at `level` (0 = lowest) in base_link."""
        return np.asarray(self.T_base_link_feeder @ pose(translation=(0.0, 0.0, level * self.pitch)))


@dataclass(frozen=True, kw_only=True)
class RobotDescription:
    """A robot as data; `mjcf` is the one source of its body, and of the shapes that planners use.

    `drivers` names those of the real machine: from what a mission file calls them (not `simulated`) to
    `package.module:connect` of `connect(description, clock)`, a context manager that gives `grape.drivers.Drivers`.
    """

    name: str
    mjcf: Path
    base: BaseDescription
    arm: ArmDescription
    gripper: GripperDescription
    feeder: FeederDescription
    mounts: Mapping[str, Mount]
    drivers: Mapping[str, str] = field(default_factory=dict)
    collision_group: int = 3  # geom group of the shapes that planners use

    def T_base_link_sensor(self, name: str) -> Array:
        """Pose of a sensor that is fixed to base_link (4, 4).

        Raises:
            KeyError: there is no such sensor, or it is mounted elsewhere.
        """
        mount = self.mounts[name]
        if mount.parent != "base_link":
            raise KeyError(f"{name} is mounted on {mount.parent}, not on base_link")
        return mount.T_parent_sensor
