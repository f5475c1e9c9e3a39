"""Collision monitor: holds every command of the base against zones around it and against time to contact.

It reads raw scans and knows neither map nor plan, so no error of these can talk it out of stopping.

Source: Nav2 collision monitor (stop, slowdown and approach models; zones per direction as its velocity polygons).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Literal, Protocol

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, LaserScan
from grape.navigation.beams import ScanOptions, scan_points
from grape.navigation.grid import Footprint
from grape.navigation.monitor import arc_poses
from grape.navigation.polygon import in_polygon

Motion = Literal["forward", "backward", "turn"]
APPROACH = "approach"  # name of the zone in time
SCAN = "scan"  # name that decides when the scan itself cannot be used
_STILL = 1e-6  # m/s or rad/s


class Zone(Protocol):
    """An area in base_link in which anything slows the base down; `grape.robots.SafetyZone` is one."""

    @property
    def name(self) -> str: ...

    @property
    def polygon(self) -> Array: ...  # (n, 2) m

    @property
    def motions(self) -> tuple[Motion, ...]: ...

    @property
    def speed(self) -> float: ...  # m/s that is allowed while something is inside; 0 stops


class Verdict(StrEnum):
    """What becomes of a command."""

    GO = "go"
    SLOW = "slow"
    STOP = "stop"


@dataclass(frozen=True, kw_only=True)
class CollisionOptions:
    """Zone in time and hysteresis.

    Args:
        footprint: of the robot; returns inside it are the robot itself.
        ahead: m that the zone in time reaches beyond the footprint where the motion leads to; `lateral` m elsewhere.
        approach_s: a command that would touch something sooner is slowed until it would not.
        stop_s: a command that would touch something sooner than this is not carried out at all.
        least_points: fewer returns than this are noise.
        release_m: a zone in which something is reaches this much farther.
        release_s: for so long nothing must be in a zone before it lets go.
        blind: largest share of beams without a valid answer (NaN).
    """

    footprint: Footprint = field(default_factory=Footprint)
    ahead: float = 0.12
    lateral: float = 0.02
    approach_s: float = 0.6
    stop_s: float = 0.2
    least_points: int = 3
    release_m: float = 0.05
    release_s: float = 0.3
    blind: float = 0.2

    def __post_init__(self) -> None:
        if not (0.0 < self.stop_s < self.approach_s and self.least_points >= 1 and 0.0 <= self.blind < 1.0):
            raise InvalidInput(f"needs 0 < stop_s < approach_s, least_points >= 1 and 0 <= blind < 1, got {self}")


@dataclass(frozen=True, kw_only=True)
class MonitorState:
    """What is remembered between decisions: the zones that hold, and until when (s) each does at least."""

    holds: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What is left of a command: `factor` 0..1 of both velocities; which zone and point (m, base_link) decided."""

    verdict: Verdict
    factor: float
    zone: str = ""
    point: tuple[float, float] | None = None
    state: MonitorState = field(default_factory=MonitorState)


