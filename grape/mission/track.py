"""Where the robot thought it was, and next to it where it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grape.errors import FileError, Problem
from grape.geometry import yaw_of
from grape.messages import Array
from grape.mission.record import cut_torn_line

HEADER = "t_s,x_m,y_m,yaw_rad,distance_m,wall_s\n"


def csv_of(header: str, rows: Array) -> str:
    """A table of numbers (n, columns) with four decimals."""
    lines = (",".join(f"{value:.4f}" for value in row) for row in rows)
    return "\n".join([header, *lines]) + "\n"


class Track:
    """The estimated path, five poses a second.

    Args:
        path: file that gets every pose as it is added, so that a kill loses none; poses that it holds are taken up.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._rows: list[tuple[float, float, float, float]] = []
        self._distance_m = self._wall_s = 0.0
        self._file = None
        if path is None:
            return
        if path.exists():
            cut_torn_line(path)
            self._take_up(path)
        self._file = path.open("a", encoding="utf-8", buffering=1)
        if not path.stat().st_size:
            self._file.write(HEADER)

    def add(self, stamp: float, estimate: Array, speed: float, wall_s: float = 0.0) -> None:
        """One sample.

        Args:
            stamp: s.
            estimate: `T_map_base_link` (4, 4).
            speed: forward speed of the estimate, m/s.
            wall_s: time of the wall clock that the mission has taken so far.
        """
        if self._rows:
            self._distance_m += abs(speed) * (stamp - self._rows[-1][0])
        self._rows.append((stamp, float(estimate[0, 3]), float(estimate[1, 3]), yaw_of(estimate)))
        self._wall_s = wall_s
        if self._file is not None:
            self._file.write(",".join(repr(float(v)) for v in (*self._rows[-1], self._distance_m, wall_s)) + "\n")

    @property
    def samples(self) -> Array:
        """(n, 4): stamp, x, y, yaw."""
        return np.array(self._rows).reshape(-1, 4)

    @property
    def distance_m(self) -> float:
        """Distance driven by the estimate's own speed."""
        return self._distance_m

    @property
    def wall_s(self) -> float:
        """Time of the wall clock at the last sample."""
        return self._wall_s

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
        return csv_of(header, rows)

    def close(self) -> None:
        """No more samples."""
        if self._file is not None:
            self._file.close()

    def _take_up(self, path: Path) -> None:
        for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines()[1:], start=2):
            try:
                stamp, x, y, yaw, self._distance_m, self._wall_s = (float(value) for value in line.split(","))
            except ValueError as error:
                raise FileError([Problem(file=str(path), line=number, got="damaged, no six numbers")]) from error
            self._rows.append((stamp, x, y, yaw))
