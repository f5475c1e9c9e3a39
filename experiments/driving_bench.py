"""Local planners on the same vineyards on paper: who arrives, how fast, how near, how often stuck.

python -m grape.experiments.driving_bench --planner mppi --seeds 0:20 --out runs/drives
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path as FilePath

import numpy as np

from grape.errors import ActionFailed, InvalidInput
from grape.experiments.driving_yard import (
    T_BASE_LASER,
    Base,
    Goal,
    Yard,
    gap_to_circles,
    in_fence,
    misses,
    scan_of,
    yard,
)
from grape.geometry import pose as make_pose
from grape.geometry import rotation_z
from grape.mission.record import write_atomic
from grape.navigation.beams import beams_from_scan, scan_points
from grape.navigation.costmap import ObstacleLayer, PolygonLayer, layered_costmap
from grape.navigation.dwa import CLASSIC, Dwa
from grape.navigation.follower import FollowerState, FollowerStep, LocalPlanner, Phase, PurePursuit
from grape.navigation.grid import Costmap, Footprint, GridSpec
from grape.navigation.monitor import speed_factor
from grape.navigation.mppi import Mppi
from grape.navigation.path import Path
from grape.navigation.planner import path_blocked, plan_route
from grape.navigation.rolling import LayeredCostmap
from grape.navigation.route import waypoints
from grape.navigation.teb import Teb
from grape.navigation.turning import RoomToTurn
from grape.proof import parse_seeds

PLANNERS: Mapping[str, Callable[[], LocalPlanner]] = {
    "pure_pursuit": PurePursuit,
    "dwa": Dwa,
    "dwa_classic": lambda: Dwa(options=CLASSIC),
    "teb": Teb,
    "mppi": Mppi,
}
_DT = 0.1
_MAP_S = 0.2
_PAST_M = 0.9
_HELD_S = 1.5
_WINDOW_M = 10.0
_REPLAN_S = 2.0
_STUCK_S = 6.0
_MOST_STUCK = 4


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One drive. Distances in metres by truth, times in seconds."""

    seed: int
    kind: str
    planner: str
    reached: bool
    time_s: float
    driven_m: float
    least_gap_m: float  # to trunks, posts, canes and obstacles
    contact: bool
    fence: bool
    stuck: int
    off_m: float  # from the goal
    off_rad: float
    why: str = ""
    track: Sequence[Sequence[float]] = ()  # x y yaw, every 0.3 s

    @property
    def success(self) -> bool:
        """At the goal within 5 cm and 2 degrees by truth, nothing touched, no fence crossed."""
        exact = self.off_m <= 0.05 and self.off_rad <= np.radians(2.0)
        return self.reached and exact and not self.contact and not self.fence

    def line(self) -> str:
        """One line for a person."""
        told = "there" if self.success else "FAILED"
        marks = [name for name in ("contact", "fence") if getattr(self, name)] + [self.why] * bool(self.why)
        return (
            f"{self.seed} {self.kind}: {told}, {self.time_s:.1f} s, {self.driven_m:.1f} m, "
            f"gap {self.least_gap_m:.3f} m, stuck {self.stuck}, "
            f"off {100 * self.off_m:.1f} cm {np.degrees(self.off_rad):.2f} deg {', '.join(marks)}"
        )