class CollisionMonitor:
    """Judges commands by raw points; stateless, see `decide`.

    Args:
        zones: of the robot.
    """

    def __init__(self, zones: Sequence[Zone], options: CollisionOptions | None = None) -> None:
        self.options = options or CollisionOptions()
        names = [zone.name for zone in zones]
        if len(set(names)) < len(names) or {APPROACH, SCAN} & set(names):
            raise InvalidInput(f"zones need names of their own, not {APPROACH} or {SCAN}, got {names}")
        self._zones = tuple(zones)

    def decide(self, v: float, w: float, points: Array, now: float, state: MonitorState) -> Decision:
        """What is left of a command of v (m/s) and w (rad/s).

        Args:
            points: (n, 2) m in base_link, as of `scan_hits`.
            now: s.
            state: of the decision before.
        """
        motion = motion_of(v, w)
        if motion is None:
            return Decision(verdict=Verdict.GO, factor=1.0, state=state)
        until, holds = now + self.options.release_s, dict(state.holds)
        found = [self._judge(zone, pace(v, w, self.options.footprint), points, holds, now)
                 for zone in self._zones if motion in zone.motions]  # fmt: skip
        found.append(self._approach(v, w, points, holds, now))
        for _, name, point in found:
            if point is not None:
                holds[name] = until
        factor, name, point = min(found, key=lambda entry: entry[0])
        kept = MonitorState(holds=tuple((key, end) for key, end in holds.items() if end > now))
        if factor >= 1.0:
            return Decision(verdict=Verdict.GO, factor=1.0, state=kept)
        verdict = Verdict.SLOW if factor > 0.0 else Verdict.STOP
        place = None if point is None else (float(point[0]), float(point[1]))
        return Decision(verdict=verdict, factor=factor, zone=name, point=place, state=kept)

    def _judge(
        self, zone: Zone, speed: float, points: Array, holds: dict[str, float], now: float
    ) -> tuple[float, str, Array | None]:
        """Factor by one zone, its name, and the point in it that is nearest to the robot's centre."""
        held = holds.get(zone.name, -np.inf) > now
        inside = points[in_polygon(points, zone.polygon, self.options.release_m if held else 0.0)]
        if len(inside) >= self.options.least_points:
            return min(1.0, zone.speed / speed), zone.name, inside[np.argmin((inside**2).sum(axis=1))]
        return (min(1.0, zone.speed / speed) if held else 1.0), zone.name, None

    def _approach(
        self, v: float, w: float, points: Array, holds: dict[str, float], now: float
    ) -> tuple[float, str, Array | None]:
        """Factor by the time to contact: what would touch in t is slowed to touch in `approach_s`."""
        options = self.options
        contact_s, point = time_to_touch(v, w, points, options)
        held = holds.get(APPROACH, -np.inf) > now
        if contact_s <= options.stop_s * (1.5 if held else 1.0):
            return 0.0, APPROACH, point
        if held and point is None:
            return 0.0, APPROACH, None
        return min(1.0, contact_s / options.approach_s), APPROACH, None


def motion_of(v: float, w: float) -> Motion | None:
    """Which way a command leads; None when it stands."""
    if abs(v) > _STILL:
        return "forward" if v > 0.0 else "backward"
    return "turn" if abs(w) > _STILL else None


def pace(v: float, w: float, footprint: Footprint) -> float:
    """m/s of the base along its heading or, when it turns in place, of its outermost corner."""
    return abs(v) if abs(v) > _STILL else abs(w) * footprint.circumscribed


def scan_hits(scan: LaserScan, T_base_sensor: Array, options: CollisionOptions) -> tuple[Array, float]:
    """Returns (n, 2) m in base_link of a scan without the robot itself, and the share of its beams that are NaN.

    Beams that report something too near (-inf, REP-117) count at the sensor's shortest range.
    """
    ranges = np.asarray(scan.ranges)
    near = np.isneginf(ranges) | (ranges < scan.range_min)
    seen = replace(scan, ranges=np.where(near, scan.range_min, ranges))
    blind = float(np.isnan(ranges).mean()) if ranges.size else 1.0
    return scan_points(seen, T_base_sensor, ScanOptions(own=options.footprint))[:, :2], blind


def blind_stop(state: MonitorState) -> Decision:
    """The decision when there is no scan to decide by."""
    return Decision(verdict=Verdict.STOP, factor=0.0, zone=SCAN, state=replace(state))


def time_to_touch(v: float, w: float, points: Array, options: CollisionOptions) -> tuple[float, Array | None]:
    """Seconds until `least_points` of the points (n, 2) m are touched, and the first of them; (inf, None) beyond
    `approach_s`.

    A point touches when it comes into the footprint with its margins; one that is in the margins already, when the
    motion brings it into the footprint itself.
    """
    print_ = options.footprint
    grown = Footprint(
        front=print_.front + (options.ahead if v > 0 else options.lateral),
        rear=print_.rear + (options.ahead if v < 0 else options.lateral),
        half_width=print_.half_width + options.lateral,
    )
    reach = grown.circumscribed + abs(v) * options.approach_s
    near = points[(points**2).sum(axis=1) < reach**2]
    if len(near) < options.least_points:
        return np.inf, None
    within = grown.contains(near)
    times = np.linspace(0.0, options.approach_s, 13)
    x, y, yaw = arc_poses(v, w, times).T[:, :, None]
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy = near[:, 0] - x, near[:, 1] - y
    moved = np.stack([c * dx + s * dy, -s * dx + c * dy], axis=-1)  # (times, n, 2)
    touched = np.where(within, print_.contains(moved), grown.contains(moved))
    enough = touched.sum(axis=1) >= options.least_points
    if not enough.any():
        return np.inf, None
    first = int(np.argmax(enough))
    return float(times[first]), near[np.argmax(touched[first])]
