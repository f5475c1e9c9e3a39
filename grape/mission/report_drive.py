"""The drive in the report: all estimates in one map, a slider through time, and the map beside the truth."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from grape.messages import Array
from grape.mission.drive_record import WHEELS, changed, read_drive
from grape.mission.page import none, number, table
from grape.mission.report_map import ESTIMATE_COLOUR, MARGIN, TRUE_COLOUR, site_frame, site_map
from grape.mission.report_script import SCRIPT
from grape.mission.svg import PALETTE, Frame, drawing, tag
from grape.site import Site

TRUTH, EKF, GNSS, AMCL = "truth", "ekf", "gnss", "amcl"
NAMES = {TRUTH: "true path", EKF: "estimate (EKF)", WHEELS: "wheels only", GNSS: "GNSS fixes", AMCL: "AMCL"}
COLOURS = {
    TRUTH: TRUE_COLOUR, EKF: ESTIMATE_COLOUR, WHEELS: "#e08a3c", GNSS: "#1a9a9a", AMCL: "#3d7d2c",
    "plan": "#c2185b", "scan": "#d62728",
}  # fmt: skip
NEAR_M = 0.15  # so near to something that stands, a cell is right
MAP_WIDTH = 520.0


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What drive.jsonl and standing.csv tell.

    Attributes:
        estimates: (n, 4) t, x, y, yaw by source, besides the track's own.
        fixes: t, x, y and status of each.
        plans: time and points of each; no points when the drive has ended.
        obstacles: time, cells that came and cells that went.
        scans: time, pose of the base and packed points.
        standing: (n, 2) m, middles of cells in which something stands; None where nobody knows.
    """

    footprint: Sequence[Sequence[float]] = ((0.5, 0.335), (-0.5, 0.335), (-0.5, -0.335), (0.5, -0.335))
    cell_m: float = 0.1
    estimates: Mapping[str, Array] = field(default_factory=dict)
    fixes: Sequence[tuple[float, float, float, str]] = ()
    plans: Sequence[tuple[float, Any]] = ()
    obstacles: Sequence[tuple[float, Any, Any]] = ()
    scans: Sequence[tuple[float, Any, str]] = ()
    standing: Array | None = None


def load_drive(folder: Path) -> Drive:
    """What a run folder has of the drives; of an older run that is nothing."""
    lines = list(read_drive(folder / "drive.jsonl"))
    of = {kind: [line for line in lines if line["kind"] == kind] for kind in ("gnss", "plan", "obstacles", "scan")}
    estimates: dict[str, list[list[float]]] = {}
    for line in lines:
        if line["kind"] == "estimate":
            estimates.setdefault(line["source"], []).append([line["t"], *line["pose"]])
    robot = next(({key: line[key] for key in ("footprint", "cell_m")} for line in lines if line["kind"] == "robot"), {})
    return Drive(
        **robot,
        estimates={source: np.array(rows) for source, rows in estimates.items()},
        fixes=[(line["t"], *line["place"], line["status"]) for line in of["gnss"]],
        plans=[(line["t"], line["points"]) for line in of["plan"]],
        obstacles=[(line["t"], line["added"], line["gone"]) for line in of["obstacles"]],
        scans=[(line["t"], line["pose"], line["points_cm"]) for line in of["scan"]],
        standing=_standing(folder / "standing.csv"),
    )