class _Drive:
    """One drive to one goal, as a supervisor would do it: it replans, backs off, and tries from beyond the goal."""

    def __init__(self, place: Yard, base: Base, goal: Goal, planner: LocalPlanner) -> None:
        self.place, self.base, self.goal, self.planner = place, base, goal, planner
        self.zones = PolygonLayer(place.fences)
        corners = np.vstack([*(row.line for row in place.rows), place.start[:2][None], *place.fences])
        self.spec = GridSpec.around(corners, 1.0)
        self.obstacles = ObstacleLayer(GridSpec.window(base.pose[:2], _WINDOW_M))
        self.local_layers = LayeredCostmap({"obstacles": self.obstacles, "fences": self.zones}, size=_WINDOW_M)
        self.state = FollowerState()
        self.stuck = self.backing = 0
        self.target, self.passed, self.held_s = goal.pose, False, 0.0
        self.replan_s = self.moved_s = base.time_s
        self.moved_at, self.map_s = base.pose.copy(), -np.inf
        self._sense()
        self.path = self._planned()

    def run(self, limit_s: float) -> str:
        """Drive until there; why not, or an empty text."""
        end = self.base.time_s + limit_s
        while self.base.time_s < end:
            self._sense()
            if self.backing > 0:
                self._back_off()
                continue
            twist = np.array([self.base.v, self.base.w])
            step = self.planner.step(self.state, self.path, self.base.estimate(), twist, self.local, _DT)
            factor = speed_factor(step.v, step.w, self.points)
            self._note(step, factor)
            if self.state.phase is Phase.REACHED and self.target is self.goal.pose:
                return ""
            if self.state.phase in (Phase.REACHED, Phase.FAILED) or self.held_s > _HELD_S:
                if self.target is self.goal.pose and self.passed:
                    return str(Phase.FAILED)
                if not self._pass_goal():
                    return "no path for another approach"
            self._replan_where_blocked()
            self.base.drive(factor * step.v, factor * step.w, _DT)
            if self._is_stuck() and self.stuck >= _MOST_STUCK:
                return "stuck"
        return "time is up"

    def _note(self, step: FollowerStep, factor: float) -> None:
        """The state for the next step, and for how long something has been in the way of backing off.

        Args:
            factor: by which the collision monitor slows the step.
        """
        gain = step.state.turn_gain if factor == 1.0 else self.state.turn_gain
        command = (0.0, 0.0) if factor == 0.0 else step.state.command
        self.state = replace(step.state, turn_gain=gain, command=command)
        held = self.state.phase is Phase.RETREAT and (step.blocked or factor < 0.5)
        self.held_s = self.held_s + _DT if held else 0.0

    def _sense(self) -> None:
        """A scan, and as often as missions do it a local costmap."""
        estimate = self.base.estimate()
        scan = scan_of(self.place.circles, self.base.pose, self.base.rng)
        T_map_base = make_pose(rotation_z(estimate[2]), (estimate[0], estimate[1], 0.0))
        self.obstacles.move_to(estimate[:2])
        self.obstacles.integrate(beams_from_scan(scan, T_map_base, T_BASE_LASER))
        self.points = scan_points(scan, T_BASE_LASER)[:, :2]
        if self.base.time_s >= self.map_s + _MAP_S - 1e-6:
            self.map_s = self.base.time_s
            self.local = self.local_layers.update(estimate)

    def _planned(self) -> Path:
        estimate = self.base.estimate()
        whole = layered_costmap(self.spec, [self.zones, self.obstacles])
        # from beyond the goal the way is the straight one back, not the one of a robot that comes out of a headland
        stops = self.target[None] if self.passed else waypoints(self.place.rows, estimate, self.target)
        return plan_route(whole, estimate, stops)

    def _replan(self) -> bool:
        """Another path; the old one stays where none leads."""
        try:
            self.path = self._planned()
        except ActionFailed:
            return False
        self.state = FollowerState(
            command=self.state.command, turn_gain=self.state.turn_gain, retreats=self.state.retreats
        )
        return True

    def _pass_goal(self) -> bool:
        """To a place past the goal, for another approach, or from there to the goal; whether a path leads there."""
        goal = self.goal.pose
        past = goal + _PAST_M * np.array([np.cos(goal[2]), np.sin(goal[2]), 0.0])
        self.target, self.passed = goal if self.passed else past, True
        self.state = FollowerState(turn_gain=self.state.turn_gain)
        return self._replan()

    def _replan_where_blocked(self) -> None:
        since = self.state.travelled
        if self.base.time_s < self.replan_s or self.path.length - since < 0.5 or self.state.phase is not Phase.TRACK:
            return
        if path_blocked(self.local, self.path, since + 0.3, since + 4.0, Footprint()):
            self.replan_s = self.base.time_s + _REPLAN_S
            self._replan()

    def _is_stuck(self) -> bool:
        """Counts a standstill, and begins to back off."""
        pose = self.base.pose
        moved = np.hypot(*(pose[:2] - self.moved_at[:2])) + 0.3 * abs(pose[2] - self.moved_at[2])
        if moved > 0.1:
            self.moved_at, self.moved_s = pose.copy(), self.base.time_s
        if self.base.time_s - self.moved_s < _STUCK_S:
            return False
        self.stuck += 1
        self.moved_s = self.base.time_s
        self.backing = 20
        return True

    def _back_off(self) -> None:
        """0.4 m back where that is free, then a new path."""
        self.backing -= 1
        pose = self.base.estimate()
        behind = pose - np.linspace(0.1, 0.3, 3)[:, None] * [np.cos(pose[2]), np.sin(pose[2]), 0.0]
        free = not self.local.blocked(behind, Footprint()).any()
        self.base.drive(-0.2 if free and self.backing > 3 else 0.0, 0.0, _DT)
        if self.backing == 0:
            self.state = replace(self.state, command=(0.0, 0.0))
            self._replan()


