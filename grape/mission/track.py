"""Where the robot thought it was, and next to it where it was."""

from __future__ import annotations

import numpy as np

from grape.geometry import yaw_of
from grape.messages import Array


class Track:
    """The estimated path, five poses a second."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, float, float, float]] = []
        self._distance_m = 0.0

    def add(self, stamp: float, estimate: Array, speed: float) -> None:
        """One sample.

        Args:
            stamp: s.
            estimate: `T_map_base_link` (4, 4).
            speed: forward speed of the estimate, m/s.
        """
        if self._rows:
            self._distance_m += abs(speed) * (stamp - self._rows[-1][0])
        self._rows.append((stamp, float(estimate[0, 3]), float(estimate[1, 3]), yaw_of(estimate)))

    @property
    def samples(self) -> Array:
        """(n, 4): stamp, x, y, yaw."""
        return np.array(self._rows).reshape(-1, 4)

    @property
    def distance_m(self) -> float:
        """Distance driven by the estimate's own speed."""
        return self._distance_m

    def to_csv(self, truth: Array | None = None) -> str:
        """A table of the estimate and, interpolated to the same stamps, of the true path.

        Args:
            truth: (m, 4) stamp, x, y, yaw.
        """
        header = "t_s,x_m,y_m,yaw_rad"
        rows = self.samples
        if truth is not None and len(truth) and len(rows):
            true = [np.interp(rows[:, 0], truth[:, 0], column) for column in (truth[:, 1], truth[:, 2])]
            yaw = np.interp(rows[:, 0], truth[:, 0], np.unwrap(truth[:, 3]))
            header += ",true_x_m,true_y_m,true_yaw_rad"
            rows = np.column_stack([rows, *true, np.remainder(yaw + np.pi, 2 * np.pi) - np.pi])
        lines = (",".join(f"{value:.4f}" for value in row) for row in rows)
        return "\n".join([header, *lines]) + "\n"
