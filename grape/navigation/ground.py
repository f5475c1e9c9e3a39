"""How the ground slopes, by how the base has stood on it."""

from __future__ import annotations

import numpy as np

from grape.messages import Array

FIRST_M = 0.3  # what one stand counts for: about as far as a bump reaches


class MeanGround:
    """The mean slope of the ground under the last metres.

    A base on a bump is tilted against the slope that it drives on: neither the plane that it stands on nor the level
    through its feet is the ground ahead then, but the slope is.

    Args:
        reach: m of the way that the mean is taken over.
    """

    def __init__(self, reach: float = 3.0) -> None:
        self._reach = reach
        self._place = np.zeros(3)
        self._way = 0.0
        self._mean = np.array([0.0, 0.0, 1.0])

    def update(self, T_map_base: Array) -> Array:
        """(3,) normal of the ground in map, with the base standing at `T_map_base` (4, 4)."""
        place, up = T_map_base[:3, 3], T_map_base[:3, 2]
        if self._way == 0.0:
            self._place, self._way, self._mean = place.copy(), FIRST_M, up.copy()
            return self._mean
        step = float(np.linalg.norm(place - self._place))
        share = step / (min(self._way, self._reach) + step)
        mean = self._mean + share * (up - self._mean)
        self._place, self._way, self._mean = place.copy(), self._way + step, mean / np.linalg.norm(mean)
        return self._mean
