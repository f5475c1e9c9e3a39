"""Row G7: the scan of a vine, from unwinding to retracting, by the real actions, judged by the simulator's truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from grape.experiments.quantities import count_of
from grape.experiments.scan_trials import ARMS, CALIBRATED, PERFECT, STYLES, broken_scan, scan_trial
from grape.experiments.servo_trials import Key, Progress, Trial, quantile, rate, run_trials
from grape.mission.svg import PALETTE, Frame, axes, drawing, tag
from grape.proof import Experiment, Figure, Proof, Quantity

REFERENCE_ARM = "arm 0 to 50 mm off"


def run(seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """Scans of one vine of each style for every seed, and one on which a joint breaks; what the folder has is kept."""
    cases = [f"{style}, {arm}" for style in STYLES for arm in ("perfect", "flawed")] + ["broken"]
    keys = [Key(case=case, seed=seed) for seed in seeds for case in cases]
    trials = run_trials(folder, keys, _trial, progress)
    scans = [scan for trial in trials.values() for scan in trial.get("scans", ())]
    ways = [scan for scan in scans if scan["converged"] and not scan["hindered"]]
    broken = [trial for key, trial in trials.items() if key.case == "broken"]
    return Proof(
        quantities=(*_motion_quantities(scans), *_way_quantities(ways), *_broken_quantities(broken)),
        figures=_figures(ways),
        notes=(*NOTES, *_failures(trials)),
    )


def _trial(key: Key) -> Trial:
    return broken_scan(key.seed) if key.case == "broken" else scan_trial(key)


NOTES = (
    "One scan is Unwind, ScanVine, Unwind and Retract; the first of each run begins with the last joint wound by 55 to "
    "90 % of its cable's budget. The sweep goes forth and back, and has a scan of the LiDAR every 66 ms.",
    "The arm as it comes and calibrated errs as the real one (arm_errors = 1); the perfect one has none of its flaws. "
    "The LiDAR has noise and a systematic error (20 mm, one sigma) with each of them.",
    "Planes: from one to the next along the row, by the truth. A cloud is told by the stamped poses of the encoders; "
    "off the surface: its points in the row, over 0.3 m of the ground, from the nearest true surface.",
    "Hindered: wood was ahead of the hand, which passed over it or turned back; planes, straightness and cloud are "
    "those of the other scans.",
    "Range error taken off: as FindDeploymentPoints does it, by the depth frames of the same scan.",
    "In sight: from the LiDAR abreast, within ranges and bearings that a scan keeps. Nearby: a point of the cloud with "
    "the range error taken off is within 20 mm.",
    "Broken: from a drawn moment of the sweep on a joint, drawn, stands still, or on odd seeds runs backwards; how far "
    "off is by the truth.",
)


def _failures(trials: Mapping[Key, Trial]) -> list[str]:
    """Each calibration and each scan that failed; after a calibration that failed the arm is as it comes."""
    calibrations = [
        f"Seed {key.seed}: not calibrated, {trial['uncalibrated']}"
        for key, trial in trials.items()
        if trial.get("uncalibrated")
    ]
    scans = [
        f"Seed {key.seed}, {scan['style']}, {scan['arm']}: {scan['reason']}, {scan['detail']}"
        for key, trial in trials.items()
        for scan in trial.get("scans", ())
        if scan["reason"]
    ]
    return calibrations + scans


def _motion_quantities(scans: Sequence[Trial]) -> list[Quantity]:
    done = [scan for scan in scans if scan["converged"]]
    needed = [scan for scan in scans if scan["begin_share"] > 0.5]
    return [
        rate("scans that came to their end", scans),
        rate("scans hindered by wood", [scan | {"converged": scan["hindered"] > 0} for scan in scans]),
        _largest("linear part, largest", "s", [scan["linear_s"] for scan in done], "<= 15"),
        quantile("whole action, median", "s", scans, "action_s", 0.5, reference="about 30 s"),
        quantile("whole action, largest", "s", scans, "action_s", 1.0, reference="about 30 s"),
        _largest("cable, of its budget, largest", "1", [scan["cable_share"] for scan in scans], "<= 1"),
        rate(
            "cable beyond half of its budget: unwound before the scan",
            [scan | {"converged": scan["unwound"]} for scan in needed],
            goal=">= 1",
        ),
        _largest("cable when the arm is back, of its budget, largest", "1", [scan["end_share"] for scan in done]),
        count_of("collisions of the robot", [len(scan["touched"]) for scan in scans]),
    ]


def _way_quantities(ways: Sequence[Trial]) -> list[Quantity]:
    """How evenly and how straight the LiDAR went, and what came of it."""
    gaps = np.array([gap for scan in ways for gap in scan["gaps_mm"]])
    spread = [("median", 50), ("5th percentile", 5), ("95th percentile", 95), ("largest", 100)]
    found = [
        Quantity(name=f"from one plane to the next, {name}", unit="mm", n=len(gaps),
                 value=float(np.percentile(gaps, q)) if len(gaps) else None)
        for name, q in spread
    ]  # fmt: skip
    found += [
        quantile("off the line as told, 95th percentile", "mm", ways, "told_off_mm", 0.95),
        quantile("off the orientation as told, 95th percentile", "deg", ways, "told_deg", 0.95),
    ]
    for arm in ARMS:
        own = [scan for scan in ways if scan["arm"] == arm]
        found += [
            quantile(f"{arm}: straightness by the truth, 95th percentile", "mm", own, "true_bend_mm", 0.95),
            quantile(f"{arm}: orientation held by the truth, 95th percentile", "deg", own, "true_deg", 0.95),
        ]
        for style in STYLES:
            found += _cloud_quantities([scan for scan in own if scan["style"] == style], f"{style}, {arm}")
    return found


def _cloud_quantities(own: Sequence[Trial], which: str) -> list[Quantity]:
    reference = "" if PERFECT in which else REFERENCE_ARM
    found = []
    for cloud, key in (("as assembled", "assembled"), ("range error taken off", "off")):
        found += [
            quantile(f"{which}, {cloud}: point off the surface, median of a scan", "mm", own, f"{key}_median_mm", 0.5,
                     reference=reference),
            quantile(f"{which}, {cloud}: point off the surface, 95th percentile of a scan", "mm", own,
                     f"{key}_p95_mm", 0.5, reference=reference),
        ]  # fmt: skip
    return [
        *found,
        quantile(f"{which}: surface in sight with a point nearby", "1", own, "had_of_seen", 0.5),
        quantile(f"{which}: swept surface, its back too, with a point nearby", "1", own, "had_of_swept", 0.5),
    ]


def _broken_quantities(broken: Sequence[Trial]) -> list[Quantity]:
    grown = [trial | {"converged": trial["reason"] == "distance_grows"} for trial in broken]
    ways = [trial for trial in broken if not trial["hindered"]]
    return [
        rate("a broken joint: the scan ended with a reason", broken),
        rate("a broken joint: because the distance grew", grown, reference="the only reason"),
        quantile("a broken joint: distance grown, largest", "mm", ways, "grown_mm", 1.0),
        quantile("a broken joint: off the way by the truth, median", "mm", ways, "off_mm", 0.5),
        quantile("a broken joint: off the way by the truth, largest", "mm", ways, "off_mm", 1.0),
        count_of("a broken joint: collisions of the robot", [len(trial["touched"]) for trial in broken]),
    ]


def _largest(name: str, unit: str, values: Sequence[float], goal: str = "") -> Quantity:
    return Quantity(name=name, unit=unit, value=max(values, default=None), n=len(values), goal=goal)


def _figures(ways: Sequence[Trial]) -> tuple[Figure, ...]:
    """The first cloud of each style by a calibrated arm."""
    found = []
    for style in STYLES:
        sides = [s["side"] for s in ways if (s["arm"], s["style"]) == (CALIBRATED, style)]
        if sides:
            found.append(
                Figure(title=f"A {style} vine from the side: points, and the true wood", svg=side_view(sides[0]))
            )
    return tuple(found)


def side_view(side: Trial) -> str:
    """Points over rods, from the aisle."""
    frame = Frame(left=52, top=24, width=600, height=600, x=(-0.5, 0.5), y=(0.2, 1.2))
    parts = axes(frame, "along the row from the plant, m", "over its foot, m")
    for (x0, z0), (x1, z1), radius in side["rods"]:
        ends = frame.points([(x0, z0), (x1, z1)])
        width = max(2.0 * radius * frame.width / (frame.x[1] - frame.x[0]), 1.0)
        parts.append(tag("polyline", points=ends, stroke="#c9bfae", stroke_width=width, stroke_linecap="round"))
    for x, z in side["points"]:
        cx, cy = frame.at(x, z)
        parts.append(tag("circle", cx=cx, cy=cy, r=1.2, fill=PALETTE[0]))
    return drawing(670, 665, parts, "chart")


EXPERIMENT = Experiment(
    row="G7",
    summary="Scans vines of both styles from unwinding to retracting, and holds motion and cloud against the truth.",
    seeds=range(500, 506),
    run=run,
)
