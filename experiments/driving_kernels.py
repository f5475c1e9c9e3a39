"""Compiled loop of `grape.experiments.driving_yard`."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.messages import Array


@njit(cache=True)
def ranges_to_circles(circles: Array, x: float, y: float, first: float, step: float, count: int) -> Array:
    """Distances (count,) m from (x, y) to the nearest of circles (n, 3) x y radius; inf where a beam meets none.

    Args:
        first, step: rad in map, direction of the first beam and the angle to the next.
    """
    ranges = np.full(count, np.inf)
    for n in range(circles.shape[0]):
        dx, dy, radius = circles[n, 0] - x, circles[n, 1] - y, circles[n, 2]
        distance = np.sqrt(dx * dx + dy * dy)
        if distance <= radius:
            continue
        half = np.arcsin(radius / distance)
        # the first beam is at angle 0 here, so that the circle lies at 0 .. 2 pi
        bearing = (np.arctan2(dy, dx) - first) % (2.0 * np.pi)
        for turn in (-2.0 * np.pi, 0.0):
            low = max(0, int(np.ceil((bearing + turn - half) / step)))
            high = min(count - 1, int(np.floor((bearing + turn + half) / step)))
            for k in range(low, high + 1):
                aside = bearing + turn - k * step
                across = distance * np.sin(aside)
                reach = distance * np.cos(aside) - np.sqrt(max(0.0, radius * radius - across * across))
                ranges[k] = min(ranges[k], reach)
    return ranges
