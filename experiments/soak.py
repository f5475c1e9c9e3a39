"""S1: two simulated hours of driving in a vineyard of two hectares, in sessions as long as one likes."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from grape.actions.shortest_way import route_options
from grape.messages import Array
from grape.mission.command import Cancellation
from grape.mission.drive_record import read_drive
from grape.mission.file import load_mission
from grape.mission.launch import resume_mission, run_mission
from grape.mission.progress import Progress
from grape.mission.record import read_events, write_atomic
from grape.mission.svg import PALETTE, line_chart
from grape.proof import Experiment, Figure, Proof, Quantity
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.worlds import VineyardOptions, vineyard_site
from grape.site import Site

HOURS = 2.0
# 24 rows of 48 vines on 144 m by 149 m. Real ones stand closer, but all that stands is built.
WORLD: Mapping[str, Any] = {
    "rows": 24, "vines_per_row": 48, "row_spacing": 6.0, "vine_spacing": 3.0, "post_spacing": 12.0, "nails_per_row": 0,
    "weeds": 0.2, "terrain_resolution": 0.25, "roughness_correlation": 0.75,
}  # fmt: skip
PAST_ROWS_M = 2.2  # from the row's end to where the robot turns
DRIVE_LIMIT_S = 900.0
MEMORY_PERIOD_S = 20.0  # simulated
WARM_S = 300.0  # of a session, until everything is loaded and compiled
STOP_S = 3.0
STILL_M, STILL_RAD = 0.01, 0.01  # within a second
SETTLE_S = 10.0  # with an integer fix, until what a float spell did to the estimate is gone
NOTES = (
    "A mission without dispensers drives along every row and round every headland of 24 rows, again and again, with all"
    " sensors and the physics of the whole base; the arm stays folded. `track.csv`, `events.jsonl` and `drive.jsonl` of"
    " the run tell the rest.",
    f"Stops: {STOP_S:g} s and more within a drive without 1 cm or 0.01 rad of motion a second. Reasons: no integer fix"
    " of the receiver, a recovery, somebody near the path, the base's guard, or an end of the drive beside it.",
    f"Memory: what the process holds, from {WARM_S:g} s of each session on, by a line through it. What the run"
    " remembers of its own path is in it.",
    "Drift: whether the error grows where the receiver has its fix. The error of a whole quarter goes with how many"
    " float spells were drawn in it.",
)


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A stop within a drive: from when to when (s), and why; empty when nothing tells."""

    start_s: float
    end_s: float
    reason: str


def run(seeds: Sequence[int], folder: Path, progress: Callable[[float, str], None]) -> Proof:
    """One long drive a seed; what was begun goes on. When it is asked to stop, the figures are of what was driven."""
    cancellation = Cancellation()
    with cancellation.listening():
        for k, seed in enumerate(seeds):
            if cancellation():
                break
            drive(seed, folder / f"seed{seed}", cancellation, partial(_show, progress, k, len(seeds)))
    runs = [folder / f"seed{seed}" for seed in seeds if (folder / f"seed{seed}" / "result.json").exists()]
    ended = [run for run in runs if _result(run)["ended_by"] != "aborted"]
    quantities = tuple(quantity for run in runs for quantity in measured(run))
    figures = tuple(figure for run in runs for figure in _figures(run))
    return Proof(quantities=quantities, figures=figures, notes=NOTES, complete=len(ended) == len(seeds))


def drive(seed: int, folder: Path, cancelled: Callable[[], bool], show: Callable[[Progress], None]) -> None:
    """Begin the drive of a seed or go on with it, until its time is up or somebody asks to stop."""
    inputs = folder.with_name(f"{folder.name}_inputs")
    inputs.mkdir(parents=True, exist_ok=True)
    if not (inputs / "mission.yaml").exists():
        write_atomic(inputs / "tree.xml", tour(vineyard_site(VineyardOptions(seed=seed, **WORLD))))
        write_atomic(inputs / "mission.yaml", mission_text(seed))
    watch = MemoryWatch(folder.with_name(f"{folder.name}_memory.csv"))

    def on_progress(moment: Progress) -> None:
        watch.see(moment.sim_time_s)
        show(moment)

    if (folder / "mission.yaml").exists():
        resume_mission(folder, cancelled=cancelled, on_progress=on_progress)
    else:
        run_mission(load_mission(str(inputs / "mission.yaml")), folder, cancelled=cancelled, on_progress=on_progress)


