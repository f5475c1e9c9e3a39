"""Laser odometry in a mission: wheels that slip do not carry the estimate away, and it needs a scanner."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_ride import DESCRIPTION, SITE, PaperRide

from grape.errors import InvalidInput
from grape.localization import EstimatorOptions, PoseEstimator
from grape.messages import Array
from grape.mission.laser_motion import LaserMotion

MOUNT = np.array([*DESCRIPTION.mounts["front_laser"].T_parent_sensor[:2, 3], 0.0])
ANGLES = np.radians(np.arange(-135.0, 135.1, 0.5))
START = np.array([6.0, -1.2, 0.0])


class Ride(PaperRide):
    """A robot in the first row whose wheels say 0.5 m/s; GNSS is there for the first two seconds.

    Args:
        speed: m/s that it really moves with.
    """

    def __init__(self, speed: float, *, laser: bool = True) -> None:
        super().__init__(MOUNT, ANGLES, gnss_s=2.0)
        self.speed = speed
        if laser:
            self.listener = LaserMotion(self.drivers, DESCRIPTION)

    @property
    def pose(self) -> Array:
        return START + np.array([self.speed * max(0.0, self.now - 2.0), 0.0, 0.0])

    @property
    def rolled(self) -> float:
        return 0.5 * max(0.0, self.now - 2.0)


@pytest.mark.parametrize("speed", [0.0, 0.25, 0.5])
def test_the_estimate_moves_as_the_base_does_and_not_as_its_wheels(speed: float) -> None:
    ride = Ride(speed)
    assert ride.go(12.0) < 0.25
    assert ride.estimator.verdicts["laser", "accepted"] > 30
    assert Ride(speed, laser=False).go(12.0) > (3.5 if speed == 0.0 else -1.0)


def test_without_a_scan_nothing_happens() -> None:
    ride = Ride(0.5)
    ride.listener.update(0.0, PoseEstimator(EstimatorOptions(datum=SITE.datum)))
    ride.silent = True
    assert ride.go(4.0) < 0.1 and ride.estimator.verdicts["laser", "accepted"] == 0


def test_a_robot_without_a_laser_on_its_base_is_refused() -> None:
    drivers: Any = SimpleNamespace(scans={"wrist_lidar": None})
    with pytest.raises(InvalidInput, match="laser scanner on the base"):
        LaserMotion(drivers, DESCRIPTION)
