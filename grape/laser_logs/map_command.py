"""`grape map` behind its options."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from grape.errors import InvalidInput
from grape.folders import open_folder
from grape.laser_logs.picture import write_picture
from grape.mapping.carmen import CarmenLog, read_carmen
from grape.mapping.map_file import save_map
from grape.mapping.scans import GridOptions, grid_from_scans
from grape.mapping.slam import SlamOptions, run_slam
from grape.mapping.trajectory_error import relation_error, trajectory_error
from grape.messages import Array
from grape.mission.record import write_atomic
from grape.proving.show import live_progress

SCHEMA = "grape.map/1"
POSES = ("slam", "odometry", "corrected")


def map_command(
    log_file: Path, out: Path | None, poses: str, resolution: float, max_range: float, laser: str | None
) -> None:
    """Build a map as `grape map` does.

    Raises:
        GrapeError: the log has problems, or lacks what was asked for.
    """
    if poses not in POSES:
        raise InvalidInput(f"--poses {poses}: allowed: {', '.join(POSES)}")
    if not (0.005 <= resolution <= 5.0 and 0.5 <= max_range <= 1000.0):
        raise InvalidInput("--resolution from 0.005 to 5 m and --max-range from 0.5 to 1000 m")
    console = Console()
    log = read_carmen(log_file, laser)
    console.print(log_line(log), highlight=False, soft_wrap=True)
    if poses == "corrected" and log.corrected is None:
        raise InvalidInput(f"--poses corrected: {log_file} has no corrected poses; allowed: slam, odometry")
    folder = open_folder(out, f"map-{stem(log_file)}")
    with live_progress(console) as progress:
        path, figures = _poses(log, poses, max_range, progress)
        progress(0.99, "drawing the map")
        grid = grid_from_scans(log.scans, path, log.mount, GridOptions(resolution=resolution, max_range=max_range))
    save_map(grid, folder / "map.yaml")
    write_picture(grid, path, folder / "map.png", log.corrected if log.corrected is None else aligned(log, path))
    write_path(folder / "path.csv", log.stamps, path)
    result = {"schema": SCHEMA, "log": str(log_file), "laser": log.laser, "scans": len(log.scans), "poses": poses}
    result |= {**figures, "occupied_cells": int(grid.occupied().sum())}
    result |= {"errors": errors_of(log, path), "odometry_errors": errors_of(log, log.odometry)}
    write_atomic(folder / "map.json", json.dumps(result, indent=2, allow_nan=False) + "\n")
    tell_errors(console, result)
    console.print(
        f"written: {folder / 'map.yaml'}, map.pgm, map.png, path.csv, map.json", highlight=False, soft_wrap=True
    )


def log_line(log: CarmenLog) -> str:
    """One line about a log."""
    scan, reference = log.scans[0], "with" if log.corrected is not None else "without"
    return (
        f"{log.file}: {len(log.scans)} scans of {scan.ranges.size} beams ({log.laser}),"
        f" {abs(log.scans[-1].stamp - scan.stamp):.0f} s, {reference} corrected poses"
    )


def stem(log_file: Path) -> str:
    """The log's name without its endings."""
    return log_file.name.split(".")[0] or "log"


def errors_of(log: CarmenLog, path: Array) -> dict[str, Any] | None:
    """Errors of poses (n, 3) against the log's corrected ones, or None."""
    if log.corrected is None or len(path) < 2:
        return None
    error = asdict(trajectory_error(path, log.corrected))
    return {**error, "fit": error["fit"].tolist(), "relations": asdict(relation_error(path, log.corrected))}


def tell_errors(console: Console, result: dict[str, Any]) -> None:
    """Errors in a sentence each."""
    for key, name in (("errors", str(result["poses"])), ("odometry_errors", "odometry")):
        error = result[key]
        if error is not None and (key == "errors" or result["poses"] != "odometry"):
            console.print(
                f"{name} against the log's corrected poses, best rigid fit: {error['position_rmse']:.3f} m root mean"
                f" square, {error['position_max']:.3f} m at most, {np.degrees(error['yaw_rmse']):.2f} degrees;"
                f" from scan to scan {error['relations']['translation']:.4f} m",
                highlight=False,
                soft_wrap=True,
            )


def write_path(file: Path, stamps: Array, path: Array) -> None:
    """Poses as CSV: t, x, y, yaw."""
    lines = [f"{t:.6f},{x:.4f},{y:.4f},{yaw:.5f}" for t, (x, y, yaw) in zip(stamps, path, strict=True)]
    write_atomic(file, "\n".join(["t,x,y,yaw", *lines]) + "\n")


def aligned(log: CarmenLog, path: Array) -> Array:
    """The log's corrected poses moved by the best rigid fit onto a path."""
    from grape.mapping.planar import compose
    from grape.mapping.trajectory_error import rigid_fit

    corrected = np.asarray(log.corrected)
    return compose(rigid_fit(corrected, path), corrected)


def _poses(
    log: CarmenLog, poses: str, max_range: float, progress: Callable[[float, str], None]
) -> tuple[Array, dict[str, Any]]:
    if poses != "slam":
        return np.asarray(log.odometry if poses == "odometry" else log.corrected), {}
    progress(0.0, "compiling")
    options = SlamOptions(max_range=max_range)
    found = run_slam(log.scans, log.odometry, log.mount, options, lambda part, text: progress(0.95 * part, text))
    return found.poses, {"nodes": len(found.nodes), "loops": int(found.loops), "lost": found.lost.tolist()}
