"""What a run keeps of its drives, beside the poses of its track: `drive.jsonl`, one JSON line an observation."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from grape.drivers import Drivers
from grape.geometry import planar_of, rotation_to_rpy
from grape.localization import GnssConfig, wheel_speeds
from grape.localization.measurements import base_position
from grape.messages import Array, JointState
from grape.mission.record import cut_torn_line, read_events
from grape.mission.record_lines import DRIVES
from grape.world import Driving, World

WHEELS = "wheels"
ESTIMATE_PERIOD_S = 0.2
VIEW_PERIOD_S = 1.0  # while the base drives
CELL_M = 0.1
BEAM_STEP = 3  # of the scan's hits, every third
SCAN_REACH_M = 10.0


class DriveRecord:
    """Writes what the base goes by: fixes, dead reckoning by the wheels, plans, obstacles and scans.

    It reads only what the robot has read already, so that a run with it is the run without it.

    Args:
        path: file that gets every line as it comes; what an earlier session has left there goes on.
        base: `grape.robots.BaseDescription`.
        antenna: (3,) m of the GNSS receiver in base_link.
    """

    def __init__(self, path: Path, base: Any, antenna: Array) -> None:
        self._gnss = GnssConfig(antenna=antenna)
        self._base = base
        self._odometry: Array | None = None
        self._told: dict[str, Array] = {}
        self._last: JointState | None = None
        self._newest_fix = -1.0
        self._next_estimate = self._next_view = 0.0
        self._path: Any = None
        self._cells: set[tuple[int, int]] = set()
        earlier = path.exists()
        if earlier:
            cut_torn_line(path)
            self._take_up(path)
        self._file = path.open("a", encoding="utf-8", buffering=1)
        if not earlier:
            self._write(0.0, "robot", footprint=_rounded(base.footprint), cell_m=CELL_M)

    def observe(self, now: float, world: World, drivers: Drivers) -> None:
        """Note what is due; call it after the sensors were read."""
        if world.odometry is None or now < self._next_estimate:
            return
        self._next_estimate = now + ESTIMATE_PERIOD_S - 1e-6
        self._note_wheels(now, planar_of(world.odometry.pose), drivers)
        for source, place in world.estimates.items():
            self._note_estimate(now, source, place)
        self._note_fixes(world, drivers)
        self._note_drive(now, world.driving)

    def close(self) -> None:
        """No more lines."""
        self._file.close()

    def _note_wheels(self, now: float, estimate: Array, drivers: Drivers) -> None:
        """Where the robot would be by its wheels alone, from the first estimate on."""
        if self._odometry is None:
            self._odometry = estimate
        messages = drivers.base.since(self._last.stamp if self._last is not None else -1.0)
        if not messages:
            return
        message = messages[-1]
        if self._last is not None:
            left, right = wheel_speeds(self._last, message, self._base.wheel_radius)
            dt = message.stamp - self._last.stamp
            way, turn = 0.5 * (left + right) * dt, (right - left) / self._base.effective_track * dt
            x, y, yaw = self._odometry
            middle = yaw + 0.5 * turn
            self._odometry = np.array([x + way * np.cos(middle), y + way * np.sin(middle), yaw + turn])
        self._last = message
        self._note_estimate(now, WHEELS, self._odometry)

    def _note_estimate(self, now: float, source: str, place: Array) -> None:
        if source not in self._told or np.abs(place - self._told[source]).max() >= 0.01:
            self._told[source] = place
            self._write(now, "estimate", source=source, pose=_rounded(place))

    def _note_fixes(self, world: World, drivers: Drivers) -> None:
        assert world.odometry is not None
        rpy = rotation_to_rpy(world.odometry.pose[:3, :3])
        for fix in drivers.gnss.since(self._newest_fix):
            self._newest_fix = fix.stamp
            if fix.status == "none" or not np.isfinite([fix.latitude, fix.longitude, fix.altitude]).all():
                continue
            place = base_position(fix, world.site.datum, self._gnss, rpy)[:2]
            self._write(fix.stamp, "gnss", status=fix.status, place=_rounded(place))

    def _note_drive(self, now: float, driving: Driving | None) -> None:
        if driving is None:
            if self._path is not None:
                self._path = None
                self._write(now, "plan", points=[])
            return
        if driving.path is not self._path:
            self._path = driving.path
            self._write(now, "plan", points=_rounded(simplified(driving.path.poses[:, :2])))
        if now < self._next_view:
            return
        self._next_view = now + VIEW_PERIOD_S - 1e-6
        cells = set(map(tuple, np.floor(driving.surroundings.obstacles() / CELL_M).astype(int).tolist()))
        if cells != self._cells:
            added, gone = sorted(cells - self._cells), sorted(self._cells - cells)
            self._write(now, "obstacles", added=added, gone=gone)
            self._cells = cells
        near = driving.scan[np.hypot(*driving.scan.T) < SCAN_REACH_M][::BEAM_STEP]
        self._write(now, "scan", pose=_rounded(driving.scan_pose), points_cm=packed(near))

    def _write(self, stamp: float, kind: str, **fields: Any) -> None:
        line = {"t": round(stamp, 3), "kind": kind, **fields}
        self._file.write(json.dumps(line, separators=(",", ":")) + "\n")

    def _take_up(self, path: Path) -> None:
        for line in read_drive(path):
            if line["kind"] == "estimate":
                self._told[line["source"]] = np.array(line["pose"])
                self._odometry = self._told.get(WHEELS)
            elif line["kind"] == "gnss":
                self._newest_fix = line["t"]
            elif line["kind"] == "obstacles":
                self._cells = changed(self._cells, line)
            elif line["kind"] == "plan":
                self._path = line["points"] or None


def read_drive(path: Path) -> Iterator[dict[str, Any]]:
    """The lines of a run's drive.jsonl, oldest first; none where there is no such file."""
    return read_events(path, DRIVES) if path.exists() else iter(())


def changed(cells: set[tuple[int, int]], line: dict[str, Any]) -> set[tuple[int, int]]:
    """Obstacle cells after a line of kind `obstacles`."""
    return (cells | set(map(tuple, line["added"]))) - set(map(tuple, line["gone"]))


def packed(points: Array) -> str:
    """Points (n, 2) m as base64 of int16 centimetres, little-endian, x and y by turns."""
    return base64.b64encode(np.rint(100.0 * points).astype("<i2").tobytes()).decode("ascii")


def simplified(points: Array, tolerance: float = 0.02) -> Array:
    """The fewest of the points (n, 2) m of a line from which no other is further than the tolerance.

    Source: Douglas and Peucker, Algorithms for the reduction of the number of points, 1973.
    """
    kept, open_ = np.zeros(len(points), bool), [(0, len(points) - 1)]
    kept[[0, -1]] = True
    while open_:
        a, b = open_.pop()
        way, inner = points[b] - points[a], points[a + 1 : b] - points[a]
        if not len(inner):
            continue
        length = np.hypot(*way)
        along = np.clip(inner @ way / max(length, 1e-9) ** 2, 0.0, 1.0)
        off = np.hypot(*(inner - along[:, None] * way).T)
        worst = int(off.argmax())
        if off[worst] > tolerance:
            kept[a + 1 + worst] = True
            open_ += [(a, a + 1 + worst), (a + 1 + worst, b)]
    return points[kept]


def _rounded(value: Array) -> Any:
    return (np.round(value, 3) + 0.0).tolist()
