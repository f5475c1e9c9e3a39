"""The guard of a mission's base: what zones, fences and the pose estimate say to each command."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from grape.actions.core import Recorder
from grape.actions.shortest_way import footprint_of
from grape.clock import Clock
from grape.drivers import Drivers
from grape.drivers.guarded_base import GuardedBase, GuardOptions
from grape.geometry import yaw_of
from grape.messages import Array
from grape.navigation.collision_monitor import CollisionMonitor, CollisionOptions, Decision
from grape.navigation.fence_guard import FenceGuard
from grape.world import World


def guarded(drivers: Drivers, description: Any, world: World, clock: Clock, log: Recorder) -> Drivers:
    """The drivers of a robot with its base behind a guard.

    Args:
        description: `grape.robots.RobotDescription`.
    """
    limits = description.base
    footprint = footprint_of(limits.footprint)

    def pose() -> tuple[float, Array] | None:
        if world.odometry is None or not world.localized:
            return None
        T = world.odometry.pose
        return world.odometry.stamp, np.array([T[0, 3], T[1, 3], yaw_of(T)])

    def tell(decision: Decision) -> None:
        log.event("base_guard", zone=decision.zone, verdict=str(decision.verdict), point=decision.point)

    mounts = description.mounts
    base = GuardedBase(
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
    return replace(drivers, base=base)
