"""Whether a hand on a straight way comes nearer to its target.

Source: the rule by which the reference's inverted differential kinematics gives up: the distance has grown, and the
first 2 to 3 cm of the way do not count.
"""

from __future__ import annotations

import numpy as np

from grape.errors import ActionFailed, Reason
from grape.messages import Array


class ApproachWatch:
    """Watches the distance to a target.

    Args:
        p_start: (3,) m, where the hand begins.
        p_target: (3,) m, in the same frame.
        grace_m: the distance may grow until this much was travelled ...
        growth_max_m: ... after that, at most this much above the smallest distance so far.
    """

    def __init__(self, p_start: Array, p_target: Array, grace_m: float = 0.025, growth_max_m: float = 0.006) -> None:
        self._start, self._target = np.array(p_start, float), np.array(p_target, float)
        self._grace_m, self._growth_max_m = grace_m, growth_max_m
        self.least_m = float(np.linalg.norm(self._target - self._start))

    def observe(self, p: Array) -> float:
        """The distance (m) from the hand at `p` (3,) m to the target.

        Raises:
            ActionFailed: DISTANCE_GROWS.
        """
        distance = float(np.linalg.norm(self._target - p))
        self.least_m = min(self.least_m, distance)
        travelled = float(np.linalg.norm(p - self._start))
        if travelled > self._grace_m and distance > self.least_m + self._growth_max_m:
            raise ActionFailed(
                Reason.DISTANCE_GROWS,
                f"{distance * 1e3:.1f} mm from the target after {self.least_m * 1e3:.1f} mm were reached",
            )
        return distance
