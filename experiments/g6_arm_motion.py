"""Row G6: the four ways in which the arm moves, with an arm as flawed as the real one, judged by the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grape.experiments.arm_moves import AS_IT_COMES, CALIBRATED, WRONG, astray, flat, moves, unwound
from grape.experiments.g10_servoing import servo_trial
from grape.experiments.quantities import count_of, median_of
from grape.experiments.servo_trials import SHOWN, Key, Progress, Trial, quantile, rate, run_trials
from grape.mission.svg import PALETTE, line_chart
from grape.proof import Experiment, Figure, Proof, Quantity

Case = Callable[[int], Trial]
CASES: dict[str, Case] = {
    "moves": moves,
    "unwound": unwound,
    "astray": astray,
    "servo": lambda seed: servo_trial(Key(case="plain", seed=seed)),
}
ARMS = (AS_IT_COMES, CALIBRATED)
REFERENCE_MM = "0 to 50 mm, as it comes"


def run(seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """All motions of every seed; what the folder has is not moved again."""
    keys = [Key(case=case, seed=seed) for seed in seeds for case in CASES]
    trials = run_trials(folder, keys, lambda key: CASES[key.case](key.seed), progress)
    by_case = {case: [trial for key, trial in trials.items() if key.case == case] for case in CASES}
    planned, lines = flat(by_case["moves"], "planned"), flat(by_case["moves"], "lines")
    return Proof(
        quantities=(
            *_planned_quantities(planned),
            *_unwinding_quantities(flat(by_case["unwound"], "unwound")),
            *_line_quantities(lines),
            _largest(
                "planned motions and lines: cable, of its budget",
                [m["cable_share"] for m in (*planned, *lines)],
                "<= 1",
            ),
            *_astray_quantities(flat(by_case["astray"], "astray")),
            *_servo_quantities(by_case["servo"]),
        ),
        figures=(*_hand_figures(planned), *_line_figures(lines)),
        notes=(*NOTES, *_failures(by_case)),
    )


NOTES = (
    "The arm errs as the real one (arm_errors = 1); the same motions as it comes and after CalibrateArm. Hand errors "
    "are by the simulator's truth; what is told is by the encoders, less what they are known to be off. So are "
    "speeds: joints run up to 4 % faster than they are sent, which the arm's limits have no say in.",
    "Planned: to the named poses, above the feeder, before a nail, to the begin of a scan, and to drawn poses of the "
    "hand that a posture free of collisions reaches.",
    "Unwinding: from drawn states with a cable beyond half of its budget; what is left contains the encoders' bias.",
    "Lines: drawn, 0.2 to 0.5 m at constant orientation, such as the arm can follow. Straightness by the truth is the "
    "distance from the straight line that fits best.",
    "Lines that come to nothing: one leads 1.3 m away, out of the arm's reach, which actions of the task never try; on "
    "others a joint, drawn, stands still or runs backwards from a drawn moment on. How far off: by the truth, from the "
    "line through its true begin.",
    "Servoing: as row G10 does it, one run a seed.",
)


def _planned_quantities(planned: Sequence[Trial]) -> list[Quantity]:
    found = []
    for arm in ARMS:
        own = [motion for motion in planned if motion["arm"] == arm]
        found += [
            rate(f"planned, {arm}: reached", own),
            quantile(f"planned, {arm}: hand off its goal, median", "mm", own, "hand_mm", 0.5, reference=REFERENCE_MM),
            quantile(f"planned, {arm}: hand off its goal, 95th percentile", "mm", own, "hand_mm", 0.95,
                     reference=REFERENCE_MM),
            quantile(f"planned, {arm}: hand off its goal, largest", "mm", own, "hand_mm", 1.0, reference=REFERENCE_MM),
            quantile(f"planned, {arm}: hand turned off its goal, median", "deg", own, "hand_deg", 0.5),
        ]  # fmt: skip
    return [
        *found,
        count_of("planned: collisions of the robot", [len(motion["touched"]) for motion in planned]),
        median_of("planned: duration", "s", [m["duration_s"] for m in planned if m["converged"]]),
        _largest("planned: joint speed, of its limit", [motion["speed_share"] for motion in planned], goal="<= 1"),
    ]


def _unwinding_quantities(unwound: Sequence[Trial]) -> list[Quantity]:
    return [
        rate("unwinding: done", unwound),
        _largest("unwinding: cable at the begin, of its budget", [motion["begin_share"] for motion in unwound]),
        _largest("unwinding: turns left over", [motion["turns_left"] for motion in unwound]),
        _largest("unwinding: joint speed, of its limit", [motion["speed_share"] for motion in unwound], goal="<= 1"),
        count_of("unwinding: collisions of the robot", [len(motion["touched"]) for motion in unwound]),
        median_of("unwinding: duration", "s", [m["duration_s"] for m in unwound if m["converged"]]),
    ]


def _line_quantities(lines: Sequence[Trial]) -> list[Quantity]:
    found = [
        rate("lines: followed to the end", lines),
        quantile("lines: off the line as told, 95th percentile", "mm", lines, "told_off_mm", 0.95),
        quantile("lines: off the orientation as told, 95th percentile", "deg", lines, "told_deg", 0.95),
        quantile("lines: stops off its goal as told, 95th percentile", "mm", lines, "told_end_mm", 0.95,
                 reference="stops within 20 to 30 mm"),
    ]  # fmt: skip
    for arm in ARMS:
        own = [motion for motion in lines if motion["arm"] == arm]
        found += [
            quantile(f"lines, {arm}: straightness by the truth, 95th percentile", "mm", own, "true_bend_mm", 0.95),
            quantile(f"lines, {arm}: orientation held by the truth, 95th percentile", "deg", own, "true_deg", 0.95),
            quantile(f"lines, {arm}: stops off its goal by the truth, median", "mm", own, "true_end_mm", 0.5),
        ]
    return [*found, count_of("lines: collisions of the robot", [len(motion["touched"]) for motion in lines])]


def _astray_quantities(strays: Sequence[Trial]) -> list[Quantity]:
    begun = [motion for motion in strays if motion["followed"]]
    ended = [motion for motion in begun if not motion["converged"]]
    found = []
    for why in WRONG:
        own = [motion for motion in begun if motion["why"] == why]
        found.append(rate(f"lines, {why}: ended with a reason", [m | {"converged": not m["converged"]} for m in own]))
    grown = [motion | {"converged": motion["reason"] == "distance_grows"} for motion in ended]
    all_ended = [motion | {"converged": True} for motion in ended]
    return [
        *found,
        rate("ended lines: because the distance grew", grown, reference="the only reason"),
        quantile("ended lines: distance grown, largest", "mm", all_ended, "grown_mm", 1.0),
        quantile("ended lines: off the line, median", "mm", all_ended, "off_mm", 0.5),
        quantile("ended lines: off the line, largest", "mm", all_ended, "off_mm", 1.0),
        _largest("ended lines: cable, of its budget", [motion["cable_share"] for motion in ended]),
        count_of("ended lines: collisions of the robot", [len(motion["touched"]) for motion in ended]),
    ]


def _servo_quantities(servo: Sequence[Trial]) -> list[Quantity]:
    return [
        rate("servoing: converged", servo),
        quantile("servoing: hand off its goal, median", "mm", servo, "hand_mm", 0.5, reference="1 mm needed"),
        quantile("servoing: hand off its goal, largest", "mm", servo, "hand_mm", 1.0, reference="1 mm needed"),
    ]


def _largest(name: str, values: Sequence[float], goal: str = "") -> Quantity:
    return Quantity(name=f"{name}, largest", unit="1", value=max(values, default=None), n=len(values), goal=goal)


def _failures(by_case: dict[str, list[Trial]]) -> list[str]:
    """Each calibration that failed, and each motion that should have come to its end and did not."""
    kinds = (("moves", "planned"), ("moves", "lines"), ("unwound", "unwound"))
    calibrations = [
        f"Seed {trial['seed']}: not calibrated, {trial['uncalibrated']}"
        for trial in by_case["moves"]
        if trial["uncalibrated"]
    ]
    return calibrations + [
        f"Seed {trial['seed']}, {kind}: {motion['reason']}, {motion['detail']}"
        for case, kind in kinds
        for trial in by_case[case]
        for motion in trial[kind]
        if not motion["converged"]
    ]


def _hand_figures(planned: Sequence[Trial]) -> tuple[Figure, ...]:
    """Share of the motions whose hand ended within a distance."""
    series: list[tuple[str, Sequence[Sequence[float]], str]] = []
    for arm, colour in zip(ARMS, PALETTE, strict=False):
        errors = np.sort([m["hand_mm"] for m in planned if m["arm"] == arm and m["converged"]])
        series.append((arm, [(float(e), (k + 1) / len(errors)) for k, e in enumerate(errors)], colour))
    chart = line_chart(series, x_title="hand off its goal, mm", y_title="share of the motions", height=260)
    return (Figure(title="Planned motions: where the hand ends, by the truth", svg=chart),)


def _line_figures(lines: Sequence[dict[str, Any]]) -> tuple[Figure, ...]:
    shown = [motion for motion in lines if motion["followed"] and motion["arm"] == CALIBRATED][:SHOWN]
    series = [("", motion["track_mm"], PALETTE[k % len(PALETTE)]) for k, motion in enumerate(shown)]
    chart = line_chart(series, x_title="along the line, mm", y_title="off the line through its begin, mm", height=260)
    return (Figure(title="Straight lines by a calibrated arm, by the truth", svg=chart),)


EXPERIMENT = Experiment(
    row="G6",
    summary="Moves the arm in its four ways, with the real arm's flaws, and looks where the hand really gets to.",
    seeds=range(500, 510),
    run=run,
)