def run_seed(seed: int, name: str, limit_s: float = 120.0) -> list[Outcome]:
    """All drives of one vineyard, one after the other; after a failure the next one starts from its goal."""
    if name not in PLANNERS:
        raise InvalidInput(f"no planner {name!r}; there are {', '.join(PLANNERS)}")
    place = yard(seed)
    base, outcomes = Base.seeded(place.start, seed), []
    for goal in place.goals:
        outcome = _outcome(seed, name, place, base, goal, limit_s)
        outcomes.append(outcome)
        if not outcome.reached:
            base.pose, base.v, base.w = goal.pose.copy(), 0.0, 0.0
    return outcomes


def _outcome(seed: int, name: str, place: Yard, base: Base, goal: Goal, limit_s: float) -> Outcome:
    base.track.clear()
    began_s, driven = base.time_s, base.driven
    drive = None
    try:
        drive = _Drive(place, base, goal, RoomToTurn(PLANNERS[name](), fences=fences_of(place)))
        why = drive.run(limit_s)
    except ActionFailed as failure:
        why = failure.detail
    track = np.array(base.track) if base.track else base.pose[None]
    off, turned = misses(base.pose, goal.pose)
    least_gap = min(gap_to_circles(pose, place.circles, Footprint()) for pose in track)
    return Outcome(
        seed=seed,
        kind=goal.kind,
        planner=name,
        reached=why == "",
        time_s=base.time_s - began_s,
        driven_m=base.driven - driven,
        least_gap_m=least_gap,
        contact=least_gap < 0.0,
        fence=any(in_fence(pose, place.fences, Footprint()) for pose in track),
        stuck=drive.stuck if drive is not None else 0,
        off_m=off,
        off_rad=turned,
        why=why,
        track=np.round(track[::3], 3).tolist(),
    )


def fences_of(place: Yard) -> Costmap:
    """Costs of the whole yard by its fences alone."""
    spec = GridSpec.around(np.vstack([*place.fences, place.start[:2][None]]), 1.0)
    return layered_costmap(spec, [PolygonLayer(place.fences)])


def driven(folder: FilePath, name: str, seed: int) -> list[Outcome]:
    """The drives of one planner in one vineyard: read from the folder, or driven and written there."""
    path = folder / name / f"seed{seed}.json"
    if path.exists():
        return [Outcome(**drive) for drive in json.loads(path.read_text(encoding="utf-8"))]
    outcomes = run_seed(seed, name)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, json.dumps([asdict(outcome) for outcome in outcomes]) + "\n")
    return outcomes


def main(arguments: Sequence[str] | None = None) -> None:
    """Drives the vineyards of some seeds with one planner, and says how each drive went."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planner", choices=sorted(PLANNERS), required=True)
    parser.add_argument("--seeds", default="0:5", help="FIRST:LAST below 1000; tune below 500, report from 500 on")
    parser.add_argument("--out", type=FilePath, required=True, help="folder; seeds that it has are read")
    chosen = parser.parse_args(arguments)
    for seed in parse_seeds(chosen.seeds):
        for drive in driven(chosen.out, chosen.planner, seed):
            print(drive.line(), flush=True)


if __name__ == "__main__":
    main()
