"""G4: what closes rows in a costmap, and how true a rolling map is that is made of scans alone."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from grape.errors import ActionFailed
from grape.experiments.driving_yard import T_BASE_LASER, Yard, gap_to_circles, scan_of, yard
from grape.experiments.g5_local_planners import map_of
from grape.experiments.quantities import count_of, median_of
from grape.geometry import pose as make_pose
from grape.geometry import rotation_z
from grape.messages import Array
from grape.mission.command import Cancellation
from grape.mission.record import write_atomic
from grape.navigation.beams import beams_from_scan
from grape.navigation.costmap import ObstacleLayer, PolygonLayer, layered_costmap
from grape.navigation.grid import LETHAL, Costmap, Footprint, GridSpec
from grape.navigation.layers import StaticLayer
from grape.navigation.planner import plan_path
from grape.navigation.route import RouteOptions
from grape.proof import Experiment, Figure, Proof, Quantity, wilson95

CELL_M = 0.05
GROWN_M = tuple(np.round(np.arange(0.0, 0.75, 0.05), 2).tolist())  # by so much everything that stands is inflated more
SHARES = (0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65, 0.3, 0.7)  # of a row, where ways across it begin
WINDOW_M = 10.0
SCANS = 5  # until the rolling map is judged; a robot that stands has as many in an eighth of a second
SIGHT_M, NEAR_M = 3.0, 0.10  # trunks and posts so near count; a mark so near to something that stands is one of it
MOST_SCANS = 40
STRIPS, INFLATION = "strips along the rows", "inflation alone"
NOTES = (
    "Vineyards on paper as in G5, lanes empty. The global map knows all that stands: the best case for inflation. "
    "Ways lead from one side of each row to the other, near its middle: around the row, or through between trunks.",
    "Inflation that closes rows: everything that stands is grown, 5 cm at a time, until no way leads through a row. "
    "Then a place beside a plant is closed when the footprint that is parked there meets something lethal.",
    "The rolling map (10 m, 5 cm) is made of five scans of a robot that stands at the first plant. Marks: lethal cells "
    "before inflation, strips left out. Then something of 0.3 m stands 1.2 m ahead for as long, and leaves.",
)


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What one vineyard shows.

    Attributes:
        through: ways through a row, by what closes rows; `found`: ways at all; `asked`: for how many.
        closing_m: how much more inflation closes all rows; None when 0.7 m does not.
        parked, closed: places beside plants, and how many of them that inflation closes.
        strip_cells, strip_open: of the rolling map in strips, and those that are not lethal.
        stands, unseen: trunks and posts in sight, and those that the rolling map has no mark of.
        marks, stray: its marks, and those beside nothing.
        gone_scans: until what has left is gone from it.
    """

    asked: int
    through: Mapping[str, int]
    found: Mapping[str, int]
    closing_m: float | None
    parked: int
    closed: int
    strip_cells: int
    strip_open: int
    stands: int
    unseen: int
    marks: int
    stray: int
    gone_scans: int


def run(seeds: Sequence[int], folder: Path, progress: Callable[[float, str], None]) -> Proof:
    """Looks at one vineyard a seed; those that the folder has are not looked at again."""
    folder.mkdir(parents=True, exist_ok=True)
    cancellation, found = Cancellation(), []
    with cancellation.listening():
        for k, seed in enumerate(seeds):
            file = folder / f"seed{seed}.json"
            if not file.exists():
                if cancellation():
                    break
                progress(k / len(seeds), f"vineyard of seed {seed}")
                write_atomic(file, json.dumps(asdict(findings(yard(seed), seed))))
            found.append(Findings(**json.loads(file.read_text(encoding="utf-8"))))
    figures = (Figure(title=f"Ways across the rows in the vineyard of seed {seeds[0]}", svg=_map(seeds[0])),)
    return Proof(quantities=quantities(found), figures=figures, notes=NOTES, complete=len(found) == len(seeds))


def findings(place: Yard, seed: int) -> Findings:
    """What one vineyard shows; `seed` draws the noise of the scans."""
    place = without_obstacle(place)
    across = crossings(place)
    maps = {INFLATION: global_map(place), STRIPS: global_map(place, strips=True)}
    ways = {name: [way(costmap, *pair) for pair in across] for name, costmap in maps.items()}
    closing = next((grown for grown in GROWN_M if not _any_through(place, global_map(place, grown_m=grown))), None)
    narrow = None if closing is None else global_map(place, grown_m=closing)
    parked = [goal.pose for goal in place.goals]
    closed = 0 if narrow is None else sum(bool(narrow.blocked(pose, Footprint())[0]) for pose in parked)
    return Findings(
        asked=len(across),
        through={name: sum(crosses(path, place) for path in found) for name, found in ways.items()},
        found={name: sum(path is not None for path in found) for name, found in ways.items()},
        closing_m=closing,
        parked=len(parked) if narrow is not None else 0,
        closed=closed,
        **rolling_findings(place, seed),
    )


