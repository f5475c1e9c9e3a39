"""How the robot moves by a laser of its base, one more input of the mission's filter: where wheels spin, it sees it."""

from __future__ import annotations

from typing import Any

import numpy as np

from grape.drivers import Drivers
from grape.geometry import planar_of
from grape.localization import LaserOdometry, PoseEstimator
from grape.mapping import between, plants_in_scan, transform_points
from grape.messages import Array, LaserScan
from grape.mission.base_scanner import BaseScanner
from grape.navigation.beams import ScanOptions, beams_from_scan
from grape.navigation.ground import MeanGround

SCAN_S = 0.2
FARTHEST_M = 20.0


class LaserMotion:
    """Matches the scans of the first scanner on the base, of narrow things that stand out of the ground.

    Ground that a tilted scanner sees does not stay where it is: with it, scans were matched wrongly on slopes.

    Args:
        description: `grape.robots.RobotDescription`.

    Raises:
        InvalidInput: the base has no laser scanner.
    """

    def __init__(self, drivers: Drivers, description: Any) -> None:
        self._scanner = BaseScanner(drivers, description, SCAN_S)
        self._options = ScanOptions(mark_range=FARTHEST_M, clear_range=FARTHEST_M, ground=-description.base.height)
        self._odometry, self._ground = LaserOdometry(), MeanGround()

    def update(self, now: float, estimator: PoseEstimator) -> None:
        """Look at the newest scan, and let the filter have how the base has moved since the one before."""
        scan = self._scanner.due(now) if estimator.initialized else None
        if scan is None:
            return
        believed = estimator.odometry(scan.stamp)
        twist = np.array([believed.linear[0], believed.linear[1], believed.angular[2]])
        motion = self._odometry.take(scan.stamp, self._standing(scan, believed.pose), twist)
        if motion is not None:
            estimator.take_motion(motion.measurement())

    def _standing(self, scan: LaserScan, T_map_base: Array) -> Array:
        """(n, 2) m in base_link levelled, what stands out of the ground."""
        normal = self._ground.update(T_map_base)
        beams = beams_from_scan(plants_in_scan(scan), T_map_base, self._scanner.T_base_scan, self._options, normal)
        return transform_points(between(planar_of(T_map_base), np.zeros(3)), beams.ends[beams.hit])
