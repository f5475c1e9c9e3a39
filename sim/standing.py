"""Where things stand in a world: the true map beside which the robot's own is laid."""

from __future__ import annotations

import numpy as np

from grape.messages import Array
from grape.sim.worlds.model import Label, World

CELL_M = 0.1
BAND_M = (0.2, 1.8)  # over the ground: lower things are driven over, higher ones are no obstacle
UNSEEN = (Label.WIRE, Label.NAIL, Label.MARKER)  # too thin to be looked for in a grid


def standing_cells(world: World) -> Array:
    """Middles (n, 2) m in map of the cells of 0.1 m with something in the band of heights, in order."""
    points = [_rod(rod.p0, rod.p1) for rod in world.capsules if rod.label not in UNSEEN]
    for plate in world.plates:
        if plate.label not in UNSEEN:
            ends = [plate.T_map_plate[:3, 3] + s * plate.T_map_plate[:3, 0] * plate.half_size[0] for s in (-1.0, 1.0)]
            points.append(_rod(*ends))
    places = np.vstack([np.zeros((0, 3)), *points])
    height = places[:, 2] - world.terrain.height(places[:, :2])
    places = places[(height >= BAND_M[0]) & (height <= BAND_M[1])]
    cells: Array = np.unique(np.floor(places[:, :2] / CELL_M), axis=0)
    return (cells + 0.5) * CELL_M


def _rod(start: Array, end: Array) -> Array:
    """Points (n, 3) along a line, no two of them further apart than half a cell."""
    count = int(np.linalg.norm(end - start) / (0.5 * CELL_M)) + 2
    return np.linspace(start, end, count)