def without_obstacle(place: Yard) -> Yard:
    """Rows, fences and what belongs to them, without what stands in the lane: it is the last of the circles."""
    return replace(place, circles=place.circles[:-1])


def global_map(place: Yard, *, strips: bool = False, grown_m: float = 0.0) -> Costmap:
    """Everything that stands, grown by so many metres, and the usual inflation; with `strips`, those along rows too."""
    corners = np.vstack([*(row.line for row in place.rows), place.start[:2][None], *place.fences])
    spec = GridSpec.around(corners, 1.0)
    centres = spec.centres(np.argwhere(np.ones((spec.rows, spec.columns), bool)))
    occupied = np.zeros(len(centres), bool)
    for x, y, radius in place.circles:
        reach = radius + grown_m + 0.5 * CELL_M
        near = np.abs(centres - [x, y]).max(axis=1) <= reach
        occupied[near] |= np.hypot(*(centres[near] - [x, y]).T) <= reach
    stands = StaticLayer(100 * occupied.reshape(spec.rows, spec.columns).astype(int), spec)
    return layered_costmap(spec, [stands, PolygonLayer(place.fences)] if strips else [stands])


def crossings(place: Yard) -> list[tuple[Array, Array]]:
    """For each row start and goal (3,) x y yaw on its two sides, the row on the left, as near its middle as is free."""
    return [next(pair for share in SHARES if _free(pair := _sides(row.line, share), place)) for row in place.rows]


def _sides(line: Array, share: float) -> tuple[Array, Array]:
    along = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
    aside, yaw = RouteOptions().lateral * np.array([-along[1], along[0]]), float(np.arctan2(along[1], along[0]))
    spot = line[0] + share * (line[1] - line[0])
    return np.array([*(spot - aside), yaw]), np.array([*(spot + aside), yaw + np.pi])


def _free(pair: tuple[Array, Array], place: Yard) -> bool:
    return all(gap_to_circles(pose, place.circles, Footprint()) > CELL_M for pose in pair)


def way(costmap: Costmap, start: Array, goal: Array) -> Array | None:
    """(n, 2) m, a way that the global planner finds; None when there is none."""
    try:
        return plan_path(costmap, start, goal).poses[:, :2]
    except ActionFailed:
        return None


def crosses(path: Array | None, place: Yard) -> bool:
    """Whether a way leads through a row between its ends."""
    return path is not None and any(_crosses_line(path, row.line) for row in place.rows)


def _crosses_line(path: Array, line: Array) -> bool:
    along = line[1] - line[0]
    length = float(np.hypot(*along))
    d = path - line[0]
    share, aside = d @ along / length**2, (along[0] * d[:, 1] - along[1] * d[:, 0]) / length
    changes = aside[:-1] * aside[1:] < 0.0
    return bool((changes & (share[:-1] > 0.0) & (share[:-1] < 1.0)).any())


def _any_through(place: Yard, costmap: Costmap) -> bool:
    return any(crosses(way(costmap, *pair), place) for pair in crossings(place))


def rolling_findings(place: Yard, seed: int) -> dict[str, int]:
    """Strips, marks and clearing of a rolling map; the names of `Findings`."""
    rng, pose = np.random.default_rng([seed, 4]), place.goals[0].pose
    layer = ObstacleLayer(GridSpec.window(pose[:2], WINDOW_M))
    for _ in range(SCANS):
        _see(layer, place.circles, pose, rng)
    spec = layer.spec
    strips = _painted(PolygonLayer(place.fences), spec)
    both = layered_costmap(spec, [PolygonLayer(place.fences), layer]).cost
    marks = layer.points()
    gaps = np.hypot(marks[:, None, 0] - place.circles[:, 0], marks[:, None, 1] - place.circles[:, 1])
    things = _in_sight(place.circles, pose)
    seen = np.hypot(marks[:, None, 0] - things[:, 0], marks[:, None, 1] - things[:, 1]) - things[:, 2]
    return {
        "strip_cells": int(strips.sum()),
        "strip_open": int((both[strips] != LETHAL).sum()),
        "stands": len(things),
        "unseen": int((seen.min(axis=0, initial=np.inf) > NEAR_M).sum()),
        "marks": len(marks),
        "stray": int(((gaps - place.circles[:, 2]).min(axis=1, initial=np.inf) > NEAR_M).sum()),
        "gone_scans": _until_gone(layer, place, pose, rng),
    }


