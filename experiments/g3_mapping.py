"""Row G3: maps by laser SLAM and places by AMCL, in buildings and in vineyards, against the truth."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grape.errors import InvalidInput
from grape.experiments.laser_worlds import MAX_RANGE, LaserWorld, building, drifting, laser_scans, vineyard, way_of
from grape.laser_logs.picture import write_picture
from grape.localization import Amcl, AmclEstimate, AmclOptions, LikelihoodField
from grape.mapping import (
    GridOptions,
    OccupancyGrid,
    SlamOptions,
    between,
    compose,
    grid_from_scans,
    rigid_fit,
    run_slam,
    trajectory_error,
    transform_points,
)
from grape.messages import Array, LaserScan
from grape.mission.svg import PALETTE, drawing, line_chart, tag
from grape.proof import Experiment, Figure, Proof, Quantity, median95, wilson95

WORLDS: dict[str, Callable[[int], LaserWorld]] = {"building": building, "vineyard": vineyard}
TRIALS = ("known start", "anywhere", "carried away")
SLAM_EVERY = 5  # seeds: every fifth is mapped
CLUTTER = 0.1  # share of the beams
START_STD = np.array([0.3, 0.3, 0.15])
SETTLED = 20  # updates after which a known start counts as converged
LAST = 10  # updates at the end of which a place counts as found, or not
FOUND_M = 0.5
NOTES = (
    "Worlds are drawn from the seed as grids of 5 cm; ranges of 181 beams over 180 degrees, up to 20 m, are cast in "
    f"them with noise of 1 cm; {100 * CLUTTER:g} % of the beams end anywhere before the wall. Each step of odometry "
    "(0.35 m) errs by 3 % and turns by 0.004 rad too far.",
    "Buildings: a corridor of 2.4 m around rooms, driven 1.1 times round. Vineyards: four rows of thin trunks 1.15 m "
    "apart, 2.6 m between rows, 6 % of the vines missing, driven up and down and back.",
    f"AMCL has the true map. Known start: off by {START_STD[0]} m and {START_STD[2]} rad; its errors count from the "
    f"{SETTLED}th scan on. Found: within {FOUND_M} m of the truth at each of the last {LAST} scans.",
    "Carried away: after half of the way the robot stands where it began, and its odometry does not know.",
    "SLAM: every fifth seed, by odometry and scans alone. Its map is laid on the truth by the best rigid fit of the "
    "way; each occupied cell's distance to the nearest true one is its error.",
)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run of AMCL: errors (m) and particles, scan by scan."""

    errors: tuple[float, ...]
    particles: tuple[int, ...]

    @property
    def found(self) -> bool:
        """Whether the robot's place was known at the end."""
        return max(self.errors[-LAST:]) < FOUND_M

    def until_found(self, since: int = 0) -> int | None:
        """Scans from `since` on until the place is known and stays so; None when it is not at the end."""
        if not self.found:
            return None
        lost = np.flatnonzero(np.array(self.errors[since:]) >= FOUND_M)
        return int(lost[-1]) + 1 if len(lost) else 0


def run(seeds: Sequence[int], folder: Path, progress: Callable[[float, str], None]) -> Proof:
    """One building and one vineyard a seed; what the folder has is not run again."""
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in WORLDS}
    for k, seed in enumerate(seeds):
        for name in WORLDS:
            progress(k / len(seeds), f"{name} of seed {seed}")
            file = folder / f"{name}_{seed}.json"
            if not file.exists():
                file.write_text(json.dumps(measure(name, seed, folder)), encoding="utf-8")
            found[name].append(json.loads(file.read_text(encoding="utf-8")))
    quantities = [q for name, results in found.items() for q in _quantities(name, results)]
    return Proof(quantities=tuple(quantities), figures=_figures(found, seeds, folder), notes=NOTES)


def measure(name: str, seed: int, folder: Path) -> dict[str, Any]:
    """All trials in one world, and its map where the seed is one of those; pictures go to the folder."""
    world, rng = WORLDS[name](seed), np.random.default_rng([seed, 3])
    true = way_of(world)
    odometry, scans = drifting(true, rng), laser_scans(world.grid, true, rng, clutter=CLUTTER)
    field = LikelihoodField(world.grid)
    result: dict[str, Any] = {
        kind: asdict(localised(field, kind, true, odometry, scans, np.random.default_rng([seed, 4 + k])))
        for k, kind in enumerate(TRIALS)
    }
    if seed % SLAM_EVERY == 0:
        result["slam"] = mapped(world.grid, true, odometry, scans, folder / f"{name}_{seed}.png")
    return result


def localised(
    field: LikelihoodField, kind: str, true: Array, odometry: Array, scans: list[LaserScan], rng: np.random.Generator
) -> Trial:
    """AMCL over a way."""
    amcl = Amcl(field, AmclOptions(max_range=MAX_RANGE))
    if kind == "anywhere":
        amcl.start_anywhere(rng)
    else:
        amcl.start(true[0] + START_STD * rng.standard_normal(3), np.diag(START_STD**2), rng)
    order, half = np.arange(len(true)), len(true) // 2
    if kind == "carried away":
        order[half:] -= half
        odometry = np.vstack(
            [odometry[:half], compose(odometry[half - 1], between(odometry[0], odometry[order[half:]]))]
        )
    steps: list[tuple[AmclEstimate, int]] = [
        (amcl.update(odometry[k], scans[at], rng), int(at)) for k, at in enumerate(order)
    ]
    return Trial(
        errors=tuple(float(np.hypot(*(estimate.pose - true[at])[:2])) for estimate, at in steps),
        particles=tuple(estimate.particles for estimate, _ in steps),
    )