def mission_text(seed: int) -> str:
    """The mission file: JSON, which is YAML too."""
    mission = {
        "name": "soak", "tree": "tree.xml", "seed": seed, "dispensers": 0, "select": {"nails": 0, "vines": 1},
        "time_limit_s": 3600.0 * HOURS, "world": dict(WORLD),
    }  # fmt: skip
    return json.dumps(mission, indent=2) + "\n"


def tour(site: Site) -> str:
    """A tree that drives along all rows, up one and down the next, again and again, whatever becomes of a drive."""
    root = ElementTree.Element("root", BTCPP_format="4", main_tree_to_execute="Tour")
    tree = ElementTree.SubElement(root, "BehaviorTree", ID="Tour")
    whole = ElementTree.SubElement(tree, "Sequence")
    ElementTree.SubElement(whole, "WaitForLocalization", timeout_s="60")
    ElementTree.SubElement(whole, "TakePicture", label="start")  # the first picture loads the renderer
    again = ElementTree.SubElement(ElementTree.SubElement(whole, "KeepRunningUntilFailure"), "Sequence")
    for x, y, yaw in goals(site):
        one = ElementTree.SubElement(again, "ForceSuccess")
        goal = {"x": f"{x:.3f}", "y": f"{y:.3f}", "yaw": f"{yaw:.5f}", "timeout_s": f"{DRIVE_LIMIT_S:g}"}
        ElementTree.SubElement(one, "DriveToPose", goal)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def goals(site: Site) -> Array:
    """(rows, 3) x y yaw where the drive along each row ends: past its far end, as far beside it as work is done."""
    lateral, poses = route_options(DESCRIPTION).lateral, []
    for k, row in enumerate(site.rows):
        (x0, y0), (x1, y1) = (row.line[-1], row.line[0]) if k % 2 else (row.line[0], row.line[-1])
        yaw = float(np.arctan2(y1 - y0, x1 - x0))
        ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        poses.append([*(np.array([x1, y1]) + PAST_ROWS_M * ahead - lateral * left), yaw])
    return np.array(poses)