def _until_gone(layer: ObstacleLayer, place: Yard, pose: Array, rng: np.random.Generator) -> int:
    """Scans until something ahead that has left is gone from the map; more than `MOST_SCANS` when it stays."""
    spot = pose[:2] + 1.2 * np.array([np.cos(pose[2]), np.sin(pose[2])])
    for _ in range(SCANS):
        _see(layer, np.vstack([place.circles, [*spot, 0.15]]), pose, rng)
    before = {tuple(mark) for mark in _near(layer, spot)}
    for scans in range(1, MOST_SCANS + 1):
        _see(layer, place.circles, pose, rng)
        if not before & {tuple(mark) for mark in _near(layer, spot)}:
            return scans
    return MOST_SCANS + 1


def _near(layer: ObstacleLayer, spot: Array) -> Array:
    marks = layer.points()
    return marks[np.hypot(*(marks - spot).T) < 0.2]


def _see(layer: ObstacleLayer, circles: Array, pose: Array, rng: np.random.Generator) -> None:
    T_map_base = make_pose(rotation_z(pose[2]), (pose[0], pose[1], 0.0))
    layer.integrate(beams_from_scan(scan_of(circles, pose, rng), T_map_base, T_BASE_LASER))


def _painted(layer: PolygonLayer, spec: GridSpec) -> Array:
    cost = np.zeros((spec.rows, spec.columns), np.uint8)
    layer.paint(cost, spec)
    return cost == LETHAL


def _in_sight(circles: Array, pose: Array) -> Array:
    """(n, 3) circles of 2 cm and more near the scanner, with a free line to their middle."""
    eye = pose[:2] + T_BASE_LASER[0, 3] * np.array([np.cos(pose[2]), np.sin(pose[2])])
    thick = circles[circles[:, 2] >= 0.02]
    near = thick[np.hypot(*(thick[:, :2] - eye).T) < SIGHT_M]
    return np.array([c for c in near if not _hidden(c, circles, eye)]).reshape(-1, 3)


def _hidden(circle: Array, circles: Array, eye: Array) -> bool:
    ray = circle[:2] - eye
    distance = float(np.hypot(*ray))
    d = circles[:, :2] - eye
    along, aside = d @ ray / distance, np.abs(ray[0] * d[:, 1] - ray[1] * d[:, 0]) / distance
    return bool(((along > 0.0) & (along < distance - circle[2] - 1e-6) & (aside < circles[:, 2] + circle[2])).any())


def quantities(found: Sequence[Findings]) -> tuple[Quantity, ...]:
    """The row's figures over all vineyards."""
    closing = [f.closing_m for f in found if f.closing_m is not None]
    asked = sum(f.asked for f in found)
    return (
        _share(f"ways that lead through a row, {INFLATION}", sum(f.through[INFLATION] for f in found), asked,
               reference="inflation alone cannot close rows"),
        _share(f"ways that lead through a row, {STRIPS}", sum(f.through[STRIPS] for f in found), asked, goal="= 0"),
        _share(f"ways found, {STRIPS}", sum(f.found[STRIPS] for f in found), asked, goal=">= 0.99"),
        median_of("inflation beyond the usual that closes rows", "m", closing),
        _share("places beside plants that it closes too", sum(f.closed for f in found), sum(f.parked for f in found)),
        _share("cells of strips that are open in the rolling map", sum(f.strip_open for f in found),
               sum(f.strip_cells for f in found), goal="= 0"),
        _share("trunks, posts and things in sight without a mark", sum(f.unseen for f in found),
               sum(f.stands for f in found)),
        _share("marks beside nothing", sum(f.stray for f in found), sum(f.marks for f in found)),
        median_of("scans until what has left is gone", "1", [float(f.gone_scans) for f in found]),
        count_of("vineyards in which it stays", [f.gone_scans > MOST_SCANS for f in found]),
    )  # fmt: skip


def _share(name: str, number: int, of: int, *, goal: str = "", reference: str = "") -> Quantity:
    value = number / of if of else None
    return Quantity(
        name=name, unit="1", value=value, n=of, ci95=wilson95(number, of), goal=goal, reference=reference
    )  # fmt: skip


def _map(seed: int) -> str:
    place = without_obstacle(yard(seed))
    maps = {INFLATION: global_map(place), STRIPS: global_map(place, strips=True)}
    tracks = {
        name: [path.tolist() for pair in crossings(place) if (path := way(costmap, *pair)) is not None]
        for name, costmap in maps.items()
    }
    return map_of(place, tracks)


EXPERIMENT = Experiment(
    row="G4",
    summary="What closes rows in a costmap, inflation or strips, and how true a rolling map of scans alone is.",
    seeds=range(500, 600),
    run=run,
)