def drive_view(
    site: Site,
    path: Array,
    plants: Mapping[str, Any],
    drive: Drive,
    started: Sequence[tuple[float, str]],
    film: Sequence[tuple[float, str]] = (),
) -> str:
    """The map with all paths, a slider, and what the robot had in view at each moment.

    Args:
        path: (n, 4) t, x, y, yaw as estimated, or (n, 7) with the true x, y, yaw.
        plants: the mission's plants by id, as in result.json.
        started: when which plant was begun.
        film: time and file of each picture of a film, which the page shows beside the map without holding it.
    """
    if not len(path):
        return site_map(site, path, plants, [])
    lines = _paths(path, drive)
    layers = [
        tag("polyline", points=points, class_=f"line layer-{name}", stroke=COLOURS.get(name, PALETTE[4]), **dashes)
        for name, points, dashes in ((n, site_frame(site, path)[0].points(p), _dashes(n)) for n, p in lines.items())
    ]
    layers += _fixes(site_frame(site, path)[0], drive)
    boxes = [*lines, *([GNSS] if drive.fixes else []), *(["plan"] if drive.plans else [])]
    boxes += (["costmap"] if drive.obstacles else []) + (["scan"] if drive.scans else [])
    text = json.dumps(_data(site, path, drive, started) | {"film": film}, separators=(",", ":")).replace("<", "\\u003c")
    begin, end = float(path[0, 0]), float(path[-1, 0])
    return (
        f'<div class="stage" id="drive">{site_map(site, path, plants, layers)}<canvas></canvas></div>{_screen(film)}'
        '<div class="controls"><button id="drive-play" title="play">▶</button>'
        f'<input type="range" id="drive-time" min="{begin:g}" max="{end:g}" step="0.1" value="{begin:g}">'
        '<span id="drive-caption"></span></div>'
        f'<p class="key">{"".join(_box(name) for name in boxes)}'
        '<label><input type="checkbox" id="drive-follow">follow the robot</label></p>'
        f'<script type="application/json" id="drive-data">{text}</script><script>{SCRIPT}</script>'
    )


def estimate_table(path: Array, drive: Drive) -> str:
    """How far each estimate of the position was from the true path."""
    if path.shape[1] < 7 or not len(path):
        return ""
    fixes = np.array([fix[:3] for fix in drive.fixes]).reshape(-1, 3)
    held = {source: _held(rows, path[:, 0]) for source, rows in drive.estimates.items()}
    tracks = {**held, GNSS: fixes, EKF: path[:, :3]}
    rows = []
    for source, track in tracks.items():
        if not len(track):
            continue
        true = np.column_stack([np.interp(track[:, 0], path[:, 0], path[:, k]) for k in (4, 5)])
        error = np.hypot(*(track[:, 1:3] - true).T)
        rms = float(np.sqrt((error**2).mean()))
        cells = [NAMES.get(source, source), str(len(error))]
        rows.append([*cells, *(number(value, 3, " m") for value in (rms, float(error.max()), float(error[-1])))])
    return table(["estimate of the position", "samples", "error, RMS", "largest", "at the end"], rows)


def map_beside_truth(site: Site, path: Array, drive: Drive) -> str:
    """All cells in which an obstacle was ever seen, beside those in which something stands."""
    cells: set[tuple[int, int]] = set()
    for _, added, _ in drive.obstacles:
        cells = changed(cells, {"added": added, "gone": []})
    if not cells:
        return none("no obstacles were recorded")
    seen = (np.array(sorted(cells)) + 0.5) * drive.cell_m
    frame, height = site_frame(site, path, MAP_WIDTH)
    panels = [_panel(frame, height, "seen by the robot", seen, drive.cell_m)]
    text = f"{len(seen)} cells of {100 * drive.cell_m:g} cm in which an obstacle was seen at some time"
    if drive.standing is not None and len(drive.standing):
        from scipy.spatial import cKDTree

        near = cKDTree(drive.standing).query(seen)[0] <= NEAR_M
        panels.append(_panel(frame, height, "what stands there", drive.standing, drive.cell_m))
        text += f"; {100 * float(near.mean()):.0f} % of them within {NEAR_M:g} m of something that stands there"
    return f'<div class="maps">{"".join(panels)}</div><p class="sub">{text}.</p>'


