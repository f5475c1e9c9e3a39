"""What the base knows of its surroundings: prohibited areas of the site and obstacles of its range sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from grape.messages import Array, LaserScan, PointCloud
from grape.navigation.beams import ScanOptions, SliceOptions, beams_from_cloud, beams_from_scan
from grape.navigation.costmap import Beams, InflationOptions, Layer, ObstacleLayer, PolygonLayer, layered_costmap
from grape.navigation.grid import Costmap, Footprint, GridSpec
from grape.navigation.ground import MeanGround


@dataclass(frozen=True, kw_only=True)
class SurroundingsOptions:
    """Sizes in metres.

    Args:
        window: side of the rolling window in which obstacles are kept.
        margin: of the global grid around the site.
    """

    resolution: float = 0.05
    window: float = 10.0
    margin: float = 2.0
    footprint: Footprint = field(default_factory=Footprint)
    inflation: InflationOptions = field(default_factory=InflationOptions)
    scan: ScanOptions = field(default_factory=ScanOptions)
    slice: SliceOptions = field(default_factory=SliceOptions)


class Surroundings:
    """Layers of one base: polygons in map, and one rolling obstacle layer per range sensor.

    Each sensor clears only what it marked itself: a scanner that looks over a low obstacle does not erase it.

    Args:
        polygons: prohibited areas (n, 2) m in map.
        extent: points (n, 2) m that the global costmap must cover (rows, headlands, start).
        avoided: areas (n, 2) m in map to go round like obstacles, although nothing stands there, until `dare`.
    """

    def __init__(
        self,
        polygons: Sequence[Array],
        extent: Array,
        options: SurroundingsOptions | None = None,
        avoided: Sequence[Array] = (),
    ) -> None:
        self.options = options or SurroundingsOptions()
        self._prohibited, self._avoided = PolygonLayer(polygons), PolygonLayer(avoided)
        self._extent = GridSpec.around(np.asarray(extent, dtype=float), self.options.margin, self.options.resolution)
        self._sensors: dict[str, ObstacleLayer] = {}
        self._fences: Costmap | None = None
        self._ground = MeanGround()

    def add_scan(self, name: str, scan: LaserScan, T_map_base: Array, T_base_sensor: Array) -> Beams:
        """Mark and clear by a horizontal laser scan; returns the beams that it was taken for."""
        normal = self._ground.update(T_map_base)
        beams = beams_from_scan(scan, T_map_base, T_base_sensor, self.options.scan, normal)
        self._layer(name, T_map_base).integrate(beams)
        return beams

    def add_cloud(self, name: str, cloud: PointCloud, T_map_base: Array, T_base_sensor: Array) -> None:
        """Mark and clear by a 3-D scan, of which only what stands out of the ground counts."""
        normal = self._ground.update(T_map_base)
        self._layer(name, T_map_base).integrate(
            beams_from_cloud(cloud.points, T_map_base, T_base_sensor, self.options.slice, normal)
        )

    def forget(self, centre: Array, radius: float) -> None:
        """Drop the obstacles within `radius` m of `centre` (2,)."""
        for layer in self._sensors.values():
            layer.forget(centre, radius)

    def dare(self) -> bool:
        """Go through avoided areas from now on; whether there were any."""
        there_were, self._avoided = bool(self._avoided.polygons), PolygonLayer(())
        return there_were

    def local(self, centre: Array) -> Costmap:
        """Costs around `centre` (2,) m: obstacles and prohibited areas, inflated."""
        spec = GridSpec.window(centre, self.options.window, self.options.resolution)
        return layered_costmap(spec, self._layers(), self.options.inflation)

    def overall(self) -> Costmap:
        """Costs of the whole site with the obstacles that are known at the moment."""
        return layered_costmap(self._extent, self._layers(), self.options.inflation)

    def fences(self) -> Costmap:
        """Costs of the whole site by prohibited areas alone."""
        if self._fences is None:
            self._fences = layered_costmap(self._extent, [self._prohibited], self.options.inflation)
        return self._fences

    def obstacles(self) -> Array:
        """Middles (n, 2) m of the cells in which the sensors have seen an obstacle."""
        return np.vstack([np.zeros((0, 2)), *(layer.points() for layer in self._sensors.values())])

    def in_fence(self, pose: Array) -> bool:
        """Whether the footprint at `pose` (3,) x y yaw reaches into a prohibited area."""
        return bool(self.fences().blocked(pose, self.options.footprint)[0])

    def _layers(self) -> list[Layer]:
        return [*self._sensors.values(), self._avoided, self._prohibited]

    def _layer(self, name: str, T_map_base: Array) -> ObstacleLayer:
        centre = T_map_base[:2, 3]
        if name not in self._sensors:
            spec = GridSpec.window(centre, self.options.window, self.options.resolution)
            self._sensors[name] = ObstacleLayer(spec)
        self._sensors[name].move_to(centre)
        return self._sensors[name]
