"""The vineyard of a skid-steer session as a laser sees it, a map surveyed of it, and the filter with AMCL."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grape.experiments.laser_worlds import MAX_RANGE, VINE_SPACING, Canvas, laser_scans
from grape.experiments.skid_steer_log import DATUM, ROW_SPACING_M, SkidSteerLog, skid_steer_sensors
from grape.localization import (
    AmclInput,
    AmclInputOptions,
    AmclOptions,
    Discord,
    Fusion,
    LikelihoodField,
    OdometryNoise,
    Reading,
)
from grape.mapping import OccupancyGrid
from grape.messages import LaserScan

ROWS = range(-1, 4)  # the session drives between those of 0 to 2
VINES = 61
POST_EVERY = 4
AREA = ((-9.0, -5.0), (89.0, 16.0))  # m, corner in map and size
TREES = ((-8.0, -6.0), (76.0, 79.0))  # m, x beyond the headlands
MOUNT = np.array([0.45, 0.0, 0.0])  # x y yaw of the laser on the base
SCAN_S = 0.5
CLUTTER = 0.1  # share of the beams
SURVEY_STD = 0.03  # m, of each plant and post in the map
GONE = 0.06  # share of the vines that died before the survey, and again since
LISTEN_S = 0.1
RELOCATE_AFTER = 60  # fixes; with AMCL beside it a filter need not follow GNSS elsewhere at once
ODOMETRY_NOISE = OdometryNoise(turn_by_turn=0.01, turn_by_way=5e-4, way_by_way=0.01, way_by_turn=0.01)


def vineyard_and_map(seed: int) -> tuple[OccupancyGrid, OccupancyGrid]:
    """What stands there, and the map: surveyed before some vines died, each thing a little off."""
    rng = np.random.default_rng([seed, 5])
    truth, survey = (Canvas(*AREA[1], corner=AREA[0]) for _ in range(2))

    def put(x: float, y: float, radius: float, *, stands: bool = True) -> None:
        if stands:
            truth.disc(x, y, radius)
        off = SURVEY_STD * rng.standard_normal(2)
        survey.disc(x + off[0], y + off[1], radius)

    for row in ROWS:
        y = ROW_SPACING_M * row
        for vine in range(VINES):
            x = VINE_SPACING * vine
            if vine % POST_EVERY == 0:
                put(x + 0.5 * VINE_SPACING, y, 0.04)
            if rng.random() > GONE:
                at = x + rng.normal(0, 0.06), y + rng.normal(0, 0.04)
                put(*at, rng.uniform(0.02, 0.05), stands=rng.random() > GONE)
    for near, far in TREES:
        for _ in range(4):
            put(rng.uniform(near, far), rng.uniform(AREA[0][1] + 0.5, AREA[0][1] + AREA[1][1] - 0.5), 0.2)
    return truth.grid(), survey.grid()


def session_scans(log: SkidSteerLog, truth: OccupancyGrid) -> list[LaserScan]:
    """Scans of a log, two a second, with weeds and people that no map has."""
    stamps = np.arange(SCAN_S, log.stamps[-1], SCAN_S)
    poses = log.poses[[log.index(stamp) for stamp in stamps]]
    scans = laser_scans(truth, poses, np.random.default_rng([log.seed, 6]), mount=MOUNT, clutter=CLUTTER)
    return [replace(scan, stamp=float(stamp)) for stamp, scan in zip(stamps, scans, strict=True)]


class FilterWithAmcl:
    """One filter of wheels, IMU, GNSS and AMCL on the surveyed map; AMCL hears the filter's velocities and the scans.

    Args:
        scans: in the order of their stamps.
    """

    def __init__(self, log: SkidSteerLog, survey: OccupancyGrid, scans: list[LaserScan]) -> None:
        sensors = skid_steer_sensors()
        sensors["gnss"] = replace(sensors["gnss"], relocate_after=RELOCATE_AFTER)
        self.fusion = Fusion(sensors, datum=DATUM)
        options = AmclInputOptions(amcl=AmclOptions(max_range=MAX_RANGE, noise=ODOMETRY_NOISE))
        self.input = AmclInput(LikelihoodField(survey), np.random.default_rng([log.seed, 7]), options, MOUNT)
        self._scans = iter(scans)
        self._scan = next(self._scans, None)
        self._heard = 0.0

    @property
    def discords(self) -> tuple[Discord, ...]:
        """Of all sources of poses."""
        return (*self.fusion.discords, *([self.input.discord] if self.input.discord else []))

    def take(self, reading: Reading) -> None:
        """A reading, and then the scans up to its stamp."""
        self.fusion.take(reading)
        if self.fusion.started and reading.stamp >= self._heard + LISTEN_S - 1e-9:
            self._heard = reading.stamp
            self.input.advance(self.fusion.odometry(reading.stamp))
        while self._scan is not None and self._scan.stamp <= reading.stamp:
            if self.fusion.started:
                self._weigh(self._scan)
            self._scan = next(self._scans, None)

    def _weigh(self, scan: LaserScan) -> None:
        measurement = self.input.take(scan, self.fusion.odometry(scan.stamp))
        if measurement is not None:
            self.fusion.correct(measurement)
