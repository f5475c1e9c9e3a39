"""Row G5-goal: how near the robot really comes to goal poses beside plants, driving by its own estimate, in physics."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from grape.actions.drive_to_pose import PURE_PURSUIT
from grape.actions.shortest_way import footprint_of
from grape.experiments.base_bench import BaseBench, Driven
from grape.experiments.goal_vineyards import tour
from grape.experiments.quantities import count_of, median_of
from grape.messages import Array
from grape.mission.command import Cancellation
from grape.mission.record import write_atomic
from grape.mission.svg import PALETTE, Frame, drawing, interval_chart, legend, tag
from grape.proof import Experiment, Figure, Proof, Quantity, wilson95
from grape.robots.husky_jaco2 import DESCRIPTION

OFF_M, OFF_DEG = 0.05, 2.0
STEEP_FROM_DEG = 5.0
SHOWN = 4  # vineyards whose ways are drawn
KINDS = ("row entry", "along the row", "row change", "turn round")
NOTES = (
    "Three rows of five vines. Four drives a vineyard, one after the other by one estimate: from the headland into a "
    "row, on to another plant, over the headland to the next row, out and round to the other side of that lane. Goals "
    "are stops that missions use beside a vine, drawn at random.",
    "Physics of wheels and rough ground (RMS 10 to 25 mm); wheels, IMU, RTK GNSS and LiDARs with their errors; the arm "
    "in its travel pose, the feeder empty. Odd seeds slope by 5 to 10 degrees along the rows, so that the headland is "
    "crossed on a side slope; even ones by at most 3. In every other pair of seeds a vehicle stands in the lane that "
    "the change of row passes, up to 1 m of it in the headland.",
    "A drive succeeds when it arrives by its own account and stands, at rest for 1 s, within 5 cm and 2 degrees of its "
    "goal by truth, with nothing touched and no fence entered. Errors are of all drives that arrived.",
)


@dataclass(frozen=True, kw_only=True)
class GoalDrive:
    """One drive of a tour: which, where, and how it went."""

    seed: int
    kind: str
    plant: str
    slope_deg: float
    occupied: bool
    driven: Driven

    @property
    def success(self) -> bool:
        """There within 5 cm and 2 degrees, nothing touched, no fence entered."""
        driven = self.driven
        exact = driven.off_m <= OFF_M and abs(driven.yaw_deg) <= OFF_DEG
        return driven.reached and exact and not driven.touched and not driven.fences


def run(seeds: Sequence[int], folder: Path, progress: Callable[[float, str], None]) -> Proof:
    """The tour of each seed; those that the folder has are not driven again.

    When it is asked to stop, it ends the tour at hand, and the figures are of what was driven so far.
    """
    cancellation = Cancellation()
    with cancellation.listening():
        for k, seed in enumerate(seeds):
            if cancellation():
                break
            progress(k / len(seeds), f"seed {seed}")
            toured(folder, seed)
    done = [seed for seed in seeds if _file(folder, seed).exists()]
    drives = [drive for seed in done for drive in toured(folder, seed)]
    return Proof(quantities=quantities(drives), figures=figures(drives), notes=NOTES, complete=len(done) == len(seeds))


def toured(folder: Path, seed: int, planner: str = PURE_PURSUIT) -> list[GoalDrive]:
    """The drives of one seed: read from the folder, or driven and written there."""
    path = _file(folder, seed)
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, json.dumps([asdict(drive) for drive in drive_tour(seed, planner)], indent=1) + "\n")
    told = json.loads(path.read_text(encoding="utf-8"))
    return [GoalDrive(**{**drive, "driven": Driven(**drive["driven"])}) for drive in told]


def _file(folder: Path, seed: int) -> Path:
    return folder / f"seed{seed}.json"


def drive_tour(seed: int, planner: str = PURE_PURSUIT) -> list[GoalDrive]:
    """Drive the tour of a seed; after a drive that failed the next one begins where the robot stands."""
    place = tour(seed, DESCRIPTION, planner)
    drives = []
    with BaseBench(DESCRIPTION, place.world, seed) as bench:
        for task in place.tasks:
            drives.append(
                GoalDrive(
                    seed=seed,
                    kind=task.kind,
                    plant=task.plant,
                    slope_deg=place.slope_deg,
                    occupied=place.vehicle is not None,
                    driven=bench.drive(task.goal),
                )
            )
    return drives


def quantities(drives: Sequence[GoalDrive]) -> tuple[Quantity, ...]:
    """Errors at the goal, success by kind of drive, and what happened on the way."""
    there = [drive.driven for drive in drives if drive.driven.reached]
    changes = [drive for drive in drives if drive.kind in ("row change", "turn round")]
    steep = [drive for drive in changes if abs(drive.slope_deg) >= STEEP_FROM_DEG]
    passing = [drive for drive in drives if drive.kind == "row change" and drive.occupied]
    off, turned = [driven.off_m for driven in there], [abs(driven.yaw_deg) for driven in there]
    return (
        _high("off the goal, 95th percentile", "m", off, f"<= {OFF_M}"),
        _high("turned off the goal, 95th percentile", "deg", turned, f"<= {OFF_DEG:g}"),
        median_of("off the goal", "m", off),
        median_of("turned off the goal", "deg", turned),
        _rate("drives that succeeded", drives),
        *(_rate(f"{kind}: succeeded", _of_kind(drives, kind)) for kind in KINDS),
        _rate("changes of row and turns round on slopes of 5 to 10 degrees: succeeded", steep),
        _rate("changes of row past an occupied lane: succeeded", passing),
        count_of("drives that touched something", [bool(drive.driven.touched) for drive in drives]),
        count_of("drives that entered a fence", [bool(drive.driven.fences) for drive in drives]),
        _high("estimate off where it stands, 95th percentile", "m", [driven.estimate_off_m for driven in there]),
        _high("estimate turned off there, 95th percentile", "deg", [abs(d.estimate_off_deg) for d in there]),
        count_of("detours and retreats", [len(drive.driven.recoveries) for drive in drives], ""),
        *(
            median_of(f"{kind}: time", "s", [d.driven.time_s for d in _of_kind(drives, kind) if d.driven.reached])
            for kind in KINDS
        ),
    )


def _of_kind(drives: Sequence[GoalDrive], kind: str) -> list[GoalDrive]:
    return [drive for drive in drives if drive.kind == kind]


def _high(name: str, unit: str, values: Sequence[float], goal: str = "") -> Quantity:
    """The 95th percentile with its bootstrap interval."""
    if not values:
        return Quantity(name=name, unit=unit, value=None, n=0, goal=goal)
    draws: Array = np.random.default_rng(0).choice(np.array(values), (2000, len(values)))
    low, high = np.quantile(np.quantile(draws, 0.95, axis=1), (0.025, 0.975))
    return Quantity(
        name=name, unit=unit, value=float(np.quantile(values, 0.95)), n=len(values),
        ci95=(float(low), float(high)), goal=goal,
    )  # fmt: skip


def _rate(name: str, drives: Sequence[GoalDrive]) -> Quantity:
    n, good = len(drives), sum(drive.success for drive in drives)
    return Quantity(name=name, unit="1", value=good / n if n else None, n=n, ci95=wilson95(good, n))


def figures(drives: Sequence[GoalDrive]) -> tuple[Figure, ...]:
    """Success by kind of drive, slope and neighbour lane; where the drives ended; the ways of the first vineyards."""
    groups = [(kind, _of_kind(drives, kind)) for kind in KINDS]
    groups.append(("slope up to 3 degrees", [d for d in drives if abs(d.slope_deg) < STEEP_FROM_DEG]))
    groups.append(("slope 5 to 10 degrees", [d for d in drives if abs(d.slope_deg) >= STEEP_FROM_DEG]))
    groups.append(("past an occupied lane", [d for d in drives if d.kind == "row change" and d.occupied]))
    rows = []
    for name, found in groups:
        n, good = len(found), sum(drive.success for drive in found)
        worst = max((drive.driven.off_m for drive in found if drive.driven.reached), default=0.0)
        rows.append((name, good / max(1, n), wilson95(good, n), f"{good} of {n}, worst {100 * worst:.1f} cm off"))
    shown = sorted({drive.seed for drive in drives})[:SHOWN]
    ways = [
        Figure(title=f"Ways in the vineyard of seed {seed}", svg=map_of(seed, [d for d in drives if d.seed == seed]))
        for seed in shown
    ]
    return (Figure(title="Drives that succeeded", svg=interval_chart(rows)), *ways)


def map_of(seed: int, drives: Sequence[GoalDrive], width: float = 900.0) -> str:
    """Rows, vehicle, goals and true ways of one seed as SVG, metres in map."""
    place = tour(seed, DESCRIPTION, PURE_PURSUIT)
    site, footprint = place.world.site, footprint_of(DESCRIPTION.base.footprint)
    everything = np.vstack([*(area.polygon for area in site.headlands), site.start])
    low, high = everything.min(axis=0), everything.max(axis=0)
    height = width * float((high[1] - low[1]) / (high[0] - low[0]))
    frame = Frame(left=0, top=26, width=width, height=height, x=(low[0], high[0]), y=(low[1], high[1]))
    parts = [tag("polygon", points=frame.points(fence.polygon), fill="#e3b5a4", opacity=0.6) for fence in site.fences]
    if place.vehicle is not None:
        parts.append(tag("polygon", points=frame.points(place.vehicle), fill="#7a3b2e"))
    for task in place.tasks:
        goal = footprint.corners(np.array([task.goal.x, task.goal.y, task.goal.yaw]))
        parts.append(tag("polygon", points=frame.points(goal), class_="line", stroke="#3f9142"))
    colours = dict(zip(KINDS, PALETTE, strict=False))
    for drive in drives:
        ways = frame.points(drive.driven.track)
        parts.append(tag("polyline", points=ways, class_="line", stroke=colours[drive.kind]))
    parts += legend(list(colours.items()), width - 12, 14)
    return drawing(width, height + 30, parts, "map")


EXPERIMENT = Experiment(
    row="G5-goal",
    summary="Drives to poses beside plants in simulated vineyards, by the robot's own estimate, judged by the truth.",
    seeds=range(500, 525),
    run=run,
)
