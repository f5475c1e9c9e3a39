"""Row G8: deployment points of simulated vines against their true spurs, and how long a cloud takes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grape.experiments.spur_scores import Tally, tally
from grape.experiments.vine_scans import ScannedVine, scan_simulated_vine
from grape.perception.cloud import crop_box
from grape.perception.sweep import Sweep
from grape.proof import Experiment, Proof, Quantity, wilson95
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.find_deployment_points import (
    Box,
    FindDeploymentPointsGoal,
    Look,
    fuse,
    look,
    vine_box,
)
from grape.tasks.dispenser.perception.deployment_pose import DeploymentPose
from grape.tasks.dispenser.perception.spurs import extract_poses

STYLES = ("cordon", "gobelet")
SENSORS = ("camera and LiDAR", "camera alone", "LiDAR alone", "camera and worst LiDAR", "worst LiDAR alone")
CLOUD_POINTS = 100_000


@dataclass(frozen=True, kw_only=True)
class Goals:
    """What is asked of one style, by camera and LiDAR together."""

    first: str
    precision: str
    recall: str
    tip: str = "<= 10"
    direction: str = "<= 10"


GOALS = {
    "cordon": Goals(first=">= 0.98", precision=">= 0.92", recall=">= 0.90"),
    "gobelet": Goals(first=">= 0.95", precision=">= 0.85", recall=">= 0.75"),
}
REFERENCE = "perception study: {}"
STUDY = {  # first right, precision, recall, tip and direction at the 90th percentile
    ("cordon", "camera and LiDAR"): ("1.00", "0.94", "0.90", "6.3", "5.0"),
    ("gobelet", "camera and LiDAR"): ("0.95", "0.88", "0.75", "7.2", "7.2"),
    ("cordon", "LiDAR alone"): ("1.00", "0.94", "0.91", "10.5", "4.6"),
    ("gobelet", "LiDAR alone"): ("1.00", "0.83", "0.69", "14.5", "11.6"),
}


def run(seeds: Sequence[int], folder: Path, progress: Callable[[float, str], None]) -> Proof:
    """Scans one vine of each style for every seed; vines that the folder has are not scanned again."""
    folder.mkdir(parents=True, exist_ok=True)
    totals = {(style, sensors): Tally() for style in STYLES for sensors in SENSORS}
    rounds = [(seed, style) for seed in seeds for style in STYLES]
    milliseconds: list[float] = []
    for k, (seed, style) in enumerate(rounds):
        progress(k / len(rounds), f"{style} vine of seed {seed}")
        found = _vine(folder / f"{style}_{seed}.json", seed, style)
        milliseconds.append(found.pop("cloud_ms"))
        for sensors, counts in found.items():
            totals[style, sensors] += Tally(**{name: _tupled(value) for name, value in counts.items()})
    quantities = [q for (style, sensors), total in totals.items() for q in _quantities(style, sensors, total)]
    return Proof(quantities=(*quantities, _speed(milliseconds)), notes=NOTES)


NOTES = (
    "One vine a seed and style: the robot stands at its first stop, its wrist goes the way of ScanVine, camera and "
    "LiDAR are the simulator's, with its noise; the believed poses of the sensors wander by 2.5 mm and 0.15 degrees.",
    "First right: of the vines, those whose best pose is a true spur, at most 60 degrees from vertical, tip within "
    "40 mm and direction within 20 degrees; a vine without a pose counts as wrong.",
    "Precision: of all listed poses, those with a true spur within 45 mm across the view, at most 60 degrees from "
    "vertical, direction within 25 degrees.",
    "Recall: of the usable spurs, those found with the direction within 30 degrees. Usable: on the scanned vine, at "
    "most 50 degrees from vertical, tip 0.42 to 1.20 m above the ground and within 0.55 m of the sweep's middle, at "
    "least half of it in free sight from somewhere along the sweep.",
    "The LiDAR's plane sweeps 0.68 m of the row; spurs beside that count as missed when it is alone.",
    "Worst LiDAR: noise 20 mm and a systematic error of 60 mm of either sign, as the data sheet allows.",
)


def _tupled(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _vine(file: Path, seed: int, style: str) -> dict[str, Any]:
    """Counts by sensors, and how long a cloud took, from the file or measured and written there."""
    if not file.exists():
        vine = scan_simulated_vine(seed, style)
        box = vine_box(FindDeploymentPointsGoal(plant="", scan=vine.scan), vine.foot, DESCRIPTION.base.height)
        looks = [look(vine.scan, k, box) for k in range(len(vine.scan.images))]
        lists = _lists(vine, looks, box)
        found: dict[str, Any] = {name: asdict(tally(poses, vine.spurs)) for name, poses in lists.items()}
        found["cloud_ms"] = _cloud_ms(looks, box)
        file.write_text(json.dumps(found), encoding="utf-8")
    return dict(json.loads(file.read_text(encoding="utf-8")))


def _lists(vine: ScannedVine, looks: list[Look], box: Box) -> dict[str, tuple[DeploymentPose, ...]]:
    """Deployment poses by the sensors that are there."""
    good, nothing = vine.scan.sweep, vine.scan.sweep.with_ranges(vine.scan.sweep.ranges, np.zeros(0, int))
    sources: tuple[tuple[list[Look], Sweep], ...] = (
        (looks, good),
        (looks, nothing),
        ([], good),
        (looks, vine.worst),
        ([], vine.worst),
    )
    return dict(zip(SENSORS, (fuse(frames, sweep, box)[0] for frames, sweep in sources), strict=True))


def _cloud_ms(looks: list[Look], box: Box) -> float:
    """Processor time in ms from one merged cloud of CLOUD_POINTS points to poses, the best of three tries."""
    points = np.vstack([crop_box(look.points, *box) for look in looks])
    shuffled = np.random.default_rng(0).permutation(max(len(points), CLOUD_POINTS))
    points = points[shuffled[:CLOUD_POINTS] % len(points)]  # of fewer points some come twice
    origins = np.array([look.view.T_base_camera[:3, 3] for look in looks])
    tries = []
    for _ in range(3):
        start = time.process_time()
        extract_poses(points, origins)
        tries.append(1e3 * (time.process_time() - start))
    return min(tries)


def _quantities(style: str, sensors: str, t: Tally) -> list[Quantity]:
    goals = GOALS[style] if sensors == SENSORS[0] else Goals(first="", precision="", recall="", tip="", direction="")
    study = [REFERENCE.format(value) for value in STUDY.get((style, sensors), ())] or [""] * 5
    rates = (
        ("first pose right", t.first, t.vines, goals.first),
        ("precision of the list", t.right, t.poses, goals.precision),
        ("recall of usable spurs", t.found, t.usable, goals.recall),
    )
    errors = (
        ("tip error, 90th percentile", "mm", 1e3 * np.array(t.tip_m), goals.tip),
        ("direction error, 90th percentile", "deg", np.array(t.angle_deg), goals.direction),
    )
    found = [
        Quantity(
            name=f"{style}, {sensors}: {name}",
            unit="1",
            value=yes / n if n else None,
            n=n,
            ci95=wilson95(yes, n),
            reference=reference,
            goal=goal,
        )
        for (name, yes, n, goal), reference in zip(rates, study, strict=False)
    ]
    return found + [
        Quantity(
            name=f"{style}, {sensors}: {name}",
            unit=unit,
            value=float(np.percentile(values, 90)) if len(values) else None,
            n=len(values),
            reference=reference,
            goal=goal,
        )
        for (name, unit, values, goal), reference in zip(errors, study[3:], strict=True)
    ]


def _speed(milliseconds: Sequence[float]) -> Quantity:
    return Quantity(
        name="cloud of 100 000 points to poses, median",
        unit="ms",
        value=float(np.median(milliseconds)) if milliseconds else None,
        n=len(milliseconds),
        goal="<= 150",
    )


EXPERIMENT = Experiment(
    row="G8",
    summary="Deployment points of simulated vines of both styles, compared with their true spurs.",
    seeds=range(500, 600),
    run=run,
)
