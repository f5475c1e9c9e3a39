"""The guards of a mission's actuators: zones, fences and pose before the base, torques from outside before the arm."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from grape.actions.core import Recorder
from grape.actions.robot import Robot
from grape.actions.shortest_way import footprint_of
from grape.clock import Clock
from grape.control.contact import GRAVITY, ContactObserver
from grape.drivers import ArmDriver, Drivers
from grape.drivers.guarded_arm import GuardedArm, Touch, TouchOptions
from grape.drivers.guarded_base import GuardedBase, GuardOptions
from grape.geometry import yaw_of
from grape.messages import Array
from grape.navigation.collision_monitor import CollisionMonitor, CollisionOptions, Decision
from grape.navigation.fence_guard import FenceGuard
from grape.world import World

BRAKING_S = 1.0  # in which a base whose pose has just become uncertain may come to rest by itself


def guarded(drivers: Drivers, robot: Robot, world: World, clock: Clock, log: Recorder) -> Drivers:
    """The drivers of a robot with its base behind a guard, and its arm, if it measures torques."""
    base = _guarded_base(drivers, robot.description, world, clock, log)
    if robot.description.arm.touch is None:
        return replace(drivers, base=base)
    return replace(drivers, base=base, arm=_guarded_arm(drivers.arm, robot, world, clock, log))


def _guarded_base(drivers: Drivers, description: Any, world: World, clock: Clock, log: Recorder) -> GuardedBase:
    limits = description.base
    footprint = footprint_of(limits.footprint)
    certain_s = -math.inf

    def pose() -> tuple[float, Array] | None:
        nonlocal certain_s
        if world.localized:
            certain_s = clock.now()
        if world.odometry is None or clock.now() - certain_s > BRAKING_S:
            return None
        T = world.odometry.pose
        return world.odometry.stamp, np.array([T[0, 3], T[1, 3], yaw_of(T)])

    def tell(decision: Decision) -> None:
        log.event("base_guard", zone=decision.zone, verdict=str(decision.verdict), point=decision.point)

    mounts = description.mounts
    return GuardedBase(
        drivers.base,
        clock,
        CollisionMonitor(limits.zones, CollisionOptions(footprint=footprint)),
        FenceGuard([fence.polygon for fence in world.site.fences], footprint),
        {
            name: (driver, mounts[name].T_parent_sensor)
            for name, driver in drivers.scans.items()
            if name in mounts and mounts[name].parent == "base_link"
        },
        pose,
        GuardOptions(
            velocity=(limits.max_linear, limits.max_angular),
            effective_track=limits.effective_track,
            acceleration=(limits.max_linear_acceleration, limits.max_angular_acceleration),
        ),
        tell,
    )


def _guarded_arm(arm: ArmDriver, robot: Robot, world: World, clock: Clock, log: Recorder) -> GuardedArm:
    limits = robot.description.arm
    touch = limits.touch

    def gravity() -> Array:
        """(3,) m/s^2 in the arm's base frame; the base is taken for level until its attitude is known."""
        R = limits.T_base_link_arm_base[:3, :3]
        return np.asarray((R if world.odometry is None else world.odometry.pose[:3, :3] @ R).T @ GRAVITY)

    def tell(felt: Touch) -> None:
        log.event("arm_contact", joint=felt.joint, torques=felt.torques)

    def feel(share: float) -> None:
        world.felt = share

    return GuardedArm(
        arm,
        clock,
        ContactObserver(robot.arm, touch.motor_inertia, touch.friction),
        gravity,
        TouchOptions(torque_max=touch.torque_max, velocity_max=limits.set_point_max),
        tell,
        lambda: world.touching,
        feel,
    )
