"""How near the robot's base came to people and animals, and whether it touched them; for the referee."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

import numpy as np

from grape.messages import Array
from grape.sim.areas import distance_to_rods
from grape.sim.compose import WALKER_PREFIX
from grape.sim.worlds.walkers import Walkers


class Encounters:
    """Least distances between the base's footprint and each walker, seen from above.

    Args:
        footprint: (n, 2) m in base_link.
    """

    STATE: ClassVar[tuple[str, ...]] = ("least_m",)

    def __init__(self, walkers: Walkers, footprint: Array) -> None:
        self._walkers, self._footprint = walkers, footprint
        self.least_m = np.full(len(walkers.ids), np.inf)

    def observe(self, T_map_base: Array, time_s: float) -> None:
        """Look at where everybody is."""
        footprint = self._footprint @ T_map_base[:2, :2].T + T_map_base[:2, 3]  # map
        for k, (ends, radii) in enumerate(self._walkers.rods(time_s)):
            self.least_m[k] = min(self.least_m[k], distance_to_rods(footprint, ends[..., :2], radii))

    def summary(self, touched: Iterable[tuple[str, str]]) -> dict[str, Any]:
        """`walkers` of the truth, by id; `contacts` counts the parts of the robot that touched the walker.

        Args:
            touched: names of the parts that touched, the robot's first.
        """
        others = [other for _, other in touched]
        return {
            "walkers": {
                id: {
                    "least_distance_m": round(float(least), 3) if np.isfinite(least) else None,
                    "contacts": others.count(WALKER_PREFIX + id),
                }
                for id, least in zip(self._walkers.ids, self.least_m, strict=True)
            }
        }
