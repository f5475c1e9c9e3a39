"""A building with a corridor all around, drawn as a grid, a robot's way through it, and what its laser reads."""

from __future__ import annotations

import numpy as np

from grape.experiments.laser_worlds import BEAMS, MAX_RANGE, drifting, laser_scans
from grape.mapping.occupancy import OccupancyGrid
from grape.messages import Array, LaserScan
from grape.navigation.grid import GridSpec

__all__ = ["BEAMS", "MAX_RANGE", "building", "carmen_text", "drifting", "laser_scans", "way_round"]
CORNERS = np.array([[1.2, 1.2], [14.8, 1.2], [14.8, 8.8], [1.2, 8.8]])


def building(resolution: float = 0.05) -> OccupancyGrid:
    """Outer walls of 16 x 10 m, an inner block of rooms with doors, and pillars that make the corridors differ."""
    size = {"columns": round(16 / resolution), "rows": round(10 / resolution)}
    spec = GridSpec(x_min=0.0, y_min=0.0, resolution=resolution, **size)
    walls = np.zeros((spec.rows, spec.columns), np.int8)

    def box(x0: float, y0: float, x1: float, y1: float, value: int = 100) -> None:
        low, high = spec.cells(np.array([x0, y0])), spec.cells(np.array([x1, y1]))
        walls[low[0] : high[0] + 1, low[1] : high[1] + 1] = value

    for x0, y0, x1, y1 in ((0, 0, 16, 0.1), (0, 9.9, 16, 10), (0, 0, 0.1, 10), (15.9, 0, 16, 10)):
        box(x0, y0, x1 - 0.01, y1 - 0.01)
    box(2.4, 2.4, 13.6, 7.6)
    for x0, y0, x1, y1 in ((2.6, 2.6, 6.5, 7.4), (6.7, 2.6, 13.4, 4.9), (6.7, 5.1, 13.4, 7.4)):
        box(x0, y0, x1, y1, 0)
    for x0, y0, x1, y1 in ((4.0, 2.3, 5.0, 2.6), (9.0, 2.3, 9.9, 2.6), (11.5, 7.3, 12.5, 7.7), (13.3, 5.6, 13.7, 6.5)):
        box(x0, y0, x1, y1, 0)
    for x, y in ((7.0, 0.3), (11.8, 0.4), (15.6, 3.0), (15.5, 7.2), (10.0, 9.6), (4.4, 9.5), (0.4, 6.3), (0.5, 3.2)):
        box(x - 0.15, y - 0.15, x + 0.15, y + 0.15)
    return OccupancyGrid(spec=spec, occupancy=walls)


def way_round(rounds: float = 1.2, step: float = 0.2) -> Array:
    """Poses (n, 3) of a robot that drives round the corridor, counter-clockwise, turning on the spot at corners."""
    poses, side, driven = [], 0, 0.0
    total = rounds * 2 * (13.6 + 7.6)
    while driven < total:
        start, end = CORNERS[side % 4], CORNERS[(side + 1) % 4]
        length, yaw = float(np.abs(end - start).sum()), 0.5 * np.pi * (side % 4)
        if side:
            poses += [np.array([*start, yaw - 0.5 * np.pi + turn]) for turn in (0.3, 0.6, 0.9, 1.2, 1.5)]
        along = np.arange(0.0, min(length, total - driven), step)
        poses += [np.array([*(start + (end - start) * s / length), yaw]) for s in along]
        driven, side = driven + length, side + 1
    return np.array(poses)


def carmen_text(scans: list[LaserScan], odometry: Array, corrected: Array | None = None) -> str:
    """The log as CARMEN writes it: FLASER lines, with the corrected pose first where there is one."""
    lines = ["# CARMEN Logfile", "PARAM robot_frontlaser_offset 0.0 nohost 0"]
    for k, scan in enumerate(scans):
        pose = odometry[k] if corrected is None else corrected[k]
        ranges = " ".join(f"{min(r, 81.83):.3f}" for r in scan.ranges)
        numbers = " ".join(f"{value:.6f}" for value in (*pose, *odometry[k]))
        lines.append(
            f"ODOM {' '.join(f'{v:.6f}' for v in odometry[k])} 0.2 0 0 {scan.stamp:.3f} robot {scan.stamp:.3f}"
        )
        lines.append(f"FLASER {scan.ranges.size} {ranges} {numbers} {scan.stamp:.3f} robot {scan.stamp:.3f}")
    return "\n".join(lines) + "\n"
