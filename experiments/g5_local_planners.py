"""Row G5: local planners on the same goals in vineyards on paper, and the reference's finding about DWA."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from grape.experiments.driving_bench import PLANNERS, Outcome, driven, fences_of
from grape.experiments.driving_yard import Base, Yard, in_fence, yard
from grape.experiments.quantities import count_of, median_of
from grape.mission.command import Cancellation
from grape.mission.svg import PALETTE, Frame, drawing, interval_chart, legend, tag
from grape.navigation.grid import Footprint
from grape.navigation.turning import room_to_turn
from grape.proof import Experiment, Figure, Proof, Quantity, wilson95

JUDGED = ("dwa", "teb", "mppi")
REFERENCE = {
    "dwa_classic": "DWA: often stuck in jagged contours",
    "teb": "TEB: much more robust, dearer",
}
KINDS = ("row entry", "plant", "obstacle", "row change")
NOTES = (
    "Three rows with trunks, posts and canes, fences along them and behind the headlands, an obstacle in the lane. "
    "Four drives a vineyard: into a row, on to a plant, past the obstacle to a plant, into another lane to a plant.",
    "Success: within 5 cm and 2 degrees of the goal by truth, nothing touched and no fence entered at any 0.1 s.",
    "The base lags, slips by 3.5 % (one sigma), turns 0.55 to 1.1 times what it is told, and drifts by up to 26 cm per "
    "rad while it turns on the spot, which its estimate learns within 1.5 s. The estimate errs by 1 cm in x and y and "
    "0.23 degrees (one sigma), correlated over 2 s; the scanner by 1.5 cm. No physics of wheels and ground.",
    "All planners have the same global path, way to turn, settling on the goal, recoveries and collision monitor, so "
    "only the search between them differs. dwa_classic scores as ROS 1 did by default; it is held to no goal.",
    "Times and lengths are medians of drives in which dwa, teb and mppi all succeeded, where those are there.",
)
Drives = Mapping[str, Sequence[Outcome]]


def run(seeds: Sequence[int], folder: Path, progress: Callable[[float, str], None]) -> Proof:
    """Every planner in each vineyard; drives that the folder has are not driven again.

    When it is asked to stop, it ends the vineyard at hand, and the figures are of what was driven so far.
    """
    cancellation = Cancellation()
    tasks = [(seed, name) for seed in seeds for name in PLANNERS]
    with cancellation.listening():
        for k, (seed, name) in enumerate(tasks):
            if cancellation():
                break
            progress(k / len(tasks), f"{name}, seed {seed}")
            driven(folder, name, seed)
    drives = {name: _there(folder, name, seeds) for name in PLANNERS}
    complete = all((folder / name / f"seed{seed}.json").exists() for seed, name in tasks)
    done = sorted({drive.seed for found in drives.values() for drive in found})
    return Proof(
        quantities=(*quantities(drives), *turning_quantities(done)),
        figures=figures(drives),
        notes=NOTES,
        complete=complete,
    )


def _there(folder: Path, name: str, seeds: Sequence[int]) -> list[Outcome]:
    found = [seed for seed in seeds if (folder / name / f"seed{seed}.json").exists()]
    return [drive for seed in found for drive in driven(folder, name, seed)]


def quantities(drives: Drives) -> list[Quantity]:
    """What is asked of each planner that has driven."""
    shared = _all_succeeded(drives)
    return [quantity for name, found in drives.items() if found for quantity in _of_planner(name, found, shared)]


def _all_succeeded(drives: Drives) -> set[tuple[int, str]]:
    """Seed and kind of the drives in which all judged planners that drove succeeded."""
    sets = [{(d.seed, d.kind) for d in drives[name] if d.success} for name in JUDGED if drives.get(name)]
    return set.intersection(*sets) if sets else set()


def _of_planner(name: str, drives: Sequence[Outcome], shared: set[tuple[int, str]]) -> list[Quantity]:
    n, judged = len(drives), name in JUDGED
    good = sum(drive.success for drive in drives)
    reached = [drive for drive in drives if drive.reached]
    fair = [drive for drive in drives if (drive.seed, drive.kind) in shared]
    zero = "= 0" if judged else ""
    rows = [
        Quantity(
            name=f"{name}: drives that succeeded", unit="1", value=good / n, n=n, ci95=wilson95(good, n),
            reference=REFERENCE.get(name, ""), goal=">= 0.99" if judged else "",
        ),
        count_of(f"{name}: drives with a contact", [drive.contact for drive in drives], zero),
        count_of(f"{name}: drives that entered a fence", [drive.fence for drive in drives], zero),
        count_of(f"{name}: times stuck", [drive.stuck for drive in drives], ""),
        count_of(f"{name}: times stuck in changes of row", [d.stuck for d in drives if d.kind == "row change"], ""),
        Quantity(name=f"{name}: least clearance", unit="m", value=min(d.least_gap_m for d in drives), n=n),
        median_of(f"{name}: time", "s", [drive.time_s for drive in fair]),
        median_of(f"{name}: path length", "m", [drive.driven_m for drive in fair]),
        _high(f"{name}: off the goal, 95th percentile", "m", [d.off_m for d in reached], "<= 0.05" if judged else ""),
        _high(
            f"{name}: turned off the goal, 95th percentile", "deg",
            [float(np.degrees(d.off_rad)) for d in reached], "<= 2" if judged else "",
        ),
    ]  # fmt: skip
    return rows


def _high(name: str, unit: str, values: Sequence[float], goal: str) -> Quantity:
    value = float(np.percentile(values, 95)) if values else None
    return Quantity(name=name, unit=unit, value=value, n=len(values), goal=goal)


def turning_quantities(seeds: Sequence[int]) -> list[Quantity]:
    """How often half a turn beside a row crosses its fence: where the base is parked, and where there is room."""
    rows = []
    for guarded, name in ((False, "where the base is parked"), (True, "where `room_to_turn` sends it")):
        crossed, n = sum(turn_crosses_fence(seed, guarded) for seed in seeds), len(seeds)
        rows.append(
            Quantity(
                name=f"half turns that cross a fence, {name}", unit="1", value=crossed / n if n else None, n=n,
                ci95=wilson95(crossed, n),
            )
        )  # fmt: skip
    return rows


def turn_crosses_fence(seed: int, guarded: bool) -> bool:
    """Whether a base that is parked beside a row and turns half round there crosses the fence.

    Args:
        guarded: it first drives to where `room_to_turn` says that there is room, and stays where there is none.
    """
    place = yard(seed)
    base = Base.seeded(place.goals[1].pose, seed)
    away = room_to_turn(fences_of(place), base.estimate(), np.pi) if guarded else 0.0
    if away is None:
        return False
    base.pose = base.pose + away * np.array([np.cos(base.pose[2]), np.sin(base.pose[2]), 0.0])
    goal_yaw, crossed = base.pose[2] + np.pi, False
    for _ in range(200):
        if base.pose[2] >= goal_yaw:
            break
        base.drive(0.0, 0.8, 0.1)
        crossed = crossed or in_fence(base.pose, place.fences, Footprint())
    return crossed


def figures(drives: Drives) -> tuple[Figure, ...]:
    """Success by planner and kind of drive, and the paths in the first vineyard."""
    drawn = {name: found for name, found in drives.items() if found}
    if not drawn:
        return ()
    rows = []
    for name, found in drawn.items():
        for kind in KINDS:
            of_kind = [drive for drive in found if drive.kind == kind]
            good = sum(drive.success for drive in of_kind)
            text = f"{good} of {len(of_kind)}, stuck {sum(drive.stuck for drive in of_kind)} times"
            rows.append((f"{name}, {kind}", good / max(1, len(of_kind)), wilson95(good, len(of_kind)), text))
    seed = min(drive.seed for found in drawn.values() for drive in found)
    tracks = {name: [drive.track for drive in found if drive.seed == seed] for name, found in drawn.items()}
    return (
        Figure(title="Drives that succeeded", svg=interval_chart(rows)),
        Figure(title=f"Paths in the vineyard of seed {seed}", svg=map_of(yard(seed), tracks)),
    )


def map_of(place: Yard, tracks: Mapping[str, Sequence[Sequence[Sequence[float]]]], width: float = 1080.0) -> str:
    """Fences, circles, goals and paths as SVG, metres in map."""
    inside = np.vstack([*(row.line for row in place.rows), place.start[:2], *(goal.pose[:2] for goal in place.goals)])
    low, high = inside.min(axis=0) - 3.0, inside.max(axis=0) + 3.0
    height = width * float((high[1] - low[1]) / (high[0] - low[0]))
    frame = Frame(
        left=0, top=26, width=width, height=height,
        x=(float(low[0]), float(high[0])), y=(float(low[1]), float(high[1])),
    )  # fmt: skip
    metre = width / (high[0] - low[0])
    parts = [tag("polygon", points=frame.points(fence), fill="#e3b5a4", opacity=0.6) for fence in place.fences]
    for x, y, radius in place.circles:
        u, v = frame.at(float(x), float(y))
        parts.append(tag("circle", cx=u, cy=v, r=max(1.5, float(radius * metre)), fill="#5b4a3a"))
    for goal in place.goals:
        parts.append(
            tag("polygon", points=frame.points(Footprint().corners(goal.pose)), class_="line", stroke="#3f9142")
        )
    colours = dict(zip(tracks, PALETTE, strict=False))
    for name, found in tracks.items():
        parts += [
            tag("polyline", points=frame.points(track), class_="line", stroke=colours[name]) for track in found if track
        ]
    parts += legend(list(colours.items()), width - 12, 14)
    return drawing(width, height + 30, parts, "map")


EXPERIMENT = Experiment(
    row="G5",
    summary="DWA, TEB, MPPI, pure pursuit and ROS 1's DWA on the same drives in vineyards on paper.",
    seeds=range(500, 600),
    run=run,
)