class MemoryWatch:
    """Notes what the process holds, now and then, in a file: session, simulated seconds, MB."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._session = 1 + max((int(row[0]) for row in memory_of(path)), default=0)
        self._next_s = 0.0

    def see(self, now: float) -> None:
        """Note it when it is due."""
        if now < self._next_s:
            return
        self._next_s = now + MEMORY_PERIOD_S
        with self._path.open("a", encoding="utf-8") as file:
            file.write(f"{self._session},{now:.2f},{resident_mb():.2f}\n")


def resident_mb() -> float:
    """What this process holds in memory, by the kernel."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def memory_of(path: Path) -> Array:
    """(n, 3) session, simulated seconds, MB."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return np.array([line.split(",") for line in text.splitlines()], float).reshape(-1, 3)


def memory_growth(memory: Array) -> float | None:
    """MB a simulated hour, by one slope through all sessions after their warm-up; None with less than 10 minutes."""
    x, y, length = [], [], 0.0
    for session in np.unique(memory[:, 0]):
        rows = memory[memory[:, 0] == session]
        rows = rows[rows[:, 1] >= rows[0, 1] + WARM_S]
        if len(rows) > 1:
            x.append(rows[:, 1] - rows[:, 1].mean())
            y.append(rows[:, 2] - rows[:, 2].mean())
            length += float(np.ptp(rows[:, 1]))
    if length < 600.0:
        return None
    times, values = np.concatenate(x), np.concatenate(y)
    return float(3600.0 * (times @ values) / (times @ times))


def stops(path: Array, plans: Sequence[tuple[float, bool]], causes: Sequence[tuple[float, str]]) -> list[Stop]:
    """Where the base stood within a drive though it should not.

    Args:
        path: (n, 4 or more) t, x, y, yaw by the estimate.
        plans: when a drive got a plan (true) and when it ended (false).
        causes: what may be why, each at a time.
    """
    still = _still(path)
    found = []
    for start, end in _spans(path[:, 0], still):
        if end - start < STOP_S or not _drives(plans, 0.5 * (start + end)):
            continue
        near = [text for t, text in causes if start - STOP_S <= t <= end + STOP_S]
        found.append(Stop(start_s=start, end_s=end, reason=near[0] if near else ""))
    return found


def _still(path: Array) -> Array:
    """(n,) whether the base hardly moves in the second after each sample."""
    later = np.minimum(np.searchsorted(path[:, 0], path[:, 0] + 1.0 - 1e-6), len(path) - 1)
    moved, yaw = path[later] - path, np.unwrap(path[:, 3])
    near: Array = (np.hypot(moved[:, 1], moved[:, 2]) < STILL_M) & (np.abs(yaw[later] - yaw) < STILL_RAD)
    return near


def _spans(times: Array, flags: Array) -> list[tuple[float, float]]:
    """First and last time of each run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(float(times[a]), float(times[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _drives(plans: Sequence[tuple[float, bool]], t: float) -> bool:
    return next((drives for at, drives in reversed(plans) if at <= t), False)


def measured(run: Path) -> list[Quantity]:
    """The figures of one drive, from the files of its folder."""
    result, path = _result(run), _path(run)
    error = np.hypot(path[:, 1] - path[:, 4], path[:, 2] - path[:, 5])
    n = len(error)
    events = list(read_events(run / "events.jsonl"))
    drives = Counter(e["status"] for e in events if e["kind"] == "action" and e["name"] == "DriveToPose")
    arrived, ended = drives["succeeded"], drives["succeeded"] + drives["aborted"] + drives["rejected"]
    lines = list(read_drive(run / "drive.jsonl"))
    plans = [(line["t"], bool(line["points"])) for line in lines if line["kind"] == "plan"]
    unfixed = np.array([line["t"] for line in lines if line["kind"] == "gnss" and line["status"] != "fix"])
    causes = [(float(t), "no integer fix") for t in unfixed]
    causes += [(e["t"], f"recovery: {e['how']}, {e['why']}") for e in events if e["kind"] == "recovery"]
    causes += [(e["t"], f"waiting: {e['why']}") for e in events if e["kind"] == "waiting"]
    causes += [(e["t"], f"guard: {e['verdict']}") for e in events if e["kind"] == "base_guard"]
    causes += [(at, "end of a drive") for at, goes_on in plans if not goes_on]
    stood = stops(path, plans, causes)
    memory = memory_of(run.with_name(f"{run.name}_memory.csv"))
    peak = float(memory[:, 2].max()) if len(memory) else None
    truth, seed = result["truth"], result["seed"]
    trusted = settled(path[:, 0], unfixed)
    whole, fixed = quarters(error, np.ones(n, bool)), quarters(error, trusted)
    (first, _), (last, _) = fixed
    growth = None if first is None or last is None else last - first
    rows: list[tuple[str, str, float | None, int, str]] = [
        ("driven for", "min", result["sim_time_s"] / 60.0, result["sessions"], f">= {60 * HOURS:g}"),
        ("driven", "m", result["navigation"]["distance_m"], 1, ""),
        ("simulated a second of the wall clock", "s", result["real_time_factor"], 1, ""),
        ("drives that arrived", "1", float(arrived), ended, f"= {ended}"),
        ("stops", "1", float(len(stood)), 1, ""),
        ("stops without a reason", "1", float(sum(not stop.reason for stop in stood)), len(stood), "= 0"),
        ("memory, most", "MB", peak, len(memory), ""),
        ("memory, growth a simulated hour", "MB", memory_growth(memory), len(memory), "<= 30"),
        ("position error, root mean square, first quarter", "m", *whole[0], ""),
        ("position error, root mean square, last quarter", "m", *whole[1], ""),
        (f"of the path, an integer fix for {SETTLE_S:g} s and more", "1", float(trusted.mean()), n, ""),
        ("position error there, root mean square, first quarter", "m", *fixed[0], ""),
        ("position error there, root mean square, last quarter", "m", *fixed[1], ""),
        ("position error there, growth from first to last quarter", "m", growth, int(trusted.sum()), "<= 0.01"),
        ("position error, largest", "m", float(error.max()), n, ""),
        ("collisions", "1", float(len(truth["collisions"])), 1, "= 0"),
        ("fences crossed", "1", float(truth["fence_crossings"]), 1, "= 0"),
    ]  # fmt: skip
    return [
        Quantity(name=f"seed {seed}: {name}", unit=unit, value=value, n=count, goal=goal)
        for name, unit, value, count, goal in rows
    ]


def settled(times: Array, unfixed: Array) -> Array:
    """(n,) whether the receiver has had its integer fix for `SETTLE_S` at each time; `unfixed` (m,) when it had not."""
    last = np.concatenate([[-np.inf], unfixed])[np.searchsorted(unfixed, times, side="right")]
    long: Array = times - last >= SETTLE_S
    return long


def quarters(error: Array, where: Array) -> tuple[tuple[float | None, int], tuple[float | None, int]]:
    """Root mean square of the errors (n,) and their number, in the first and in the last quarter, where `where` is."""
    quarter = max(len(error) // 4, 1)
    ends = error[:quarter][where[:quarter]], error[-quarter:][where[-quarter:]]
    first, last = ((float(np.sqrt((e**2).mean())) if len(e) else None, len(e)) for e in ends)
    return first, last


def _figures(run: Path) -> tuple[Figure, ...]:
    """Position error and memory over time."""
    path, memory = _path(run), memory_of(run.with_name(f"{run.name}_memory.csv"))
    error = np.hypot(path[:, 1] - path[:, 4], path[:, 2] - path[:, 5])
    minutes = [[60.0 * k, float(e.max())] for k, e in enumerate(_by_minute(path[:, 0], error)) if len(e)]
    held = [(f"session {s:g}", memory[memory[:, 0] == s][:, 1:].tolist(), PALETTE[int(s) % len(PALETTE)])
            for s in np.unique(memory[:, 0])]  # fmt: skip
    chart = line_chart([("", minutes, PALETTE[0])], x_title="s", y_title="largest position error of each minute, m")
    return (
        Figure(title=f"{run.name}: position error", svg=chart),
        Figure(title=f"{run.name}: memory", svg=line_chart(held, x_title="s", y_title="memory, MB")),
    )


def _by_minute(times: Array, values: Array) -> list[Array]:
    edges = np.searchsorted(times, 60.0 * np.arange(int(times[-1] / 60.0) + 2))
    return [values[a:b] for a, b in pairwise(edges)]


def _result(run: Path) -> dict[str, Any]:
    result: dict[str, Any] = json.loads((run / "result.json").read_text(encoding="utf-8"))
    return result


def _path(run: Path) -> Array:
    return np.loadtxt(run / "path.csv", delimiter=",", skiprows=1, ndmin=2)


def _show(progress: Callable[[float, str], None], k: int, seeds: int, moment: Progress) -> None:
    text = f"{moment.sim_time_s / 60.0:.1f} min simulated, {moment.real_time_factor:.2f} times real time"
    progress((k + moment.sim_time_s / (3600.0 * HOURS)) / seeds, text)


EXPERIMENT = Experiment(
    row="S1",
    summary="Two simulated hours of driving in two hectares: memory, position error, and why the robot stopped.",
    seeds=range(500, 501),
    run=run,
)
