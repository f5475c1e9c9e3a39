"""Occupancy grids: free, occupied or unknown, with a probability.

Source: nav_msgs/OccupancyGrid; Thrun, Burgard and Fox, Probabilistic Robotics, 2005, chapter 9.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, frozen_array
from grape.navigation.grid import GridSpec

UNKNOWN = -1
FREE = 0
OCCUPIED = 100


@dataclass(frozen=True, kw_only=True)
class OccupancyGrid:
    """Occupancy of cells in the map frame: 0 free to 100 occupied in per cent, -1 unknown, as in nav_msgs.

    Args:
        spec: where the cells are; row 0 is at the lowest y.
        occupancy: (rows, columns) int8.

    Raises:
        InvalidInput: wrong shape or a value outside -1..100.
    """

    spec: GridSpec
    occupancy: Array

    def __post_init__(self) -> None:
        value = np.asarray(self.occupancy)
        if value.shape != (self.spec.rows, self.spec.columns):
            raise InvalidInput(f"occupancy must be {(self.spec.rows, self.spec.columns)}, got {value.shape}")
        if value.dtype.kind not in "iu" or value.min() < UNKNOWN or value.max() > OCCUPIED:
            raise InvalidInput(f"occupancy must be whole numbers from -1 to 100, got {value.dtype}")
        object.__setattr__(self, "occupancy", frozen_array(value, np.int8))

    def occupied(self, at_least: int = 65) -> Array:
        """Cells (rows, columns) that are occupied by `at_least` per cent."""
        return self.occupancy >= at_least

    def free(self, at_most: int = 25) -> Array:
        """Cells (rows, columns) that are known and occupied by `at_most` per cent."""
        return (self.occupancy >= 0) & (self.occupancy <= at_most)

    def known(self) -> Array:
        """Cells (rows, columns) that are not unknown."""
        return self.occupancy >= 0

    def at(self, points: Array) -> Array:
        """Occupancy (...,) of points (..., 2) m; unknown outside the grid."""
        cells = self.spec.cells(np.asarray(points))
        clipped = np.clip(cells, 0, [self.spec.rows - 1, self.spec.columns - 1])
        return np.where(self.spec.contains(cells), self.occupancy[clipped[..., 0], clipped[..., 1]], UNKNOWN)
