"""`grape localize` behind its options."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from grape.errors import InvalidInput
from grape.folders import open_folder
from grape.laser_logs.map_command import aligned, log_line, stem, write_path
from grape.laser_logs.picture import write_picture
from grape.localization.amcl import Amcl, AmclEstimate, AmclOptions
from grape.localization.likelihood_field import LikelihoodField
from grape.mapping.carmen import CarmenLog, read_carmen
from grape.mapping.map_file import load_map
from grape.mapping.trajectory_error import trajectory_error
from grape.messages import Array
from grape.mission.record import write_atomic
from grape.proving.show import live_progress

SCHEMA = "grape.localize/1"
ANYWHERE = "anywhere"
SURE, IN_A_ROW = 0.9, 10  # weight of the heaviest cluster, at so many scans: a first guess may be sure and wrong
START_STD = np.array([0.3, 0.3, 0.2])


@dataclass(frozen=True, kw_only=True)
class Localisation:
    """Estimates at each scan, and the scan (index) that is the last of the first `IN_A_ROW` sure ones, or None."""

    estimates: tuple[AmclEstimate, ...]
    settled: int | None

    @property
    def poses(self) -> Array:
        """(n, 3) x y yaw."""
        return np.array([estimate.pose for estimate in self.estimates])


def localize_command(
    log_file: Path, map_file: Path, start: str, seed: int, out: Path | None, laser: str | None, max_range: float
) -> bool:
    """Localise a log as `grape localize` does; true when the filter found its place.

    Raises:
        GrapeError: log or map has problems.
    """
    pose = _start_pose(start)
    console = Console()
    grid, log = load_map(map_file), read_carmen(log_file, laser)
    console.print(log_line(log), highlight=False, soft_wrap=True)
    folder = open_folder(out, f"localize-{stem(log_file)}")
    amcl = Amcl(LikelihoodField(grid), AmclOptions(max_range=max_range), log.mount)
    rng = np.random.default_rng(seed)
    if pose is None:
        amcl.start_anywhere(rng)
    else:
        amcl.start(pose, np.diag(START_STD**2), rng)
    with live_progress(console) as progress:
        done = localize_log(amcl, log, rng, progress)
    reference = aligned(log, done.poses) if log.corrected is not None else None
    write_picture(grid, done.poses[done.settled or 0 :], folder / "localize.png", reference)
    write_path(folder / "path.csv", log.stamps, done.poses)
    result = {"schema": SCHEMA, "log": str(log_file), "map": str(map_file), "start": start, "seed": seed}
    result |= {"scans": len(log.scans), "settled_at_scan": done.settled, **_figures(log, done)}
    write_atomic(folder / "localize.json", json.dumps(result, indent=2, allow_nan=False) + "\n")
    _tell(console, result)
    console.print(f"written: {folder / 'localize.json'}, localize.png, path.csv", highlight=False, soft_wrap=True)
    return done.settled is not None


def localize_log(
    amcl: Amcl,
    log: CarmenLog,
    rng: np.random.Generator,
    on_progress: Callable[[float, str], None] = lambda fraction, sentence: None,
) -> Localisation:
    """Run a started filter over a log."""
    estimates: list[AmclEstimate] = []
    settled, sure = None, 0
    for k, (scan, odometry) in enumerate(zip(log.scans, log.odometry, strict=True)):
        estimate = amcl.update(odometry, scan, rng)
        estimates.append(estimate)
        sure = sure + 1 if estimate.share >= SURE else 0
        if settled is None and sure == IN_A_ROW:
            settled = k
        on_progress(k / len(log.scans), f"scan {k + 1} of {len(log.scans)}, {estimate.particles} particles")
    return Localisation(estimates=tuple(estimates), settled=settled)


def _start_pose(text: str) -> Array | None:
    if text == ANYWHERE:
        return None
    try:
        pose = np.array([float(part) for part in text.split(",")])
    except ValueError:
        pose = np.zeros(0)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise InvalidInput(f"--start {text}: allowed: X,Y,YAW in metres and radians, or {ANYWHERE}")
    return pose


def _figures(log: CarmenLog, done: Localisation) -> dict[str, Any]:
    particles = [estimate.particles for estimate in done.estimates]
    figures: dict[str, Any] = {
        "particles_median": int(np.median(particles)),
        "updates": sum(estimate.updated for estimate in done.estimates),
        "errors": None,
        "errors_in_the_map": None,
    }
    begin = done.settled
    if log.corrected is not None and begin is not None and len(log.scans) - begin >= 2:
        estimate, reference = done.poses[begin:], log.corrected[begin:]
        for key, fit in (("errors", True), ("errors_in_the_map", False)):
            error = asdict(trajectory_error(estimate, reference, fit))
            figures[key] = {**error, "fit": error["fit"].tolist()}
    return figures


def _tell(console: Console, result: dict[str, Any]) -> None:
    settled = result["settled_at_scan"]
    if settled is None:
        console.print("the filter was never sure of one place: is it the right map?", highlight=False)
        return
    console.print(
        f"sure of its place from scan {settled + 1} of {result['scans']};"
        f" {result['particles_median']} particles in the median",
        highlight=False,
    )
    for key, frame in (("errors_in_the_map", "taken as poses in the map"), ("errors", "best rigid fit")):
        error = result[key]
        if error is not None:
            console.print(
                f"against the log's corrected poses, {frame}: {error['position_rmse']:.3f} m root mean square,"
                f" {error['position_median']:.3f} m in the median, {error['position_max']:.3f} m at most,"
                f" {np.degrees(error['yaw_rmse']):.2f} degrees",
                highlight=False,
                soft_wrap=True,
            )
