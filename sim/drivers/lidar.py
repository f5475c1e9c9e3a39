"""Simulated laser scanners: they note where they are at each due step and cast their rays only when read.

Rays meet the static world and who walks in it: the robot's own parts and the dispensers are not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from grape.messages import Array, LaserScan, PointCloud
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.physics import Physics, Replica
from grape.sim.sensors.noise import FrameNoise, SlowDrift
from grape.sim.sensors.ranges import BeamSpot, RangeModel, measured_ranges, spot_ranges, spot_rays

# Origins (n, 3) and unit directions (n, 3) in the map, and the time (s), to distances (n,), inf.
Cast = Callable[[Array, Array, float], Array]


@dataclass(frozen=True, kw_only=True)
class ScannerOptions:
    """A planar scanner: its site in the model (x ahead, z the axis of rotation), rate, beams and errors."""

    name: str
    period_s: float
    angle_min: float  # rad
    angle_increment: float
    beams: int
    errors: RangeModel
    spot: BeamSpot | None = None


UTM_30LX = ScannerOptions(
    name="front_laser",
    period_s=0.026,
    angle_min=-np.radians(135.0),
    angle_increment=np.radians(0.25),
    beams=1081,
    errors=RangeModel(range_min=0.1, range_max=30.0, sigma=0.010, systematic=0.005),
)
# 180 degrees in steps of half a degree take two turns of the mirror at 75 Hz.
LMS291 = ScannerOptions(
    name="front_laser",
    period_s=0.026,
    angle_min=-np.radians(90.0),
    angle_increment=np.radians(0.5),
    beams=361,
    errors=RangeModel(range_min=0.1, range_max=80.0, sigma=0.010, systematic=0.012),
)
TIM561 = ScannerOptions(
    name="wrist_lidar",
    period_s=0.066,
    angle_min=-np.radians(135.0),
    angle_increment=np.radians(1.0 / 3.0),
    beams=811,
    errors=RangeModel(range_min=0.05, range_max=10.0, sigma=0.0065, systematic=0.020),
    spot=BeamSpot(),
)


@dataclass(frozen=True, kw_only=True)
class SpinnerOptions:
    """A scanner with several layers of beams; one turn a message, taken as if at one instant."""

    name: str
    period_s: float
    elevations: Array  # rad, of the layers
    azimuths: Array  # rad, of the beams of each layer
    errors: RangeModel


VLP_16 = SpinnerOptions(
    name="velodyne",
    period_s=0.1,
    elevations=np.radians(np.arange(-15.0, 15.1, 2.0)),
    azimuths=2 * np.pi * np.arange(900) / 900,
    errors=RangeModel(range_min=0.9, range_max=100.0, sigma=0.008, systematic=0.003),
)
LD_MRS = SpinnerOptions(
    name="ld_mrs",
    period_s=0.08,
    elevations=np.radians([-1.2, -0.4, 0.4, 1.2]),
    azimuths=np.radians(np.linspace(-42.5, 42.5, 341)),
    errors=RangeModel(range_min=0.5, range_max=300.0, sigma=0.1),
)
# By what their makers call them.
SCANNERS: Mapping[str, ScannerOptions] = {"UTM-30LX": UTM_30LX, "LMS291": LMS291, "TiM561": TIM561}
SPINNERS: Mapping[str, SpinnerOptions] = {"VLP-16": VLP_16, "LD-MRS400001": LD_MRS}


class _Bias:
    """Half of the systematic error stays during a run, half wanders."""

    def __init__(self, noise: FrameNoise, sigma: float) -> None:
        rng = noise.constant()
        self._constant = sigma / np.sqrt(2.0) * rng.standard_normal()
        self._drift = SlowDrift(rng, sigma / np.sqrt(2.0), 1, (100.0, 1000.0))

    def at(self, time_s: float) -> float:
        return float(self._constant + self._drift.at(time_s)[0])


class SimulatedScanner(SampledSensor[LaserScan]):
    """A planar laser scanner."""

    def __init__(self, physics: Physics, replica: Replica, cast: Cast, seed: int, options: ScannerOptions) -> None:
        super().__init__(physics, options.name, options.period_s)
        self._options = options
        self._replica = replica
        self._cast = cast
        self._site = physics.identify("site", options.name)
        self._noise = FrameNoise(seed, options.name)
        self._bias = _Bias(self._noise, options.errors.systematic)
        angles = options.angle_min + options.angle_increment * np.arange(options.beams)
        self._directions = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)

    def _snapshot(self) -> Array:
        return self._physics.snapshot()

    def _measure(self, index: int, stamp: float, snapshot: Array) -> LaserScan:
        options = self._options
        T_map_sensor = self._replica.site_pose(snapshot, self._site)
        return LaserScan(
            stamp=stamp,
            frame_id=options.name,
            angle_min=options.angle_min,
            angle_increment=options.angle_increment,
            range_min=options.errors.range_min,
            range_max=options.errors.range_max,
            ranges=measured_ranges(
                self._true_ranges(T_map_sensor, stamp), self._bias.at(stamp), options.errors, self._noise.frame(index)
            ),
            scan_time=options.period_s,
        )

    def _true_ranges(self, T_map_sensor: Array, stamp: float) -> Array:
        R, origin = T_map_sensor[:3, :3], T_map_sensor[:3, 3]
        directions = self._directions @ R.T
        if self._options.spot is None:
            return self._cast(np.broadcast_to(origin, directions.shape), directions, stamp)
        origins, rays = spot_rays(origin, directions, R[:, 2], self._options.spot)
        distances = self._cast(origins.reshape(-1, 3), rays.reshape(-1, 3), stamp)
        return spot_ranges(distances.reshape(rays.shape[:2]))


class SimulatedSpinner(SampledSensor[PointCloud]):
    """A laser scanner of several layers that gives points in its own frame."""

    def __init__(self, physics: Physics, replica: Replica, cast: Cast, seed: int, options: SpinnerOptions) -> None:
        super().__init__(physics, options.name, options.period_s)
        self._options = options
        self._replica = replica
        self._cast = cast
        self._site = physics.identify("site", options.name)
        self._noise = FrameNoise(seed, options.name)
        self._bias = _Bias(self._noise, options.errors.systematic)
        elevation, azimuth = (grid.ravel() for grid in np.meshgrid(options.elevations, options.azimuths))
        level = np.cos(elevation)
        self._directions = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)

    def _snapshot(self) -> Array:
        return self._physics.snapshot()

    def _measure(self, index: int, stamp: float, snapshot: Array) -> PointCloud:
        options = self._options
        T_map_sensor = self._replica.site_pose(snapshot, self._site)
        directions = self._directions @ T_map_sensor[:3, :3].T
        true = self._cast(np.broadcast_to(T_map_sensor[:3, 3], directions.shape), directions, stamp)
        ranges = measured_ranges(true, self._bias.at(stamp), options.errors, self._noise.frame(index))
        hit = np.isfinite(ranges)
        return PointCloud(stamp=stamp, frame_id=options.name, points=self._directions[hit] * ranges[hit, None])