def _panel(frame: Frame, height: float, title: str, points: Array, cell: float) -> str:
    metre = frame.width / (frame.x[1] - frame.x[0])
    size = max(cell * metre, 1.5)
    steps = "".join(
        f"M{x - size / 2:.1f} {y - size / 2:.1f}h{size:.1f}v{size:.1f}h-{size:.1f}z"
        for x, y in (frame.at(float(p[0]), float(p[1])) for p in points)
    )
    ground = tag("rect", x=0, y=0, width=frame.width + 2 * MARGIN, height=height, fill="#f6f4ee", rx=8)
    picture = drawing(frame.width + 2 * MARGIN, height, [ground, tag("path", d=steps, fill="#4a3b2f")], "map")
    return f"<figure>{picture}<figcaption>{escape(title)}</figcaption></figure>"


def _paths(path: Array, drive: Drive) -> dict[str, Array]:
    """(n, 2) by name, what lies on top last."""
    true = {TRUTH: path[:, 4:6]} if path.shape[1] >= 7 else {}
    return {**{source: rows[:, 1:3] for source, rows in drive.estimates.items()}, **true, EKF: path[:, 1:3]}


def _dashes(name: str) -> dict[str, str]:
    return {} if name == TRUTH else {"stroke_dasharray": "5 3"}


def _fixes(frame: Frame, drive: Drive) -> list[str]:
    """A point for each fix; hollow where the receiver had no integer solution."""
    parts = []
    for _, x, y, status in drive.fixes:
        u, v = frame.at(x, y)
        fill = COLOURS[GNSS] if status == "fix" else "none"
        parts.append(tag("circle", cx=u, cy=v, r=1.6, fill=fill, stroke=COLOURS[GNSS], stroke_width=0.6))
    return [tag("g", "".join(parts), class_=f"layer-{GNSS}")] if parts else []


def _box(name: str) -> str:
    colour = COLOURS.get(name, "#6b4f3a" if name == "costmap" else PALETTE[4])
    return (
        f'<label><input type="checkbox" data-layer="{escape(name)}" checked><i style="background:{colour}"></i>'
        f"{escape(NAMES.get(name, name))}</label>"
    )


def _screen(film: Sequence[tuple[float, str]]) -> str:
    return f'<img id="drive-film" alt="what a camera behind the robot saw" src="{film[0][1]}">' if film else ""


def _data(site: Site, path: Array, drive: Drive, started: Sequence[tuple[float, str]]) -> dict[str, Any]:
    """What the script needs; rows begin with their time. Where the robot stood, the path has no rows."""
    frame, _ = site_frame(site, path)
    moves = np.abs(np.diff(path[:, 1:], axis=0)).max(axis=1) > 0.002
    kept = np.concatenate([[True], moves])
    kept[-1] = True
    footprint = np.array(drive.footprint)
    return {
        "frame": {key: getattr(frame, key) for key in ("left", "top", "width", "height", "x", "y")},
        "footprint": drive.footprint,
        "inscribed": float(np.abs(footprint).max(axis=0).min()),
        "cell_m": drive.cell_m,
        "colours": {**dict.fromkeys(drive.estimates, PALETTE[4]), **COLOURS},
        "path": np.round(path[kept], 3).tolist(),
        "estimates": {source: rows.tolist() for source, rows in drive.estimates.items()},
        "fixes": drive.fixes,
        "plans": drive.plans,
        "obstacles": drive.obstacles,
        "scans": drive.scans,
        "plants": started,
    }


def _held(rows: Array, times: Array) -> Array:
    """(n, 3) t, x, y of a track at other times: the newest row that is not after each."""
    newest = np.maximum(np.searchsorted(rows[:, 0], times, side="right") - 1, 0)
    return np.column_stack([times, rows[newest, 1:3]])


def _standing(path: Path) -> Array | None:
    if not path.exists():
        return None
    with path.open(encoding="utf-8") as file:
        _, *rows = list(csv.reader(file))
    return np.array(rows, float).reshape(-1, 2)