def mapped(truth: OccupancyGrid, true: Array, odometry: Array, scans: list[LaserScan], picture: Path) -> dict[str, Any]:
    """Errors of SLAM's way and map; the picture shows the map, its way and the true one."""
    found = run_slam(scans, odometry, options=SlamOptions(max_range=MAX_RANGE))
    error, drift = trajectory_error(found.poses, true), trajectory_error(odometry, true)
    grid = grid_from_scans(scans, found.poses, options=GridOptions(max_range=MAX_RANGE))
    write_picture(grid, found.poses, picture, compose(rigid_fit(true, found.poses), true))
    return {
        "way_m": error.position_rmse,
        "odometry_m": drift.position_rmse,
        "map_m": map_errors(grid, truth, error.fit).tolist(),
        "loops": int(found.loops),
        "lost": len(found.lost),
    }


def map_errors(grid: OccupancyGrid, truth: OccupancyGrid, fit: Array) -> Array:
    """(n,) m from occupied cells of a map, moved by the fit (3,), to the nearest occupied cell of the truth."""
    from scipy.spatial import cKDTree

    walls = cKDTree(truth.spec.centres(np.argwhere(truth.occupied())))
    cells = transform_points(fit, grid.spec.centres(np.argwhere(grid.occupied())))
    return np.round(np.asarray(walls.query(cells)[0]), 4)


def _quantities(name: str, results: list[dict[str, Any]]) -> list[Quantity]:
    trials = {kind: [Trial(**result[kind]) for result in results] for kind in TRIALS}
    known = np.concatenate([trial.errors[SETTLED:] for trial in trials[TRIALS[0]]])
    particles = np.concatenate([trial.particles[SETTLED:] for trial in trials[TRIALS[0]]])
    half = [len(trial.errors) // 2 for trial in trials[TRIALS[2]]]
    waits = {
        TRIALS[1]: [trial.until_found() for trial in trials[TRIALS[1]]],
        TRIALS[2]: [trial.until_found(k) for trial, k in zip(trials[TRIALS[2]], half, strict=True)],
    }
    n = len(known)
    quantities = [
        _quantity(name, "AMCL, known start: error, root mean square", "m", float(np.sqrt((known**2).mean())), n),
        _quantity(name, "AMCL, known start: error, 95th percentile", "m", float(np.percentile(known, 95)), n),
        _quantity(name, "AMCL, known start: particles, median", "1", float(np.median(particles)), n),
    ]
    for kind in TRIALS:
        yes, n = sum(trial.found for trial in trials[kind]), len(results)
        rate = Quantity(
            name=f"{name}: AMCL, {kind}: found at the end", unit="1", value=yes / n, n=n, ci95=wilson95(yes, n)
        )
        quantities.append(rate)
    for kind, scans in waits.items():
        values = [value for value in scans if value is not None]
        median = float(np.median(values)) if values else None
        text = f"AMCL, {kind}: scans until found, median of those found"
        quantities.append(_quantity(name, text, "1", median, len(values), median95(values)))
    return quantities + _map_quantities(name, [result["slam"] for result in results if "slam" in result])


def _map_quantities(name: str, maps: list[dict[str, Any]]) -> list[Quantity]:
    if not maps:
        return []
    n, errors = len(maps), np.concatenate([found["map_m"] for found in maps])
    return [
        _quantity(
            name, "odometry: error of the way, median", "m", float(np.median([m["odometry_m"] for m in maps])), n
        ),
        _quantity(name, "SLAM: error of the way, median", "m", float(np.median([m["way_m"] for m in maps])), n),
        _quantity(name, "SLAM: error of the way, worst", "m", float(max(m["way_m"] for m in maps)), n),
        _quantity(name, "SLAM: occupied cells, 95th percentile", "m", float(np.percentile(errors, 95)), len(errors)),
        _quantity(name, "SLAM: loop closures, median", "1", float(np.median([m["loops"] for m in maps])), n),
    ]


def _quantity(
    world: str, name: str, unit: str, value: float | None, n: int, ci95: tuple[float, float] | None = None
) -> Quantity:
    return Quantity(name=f"{world}: {name}", unit=unit, value=value, n=n, ci95=ci95)


def _figures(found: dict[str, list[dict[str, Any]]], seeds: Sequence[int], folder: Path) -> tuple[Figure, ...]:
    """Errors of the first seed's trials, and the first map of each world."""
    figures = []
    for name, results in found.items():
        lines = [
            (kind, list(enumerate(results[0][kind]["errors"])), colour)
            for kind, colour in zip(TRIALS, PALETTE, strict=False)
        ]
        chart = line_chart(lines, x_title="scan", y_title="error of AMCL (m)")
        figures.append(Figure(title=f"AMCL in the {name} of seed {seeds[0]}", svg=chart))
        pictures = [folder / f"{name}_{seed}.png" for seed in seeds if seed % SLAM_EVERY == 0]
        if pictures:
            title = f"SLAM's map of a {name} ({pictures[0].name}), its way in blue, the true one in green"
            figures.append(Figure(title=title, svg=embedded(pictures[0])))
    return tuple(figures)


def embedded(picture: Path) -> str:
    """A PNG as an <svg> element."""
    import cv2

    pixels = cv2.imread(str(picture))
    if pixels is None:
        raise InvalidInput(f"{picture} is no picture; take another folder, or remove its JSON file beside it")
    height, width = pixels.shape[:2]
    data = base64.b64encode(picture.read_bytes()).decode("ascii")
    return drawing(width, height, [tag("image", href=f"data:image/png;base64,{data}", width=width, height=height)])


EXPERIMENT = Experiment(
    row="G3",
    summary="Laser SLAM and Monte Carlo localisation in drawn buildings and vineyards, compared with the truth.",
    seeds=range(500, 520),
    run=run,
)
