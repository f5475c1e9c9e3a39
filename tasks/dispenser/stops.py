"""Where to stop beside a vine or a nail, so that the arm reaches as many places to hang a dispenser as it can.

A stop is told by where it has the plant. Before anything of the plant was seen, the places are those where spurs and
nails usually are; afterwards they are the deployment poses that were found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from grape.actions.move_arm import densely
from grape.actions.robot import Robot
from grape.messages import Array
from grape.planning.placement import Placement, choose_stop, reach_margins
from grape.tasks.dispenser.targets import HangTarget, hang_line

SPUR_STAND_OFF_M, NAIL_STAND_OFF_M = 0.10, 0.24  # how far before the tip the hand begins, at most
PITCHES = tuple(float(p) for p in np.radians((55.0, 65.0, 40.0)))  # rad, of the hand over a spur, best first
AZIMUTHS = tuple(float(a) for a in np.radians((0.0, 25.0, -25.0, 50.0, -50.0)))  # and its turn about the vertical
STEP_M = 0.04  # between the hand poses that are looked at


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A stop beside a plant, the row on the left.

    Attributes:
        ahead_m: the plant is this far before the arm's base, along the row; negative behind it.
        beside_m: from the robot's left side to the row's line.
    """

    ahead_m: float
    beside_m: float

    def plant_in_base(self, description: Any) -> Array:
        """(2,) m, where the plant is in base_link of a robot (`grape.robots.RobotDescription`)."""
        arm_x = float(description.arm.T_base_link_arm_base[0, 3])
        return np.array([arm_x + self.ahead_m, description.base.half_width + self.beside_m])


@dataclass(frozen=True, kw_only=True)
class StopOptions:
    """Which stops there are.

    Attributes:
        ahead_m, beside_m: see `Stop`; every pair is a stop.
        first_within_m: how far off the middle the first stop is at most.
        ahead_cost: score a metre off the middle costs: the sweep of a scan has the arm's base in its middle.
        apart_m: how far from the first stop another one is at least.
    """

    ahead_m: tuple[float, ...] = tuple(k / 10 for k in range(-6, 7))
    beside_m: tuple[float, ...] = (0.54, 0.58, 0.62)  # nearer a held loop has no room in the sweep of a scan
    first_within_m: float = 0.35
    ahead_cost: float = 0.05
    apart_m: float = 0.20

    def stops(self, off: Stop | None = None) -> tuple[Stop, ...]:
        """All stops; without those that are near to `off`."""
        every = [Stop(ahead_m=x, beside_m=y) for x in self.ahead_m for y in self.beside_m]
        if off is None:
            return tuple(every)
        gaps = [np.hypot(s.ahead_m - off.ahead_m, s.beside_m - off.beside_m) for s in every]
        return tuple(s for s, gap in zip(every, gaps, strict=True) if gap >= self.apart_m - 1e-9)

    def cost(self, stop: Stop) -> float:
        """What a stop loses for the scan."""
        return self.ahead_cost * abs(stop.ahead_m)


VINE_STOPS = StopOptions()
NAIL_STOPS = StopOptions(ahead_m=(0.25, 0.30, 0.35, -0.25, -0.30, -0.35), beside_m=(0.62, 0.54), ahead_cost=0.1)


def usual_spurs(base_height_m: float) -> tuple[HangTarget, ...]:
    """Where spurs usually are: tips relative to the foot of the vine, x along the row, y away from the robot.

    Half of them along the arms of a cordon, half on a ring, as on a gobelet. Heights are over base_link, which is
    `base_height_m` over the ground.
    """
    cordon = [(x, 0.0, 0.90) for x in (-0.42, -0.14, 0.14, 0.42)]
    ring = [(0.22 * np.cos(a), 0.22 * np.sin(a), 0.75) for a in np.radians((45.0, 135.0, 225.0, 315.0))]
    up = np.array([0.0, 0.0, 1.0])
    return tuple(
        HangTarget(plant="", kind="spur", tip=np.array(p) - up * base_height_m, direction=up, pitch=PITCHES[0])
        for p in (*cordon, *ring)
    )


