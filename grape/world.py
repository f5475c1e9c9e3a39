"""The stamped snapshot of robot and surroundings that actions read.

`sense` writes the measured part each beat; actions commit results (clouds, deployment poses) under names.
Nothing here comes from anywhere but the robot's own sensors and the site file.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from grape.errors import StaleData
from grape.frames import FrameTree
from grape.messages import Array, GripperState, JointState, Odometry
from grape.navigation.path import Path
from grape.navigation.surroundings import Surroundings
from grape.site import Site


@dataclass(frozen=True, kw_only=True)
class Driving:
    """What a drive goes by.

    Args:
        path: it follows.
        surroundings: obstacles and prohibited areas as it knows them; they change while it drives.
        scan: (n, 2) m in base_link, hits of the newest horizontal scans.
        scan_pose: (3,) x y yaw of base_link in map when the newest of them was taken.
    """

    path: Path
    surroundings: Surroundings
    scan: Array
    scan_pose: Array


@dataclass(kw_only=True)
class World:
    """What the robot knows.

    Frames: map -> base_link (estimate), base_link -> arm_base, hand (measured joints), sensors.
    """

    site: Site
    frames: FrameTree = field(default_factory=FrameTree)
    odometry: Odometry | None = None  # estimate of base_link in map
    localized: bool = False  # whether that estimate is good enough to drive by
    estimates: dict[str, Array] = field(default_factory=dict)  # by source: others, (3,) x y yaw in map, to look at
    arm: JointState | None = None  # joint angles less `encoder_offsets`; None: not told, or not any more
    encoder_offsets: Array | None = None  # (n,) rad by which the arm's encoders tell too much; None: not calibrated
    gripper: GripperState | None = None
    driving: Driving | None = None  # while the base drives
    touching: bool = False  # while the hand works by contact: the arm's guard lets touches be
    felt: float = 0.0  # at the arm's last command: torques from outside, as a share of those at which its guard lets go
    committed: dict[str, Any] = field(default_factory=dict)  # results of actions by name, for later actions

    def base_pose(self) -> Array:
        """`T_map_base`, the newest estimate.

        Raises:
            StaleData: no estimate exists yet.
        """
        if self.odometry is None:
            raise StaleData("no pose estimate yet: the filter waits for GNSS, IMU and wheels")
        return self.odometry.pose

    def take_arm(self, told: JointState) -> JointState:
        """Commit what the arm's encoders tell, less what they are known to be off; returns what was committed."""
        if self.encoder_offsets is not None:
            told = replace(told, position=told.position - self.encoder_offsets)
        self.arm = told
        return told

    def joints(self) -> Array:
        """Measured joint angles of the arm, (n,) rad, as far as its encoders are calibrated.

        Raises:
            StaleData: the arm has not reported its joints yet, or has stopped doing so.
        """
        if self.arm is None:
            raise StaleData("the arm does not report its joints")
        return self.arm.position
