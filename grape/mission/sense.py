"""The first part of each beat: the newest message of every driver into the robot's world."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from grape.clock import AHEAD_S
from grape.drivers import Drivers
from grape.errors import StaleData
from grape.localization import EstimatorOptions, GnssConfig, ImuConfig, PoseEstimator, WheelConfig
from grape.mission.laser_motion import LaserMotion
from grape.mission.laser_place import LaserPlace
from grape.world import World

_BEFORE_ALL = -1.0
ARM_AGE_MAX_S = 0.1  # of joint angles that the arm is moved by
SILENCE_MAX_S = 0.1  # of wheels, IMU and GNSS together: the estimate is not carried on for longer, and grows old


class Sensing:
    """Reads drivers, estimates the pose and keeps the frames of a world.

    Frames: map -> base_link (estimate), base_link -> arm_base -> hand (measured joints at every beat), sensors on their
    mounts. Cameras and laser scanners are left alone: actions read them when they need them.

    Args:
        robot: models and description (`grape.actions.robot.Robot`).
        place: the robot's place by a laser, where the mission has a map.
        motion: how it moves by a laser, where the mission has laser odometry.
    """

    def __init__(
        self,
        drivers: Drivers,
        world: World,
        robot: Any,
        place: LaserPlace | None = None,
        motion: LaserMotion | None = None,
    ) -> None:
        self._drivers = drivers
        self._world = world
        self._robot = robot
        self._place = place
        self._motion = motion
        description = robot.description
        self._estimator = PoseEstimator(_estimator_options(description, world))
        self._newest = {"wheels": _BEFORE_ALL, "imu": _BEFORE_ALL, "gnss": _BEFORE_ALL, "arm": _BEFORE_ALL}
        arm = description.arm
        world.frames.set_fixed("base_link", arm.base_frame, arm.T_base_link_arm_base)
        for name, mount in description.mounts.items():
            world.frames.set_fixed(mount.parent, name, mount.T_parent_sensor)

    def update(self, now: float) -> None:
        """Take in what came since the last beat; `now` is the clock's time."""
        self._localize(now)
        self._read_arm(now)
        with contextlib.suppress(StaleData):
            self._world.gripper = self._drivers.gripper.latest()

    def _localize(self, now: float) -> None:
        drivers, world = self._drivers, self._world
        wheels = self._since("wheels", drivers.base, now)
        imu = self._since("imu", drivers.imu, now)
        gnss = self._since("gnss", drivers.gnss, now)
        odometry = self._estimator.advance(now, wheels=wheels, imu=imu, gnss=gnss)
        heard = max(self._newest[name] for name in ("wheels", "imu", "gnss"))
        if not self._estimator.initialized or now - heard > SILENCE_MAX_S:
            return
        world.odometry = odometry
        world.localized = self._estimator.ready
        world.frames.push("map", "base_link", odometry.pose, now)
        if self._motion is not None:
            self._motion.update(now, self._estimator)
        if self._place is not None:
            self._place.update(now, self._estimator)
            if self._place.pose is not None:
                world.estimates["amcl"] = self._place.pose

    def _since(self, name: str, driver: Any, now: float) -> Any:
        """New messages; one that is stamped ahead of the clock is none."""
        messages = tuple(message for message in driver.since(self._newest[name]) if message.stamp <= now + AHEAD_S)
        if messages:
            self._newest[name] = messages[-1].stamp
        return messages

    def _read_arm(self, now: float) -> None:
        world = self._world
        with contextlib.suppress(StaleData):
            told = self._drivers.arm.latest()
            if np.isfinite(told.position).all() and told.stamp <= now + AHEAD_S:
                world.take_arm(told)
        arm = world.arm
        if arm is not None and now - arm.stamp > ARM_AGE_MAX_S:
            arm = world.arm = None
        if arm is None or arm.stamp <= self._newest["arm"]:
            return
        self._newest["arm"] = arm.stamp
        description = self._robot.description.arm
        T_arm_base_hand = self._robot.arm.fk(arm.position)
        self._world.frames.push(description.base_frame, description.tip_frame, T_arm_base_hand, arm.stamp)


def _estimator_options(description: Any, world: World) -> EstimatorOptions:
    """The filter for a robot's wheels and mounts on a site's datum."""
    base = description.base
    T_base_antenna = description.T_base_link_sensor("gnss_link")
    T_base_imu = description.T_base_link_sensor("imu_link")
    return EstimatorOptions(
        datum=world.site.datum,
        wheels=WheelConfig(wheel_radius=base.wheel_radius, effective_track=base.effective_track),
        imu=ImuConfig(R_base_imu=T_base_imu[:3, :3]),
        gnss=GnssConfig(antenna=T_base_antenna[:3, 3]),
    )
