"""How likely it is that a beam ends at a place of a map: the likelihood field.

Source: Thrun, Burgard and Fox, Probabilistic Robotics, 2005, section 6.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.mapping.occupancy import OccupancyGrid
from grape.messages import Array, frozen_array


@dataclass(frozen=True, kw_only=True)
class FieldOptions:
    """A beam's end is at distance d of something with `hit` exp(-d^2 / 2 sigma^2), or anywhere with 1 - `hit`.

    Beyond `reach` m distances count alike.
    """

    sigma: float = 0.15
    hit: float = 0.9
    reach: float = 2.0

    def __post_init__(self) -> None:
        if not (self.sigma > 0 and 0 < self.hit < 1 and self.reach > 0):
            raise InvalidInput(f"sigma and reach above 0 and hit between 0 and 1 needed, got {self}")


class LikelihoodField:
    """Logarithms of likelihoods, one a cell of a map, and where a robot may be.

    Args:
        grid: the map; cells of 65 per cent and more are occupied, known ones of up to 25 per cent free.

    Raises:
        InvalidInput: nothing in the map is occupied, or nothing free.
    """

    def __init__(self, grid: OccupancyGrid, options: FieldOptions | None = None) -> None:
        from scipy.ndimage import distance_transform_edt

        self.options = options or FieldOptions()
        self.spec = grid.spec
        occupied, free = grid.occupied(), grid.free()
        if not occupied.any() or not free.any():
            raise InvalidInput("a map to localise in needs occupied and free cells")
        distance = np.minimum(distance_transform_edt(~occupied) * grid.spec.resolution, self.options.reach)
        hit = self.options.hit
        field = np.log(hit * np.exp(-0.5 * (distance / self.options.sigma) ** 2) + (1.0 - hit))
        self.outside = float(np.log(1.0 - hit))
        self.bordered = frozen_array(np.pad(field, 1, constant_values=self.outside), np.float32)
        self._free_cells = np.argwhere(free)

    @property
    def log_likelihood(self) -> Array:
        """(rows, columns) of the cells; `bordered` has one cell more on each side, which holds beyond the map."""
        return self.bordered[1:-1, 1:-1]

    def free_poses(self, count: int, rng: np.random.Generator) -> Array:
        """Poses (count, 3) x y yaw drawn evenly from the free cells."""
        cells = self._free_cells[rng.integers(len(self._free_cells), size=count)]
        places = self.spec.centres(cells) + (rng.random((count, 2)) - 0.5) * self.spec.resolution
        return np.column_stack([places, rng.uniform(-np.pi, np.pi, count)])
