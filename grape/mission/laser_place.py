"""The robot's place on a map by a laser of its base, beside the mission's filter and as one more input of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from grape.actions.core import Recorder
from grape.drivers import Drivers
from grape.geometry import planar_of
from grape.localization import (
    AmclInput,
    AmclInputOptions,
    AmclOptions,
    Discord,
    LikelihoodField,
    OdometryNoise,
    PoseEstimator,
)
from grape.mapping import OccupancyGrid
from grape.messages import Array, LaserScan
from grape.mission.base_scanner import BaseScanner

LISTEN_S = 0.1  # between the velocities that AMCL hears
SCAN_S = 0.25
# A base that skids round is shifted by up to 0.2 m a radian. Rows repeat themselves, so no place is searched anywhere
# else: an AMCL that the filter contradicts for long begins anew around it.
OPTIONS = AmclInputOptions(
    amcl=AmclOptions(
        beams=120,
        effective_beams=30.0,
        recovery_slow=0.0,
        recovery_fast=0.0,
        noise=OdometryNoise(turn_by_turn=0.01, turn_by_way=5e-4, way_by_way=0.01, way_by_turn=0.08),
    )
)


class LaserPlace:
    """Runs AMCL on the scans of the first scanner that is mounted on the base.

    Args:
        description: `grape.robots.RobotDescription`.
        rng: AMCL's chance.
        log: hears when AMCL and the filter part, and when they are one again.
        seen: what of a scan can be on the map.

    Raises:
        InvalidInput: the base has no laser scanner, or there is nothing on the map.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        drivers: Drivers,
        description: Any,
        rng: np.random.Generator,
        log: Recorder,
        *,
        seen: Callable[[LaserScan], LaserScan] = lambda scan: scan,
    ) -> None:
        self._scanner = BaseScanner(drivers, description, SCAN_S)
        self._input = AmclInput(LikelihoodField(grid), rng, OPTIONS, planar_of(self._scanner.T_base_scan))
        self._seen = seen
        self._log = log
        self._told: Discord | None = None
        self._listen_s = 0.0

    @property
    def pose(self) -> Array | None:
        """(3,) x y yaw in map by the newest scan that was used; None before the first."""
        return None if self._input.estimate is None else self._input.estimate.pose

    def update(self, now: float, estimator: PoseEstimator) -> None:
        """Hear the filter's velocity, look at the newest scan, and let the filter have what it says."""
        if not estimator.initialized or now < self._listen_s:
            return
        self._listen_s = now + LISTEN_S - 1e-6
        self._input.advance(estimator.odometry(now))
        scan = self._scanner.due(now)
        if scan is None:
            return
        measurement = self._input.take(self._seen(scan), estimator.odometry(scan.stamp))
        if measurement is not None:
            estimator.correct(measurement)
        self._tell()

    def _tell(self) -> None:
        before, self._told = self._told, self._input.discord
        if before is None and self._told is not None:
            sigma, since = round(self._told.sigma, 1), self._told.since
            self._log.event("discord", source="amcl", apart=True, sigma=sigma, since=since)
        elif before is not None and self._told is None:
            self._log.event("discord", source="amcl", apart=False)