def usual_nails(base_height_m: float, height_m: float, reach_m: float, error_m: float = 0.05) -> tuple[HangTarget, ...]:
    """Where the tip of a nail may be for an arm and a base that err by `error_m`, relative to its post's foot."""
    rise = np.radians(15.0)
    direction = np.array([0.0, -np.cos(rise), np.sin(rise)])
    tip = np.array([0.0, -reach_m, height_m - base_height_m])
    offsets = [error_m * np.array(e) for e in ((0, 0, 0), (1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
    return tuple(HangTarget(plant="", kind="nail", tip=tip + e, direction=direction, pitch=np.pi / 2) for e in offsets)


def orientations(
    target: HangTarget, pitches: Sequence[float] = PITCHES, azimuths: Sequence[float] = AZIMUTHS
) -> tuple[HangTarget, ...]:
    """The same place with every orientation of the hand that may be tried; a level hand at a nail has one."""
    if target.kind == "nail":
        return (target,)
    return tuple(replace(target, pitch=pitch, azimuth=azimuth) for pitch in pitches for azimuth in azimuths)


def margins_of(robot: Robot, targets: Sequence[HangTarget]) -> Array:
    """(t,) how well the arm does the whole motion at each target (in base_link), 0 out of reach to 1 at ease."""
    lines = [_line(robot, target) for target in targets]
    return _margins(robot, _alike(lines))


def choose(
    robot: Robot,
    targets: Sequence[HangTarget],
    stops: Sequence[Stop],
    options: StopOptions,
    ways_at: Callable[[HangTarget], tuple[HangTarget, ...]] = orientations,
) -> Placement:
    """The best of several stops for targets that are given relative to the plant's foot (axes of base_link).

    Args:
        robot: models of the robot.
        targets: places to hang a dispenser; their scores are what they are worth.
        stops: to choose from.
        options: what a stop costs.
        ways_at: orientations of the hand in which a target may be worked on.
    """

    def ways(s: int) -> list[Array]:
        shift = np.array([*stops[s].plant_in_base(robot.description), 0.0])
        moved = [replace(target, tip=target.tip + shift) for target in targets]
        ways_of = [ways_at(target) for target in moved]
        lines = _alike([_line(robot, way) for group in ways_of for way in group])
        return np.split(lines, np.cumsum([len(group) for group in ways_of])[:-1])

    return choose_stop(
        len(stops),
        ways,
        np.array([target.score for target in targets]),
        lambda lines: _margins(robot, lines),
        np.array([options.cost(stop) for stop in stops]),
    )


def first_stop(robot: Robot, kind: str, height_m: float = 0.0, reach_m: float = 0.0) -> Stop:
    """Where to stop beside a plant of which nothing was seen yet.

    Args:
        robot: models of the robot.
        kind: vine or nail.
        height_m, reach_m: of a nail's tip over the ground and before the row's line.
    """
    return _ranked(robot, kind, round(height_m, 2), round(reach_m, 2))[0]


def next_stop(
    robot: Robot,
    here: Stop,
    found: Sequence[HangTarget],
    kind: str,
    height_m: float = 0.0,
    reach_m: float = 0.0,
) -> Stop:
    """Another stop when nothing could be done at `here`: by what was found there, else by what is usual.

    Args:
        robot, kind, height_m, reach_m: see `first_stop`.
        here: the stop that the robot leaves.
        found: deployment poses found there, relative to the plant's foot (axes of base_link).
    """
    options = NAIL_STOPS if kind == "nail" else VINE_STOPS
    stops = options.stops(off=here)
    if found:
        return stops[choose(robot, found, stops, options).index]
    return next(stop for stop in _ranked(robot, kind, round(height_m, 2), round(reach_m, 2)) if stop in stops)


def relative_to(foot: Array, targets: Sequence[HangTarget]) -> tuple[HangTarget, ...]:
    """Targets of base_link relative to the plant's foot (2,) m or more in base_link; heights stay over base_link."""
    return tuple(replace(target, tip=target.tip - [foot[0], foot[1], 0.0]) for target in targets)


@lru_cache(maxsize=8)
def _ranked(robot: Robot, kind: str, height_m: float, reach_m: float) -> tuple[Stop, ...]:
    """All stops for what is usual, best first."""
    options = NAIL_STOPS if kind == "nail" else VINE_STOPS
    base_height_m = robot.description.base.height
    targets = usual_nails(base_height_m, height_m, reach_m) if kind == "nail" else usual_spurs(base_height_m)
    stops = [stop for stop in options.stops() if abs(stop.ahead_m) <= options.first_within_m]

    def few(target: HangTarget) -> tuple[HangTarget, ...]:
        return orientations(target, PITCHES[:1], AZIMUTHS[:3])

    scores = choose(robot, targets, stops, options, few).scores
    return tuple(stops[k] for k in np.argsort(-scores, kind="stable"))


def _line(robot: Robot, target: HangTarget) -> Array:
    """(k, 4, 4) the hand's whole way at a target, in the arm's base frame."""
    stand_off = NAIL_STAND_OFF_M if target.kind == "nail" else SPUR_STAND_OFF_M
    return np.array(densely([robot.in_arm_base(T) for T in hang_line(robot, target, stand_off)], STEP_M))


def _alike(lines: Sequence[Array]) -> Array:
    """Lines (k, 4, 4) of different length as one array: shorter ones stay at their last pose."""
    longest = max(len(line) for line in lines)
    return np.array([np.concatenate([line, np.repeat(line[-1:], longest - len(line), axis=0)]) for line in lines])


def _margins(robot: Robot, lines: Array) -> Array:
    poses = robot.description.arm.poses
    seeds = [poses[name] for name in ("ready_left_fore", "ready_left_aft") if name in poses]
    return reach_margins(robot.arm, robot.body, lines, seeds=seeds).margins
