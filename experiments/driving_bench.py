"""Local planners on the same vineyards on paper: who arrives, how fast, how near, how often stuck.

python -m grape.experiments.driving_bench --planner mppi --seeds 0:20 --out mppi.json
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
from grape.messages import Array
from grape.navigation.beams import beams_from_scan, scan_points
from grape.navigation.costmap import ObstacleLayer, PolygonLayer, layered_costmap
from grape.navigation.dwa import CLASSIC, Dwa
from grape.navigation.follower import FollowerState, LocalPlanner, Phase, PurePursuit
from grape.navigation.grid import Footprint, GridSpec
from grape.navigation.monitor import speed_factor
from grape.navigation.mppi import Mppi
from grape.navigation.path import Path
from grape.navigation.planner import path_blocked, plan_route
from grape.navigation.rolling import LayeredCostmap
from grape.navigation.route import waypoints
from grape.navigation.teb import Teb
from grape.navigation.turning import RoomToTurn, room_to_turn

PLANNERS: Mapping[str, Callable[[], LocalPlanner]] = {
    "pure_pursuit": PurePursuit,
    "dwa": Dwa,
    "dwa_classic": lambda: Dwa(options=CLASSIC),
    "teb": Teb,
    "mppi": Mppi,
}
_DT = 0.1
_MAP_S = 0.2
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

    @property
    def success(self) -> bool:
        """At the goal within 5 cm and 2 degrees by truth, nothing touched, no fence crossed."""
        exact = self.off_m <= 0.05 and self.off_rad <= np.radians(2.0)
        return self.reached and exact and not self.contact and not self.fence


class _Drive:
    """One drive to one goal, as a supervisor would do it: it replans, waits, clears and backs off."""

    def __init__(self, place: Yard, base: Base, goal: Goal, planner: LocalPlanner) -> None:
        self.place, self.base, self.goal, self.planner = place, base, goal, planner
        self.zones = PolygonLayer(place.fences)
        corners = np.vstack([*(row.line for row in place.rows), place.start[:2][None], *place.fences])
        self.spec = GridSpec.around(corners, 1.0)
        self.obstacles = ObstacleLayer(GridSpec.window(base.pose[:2], _WINDOW_M))
        self.local_layers = LayeredCostmap({"obstacles": self.obstacles, "fences": self.zones}, size=_WINDOW_M)
        self.state = FollowerState()
        self.stuck = self.backing = 0
        self.replan_s = self.moved_s = base.time_s
        self.moved_at = base.pose.copy()
        self.map_s = -np.inf
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
            self.state = step.state
            if self.state.phase is Phase.REACHED:
                return ""
            if self.state.phase is Phase.FAILED:
                return str(Phase.FAILED)
            factor = speed_factor(step.v, step.w, self.points)
            if factor == 0.0:
                self.state = replace(self.state, command=(0.0, 0.0))
            self._replan_where_blocked()
            self.base.drive(factor * step.v, factor * step.w, _DT)
            if self._is_stuck() and self.stuck >= _MOST_STUCK:
                return "stuck"
        return "time is up"

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
        return plan_route(whole, estimate, waypoints(self.place.rows, estimate, self.goal.pose))

    def _replan(self) -> None:
        try:
            self.path = self._planned()
        except ActionFailed:
            return
        self.state = FollowerState(
            command=self.state.command, turn_gain=self.state.turn_gain, retreats=self.state.retreats
        )

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
        self.obstacles.forget(self.base.estimate()[:2], 3.0)
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


def run_seed(seed: int, name: str, room: bool = True, limit_s: float = 120.0) -> list[Outcome]:
    """All drives of one vineyard, one after the other; after a failure the next one starts from its goal.

    Args:
        room: whether turns need room (`RoomToTurn`).
    """
    if name not in PLANNERS:
        raise InvalidInput(f"no planner {name!r}; there are {', '.join(PLANNERS)}")
    place = yard(seed)
    base, outcomes = Base.seeded(place.start, seed), []
    for goal in place.goals:
        outcome = _outcome(seed, name, place, base, goal, room, limit_s)
        outcomes.append(outcome)
        if not outcome.reached:
            base.pose, base.v, base.w = goal.pose.copy(), 0.0, 0.0
    return outcomes


def _outcome(seed: int, name: str, place: Yard, base: Base, goal: Goal, room: bool, limit_s: float) -> Outcome:
    base.track.clear()
    began_s, driven = base.time_s, base.driven
    planner = PLANNERS[name]()
    drive = None
    try:
        if room:
            planner = RoomToTurn(planner, fences=layered_costmap(_whole(place), [PolygonLayer(place.fences)]))
        drive = _Drive(place, base, goal, planner)
        why = drive.run(limit_s)
    except ActionFailed as failure:
        why = failure.detail
    track = np.array(base.track) if base.track else base.pose[None]
    off, turned = misses(base.pose, goal.pose)
    gaps = [gap_to_circles(pose, place.circles, Footprint()) for pose in track[::2]]
    return Outcome(
        seed=seed,
        kind=goal.kind,
        planner=name,
        reached=why == "",
        time_s=base.time_s - began_s,
        driven_m=base.driven - driven,
        least_gap_m=min(gaps),
        contact=min(gaps) < 0.0,
        fence=any(in_fence(pose, place.fences, Footprint()) for pose in track[::2]),
        stuck=drive.stuck if drive is not None else 0,
        off_m=off,
        off_rad=turned,
        why=why,
    )


def _whole(place: Yard) -> GridSpec:
    return GridSpec.around(np.vstack([*place.fences, place.start[:2][None]]), 1.0)


def turning_trial(seed: int, guarded: bool) -> bool:
    """Whether a base that is parked beside a row and turns half round there crosses the fence.

    Args:
        guarded: it first drives to where `room_to_turn` says that there is room.
    """
    place = yard(seed)
    base = Base.seeded(place.goals[1].pose, seed)
    fences = layered_costmap(_whole(place), [PolygonLayer(place.fences)])
    away = room_to_turn(fences, base.estimate(), np.pi) if guarded else 0.0
    if away is None:
        return False
    base.pose = base.pose + away * np.array([np.cos(base.pose[2]), np.sin(base.pose[2]), 0.0])
    goal_yaw, crossed = base.pose[2] + np.pi, False
    for _ in range(200):
        if base.pose[2] >= goal_yaw:
            break
        base.drive(0.0, 0.8, _DT)
        crossed = crossed or in_fence(base.pose, place.fences, Footprint())
    return crossed


def summary(outcomes: Sequence[Outcome]) -> dict[str, float | int]:
    """Counts and means over drives; times and lengths over those that succeeded."""
    if not outcomes:
        raise InvalidInput("no drives to sum up")
    good = [outcome for outcome in outcomes if outcome.success]
    reached = [outcome for outcome in outcomes if outcome.reached]
    return {
        "drives": len(outcomes),
        "success": len(good) / len(outcomes),
        "reached": len(reached),
        "contacts": sum(outcome.contact for outcome in outcomes),
        "fences": sum(outcome.fence for outcome in outcomes),
        "stuck": sum(outcome.stuck for outcome in outcomes),
        "time_s": float(np.mean([outcome.time_s for outcome in good])) if good else np.nan,
        "driven_m": float(np.mean([outcome.driven_m for outcome in good])) if good else np.nan,
        "least_gap_m": min(outcome.least_gap_m for outcome in outcomes),
        "off_m_95": float(np.percentile([outcome.off_m for outcome in reached], 95)) if reached else np.nan,
        "off_deg_95": float(np.degrees(np.percentile([o.off_rad for o in reached], 95))) if reached else np.nan,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs seeds and writes every drive and the sums as JSON, after each seed anew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planner", choices=sorted(PLANNERS), required=True)
    parser.add_argument("--seeds", default="0:5", help="first:end, below 1000; tune below 500, report from 500 on")
    parser.add_argument("--no-room", action="store_true", help="turn without asking for room")
    parser.add_argument("--out", type=FilePath, required=True)
    chosen = parser.parse_args(arguments)
    first, end = (int(part) for part in chosen.seeds.split(":"))
    if not 0 <= first < end <= 1000:
        parser.error(f"seeds must lie in 0:1000, got {chosen.seeds}")
    outcomes: list[Outcome] = []
    for seed in range(first, end):
        outcomes += run_seed(seed, chosen.planner, room=not chosen.no_room)
        drives = [asdict(outcome) | {"success": bool(outcome.success)} for outcome in outcomes]
        chosen.out.write_text(json.dumps({"summary": summary(outcomes), "drives": drives}, indent=1, default=float))
        print(seed, summary(outcomes), flush=True)


if __name__ == "__main__":
    main()
