"""Row G7: the scan of a vine, from unwinding to retracting, by the real actions, judged by the simulator's truth."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from grape.actions.core import Context, Feedback
from grape.actions.retract import RetractGoal, retract
from grape.actions.robot import build_robot
from grape.actions.unwind import UnwindGoal, unwind
from grape.experiments.arm_bench import Parking
from grape.experiments.arm_track import Beat, Motion, TrackedBench, bend_m, cable_share, off_line_m, turned_rad
from grape.experiments.quantities import count_of
from grape.experiments.servo_trials import Key, Progress, Trial, quantile, rate, run_trials
from grape.experiments.vine_surface import along_row, of_vine, score_cloud, wood_of
from grape.geometry import transform
from grape.messages import Array
from grape.mission.svg import PALETTE, Frame, axes, drawing, tag
from grape.proof import Experiment, Figure, Proof, Quantity
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.worlds import VineyardOptions
from grape.tasks.dispenser.actions.calibrate_arm import CalibrateArmGoal, calibrate_arm
from grape.tasks.dispenser.actions.scan_vine import (
    WRIST_LIDAR,
    ScanVineGoal,
    ScanVineResult,
    SweepPath,
    scan_vine,
    sweep_path,
)
from grape.tasks.dispenser.row import row_distance
from grape.tasks.dispenser.stops import first_stop

STYLES = ("cordon", "gobelet")
PERFECT, AS_IT_COMES, CALIBRATED = ARMS = ("perfect arm", "as it comes", "calibrated")
VINES = 3  # in the row
WOUND = (0.55, 0.9)  # of its budget the last joint's cable is wound before the first scan
UNWOUND_SHARE = 0.05  # of its budget: less than that is what the encoders are off
SCANNING = "scanning"
SHOWN_POINTS = 1200
REFERENCE_ARM = "arm 0 to 50 mm off"


def run(seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """Scans of one vine of each style for every seed, and one on which a joint jams."""
    cases = [f"{style}, {arm}" for style in STYLES for arm in ("perfect", "flawed")] + ["broken"]
    keys = [Key(case=case, seed=seed) for seed in seeds for case in cases]
    trials = run_trials(folder, keys, lambda key: _broken(key.seed) if key.case == "broken" else _scans(key), progress)
    scans = [scan for trial in trials.values() for scan in trial.get("scans", ())]
    broken = [trial for key, trial in trials.items() if key.case == "broken"]
    return Proof(
        quantities=(*_motion_quantities(scans), *_cloud_quantities(scans), *_broken_quantities(broken)),
        figures=_figures(scans),
        notes=(*NOTES, *(f"{s['arm']}, {s['style']}: {s['reason']}, {s['detail']}" for s in scans if s["reason"])),
    )


NOTES = (
    "One scan is Unwind, ScanVine, Unwind and Retract; the first of each run begins with the last joint wound by 55 to "
    "90 % of its cable's budget. The sweep goes forth and back, and has a scan of the LiDAR every 66 ms.",
    "The arm as it comes and calibrated errs as the real one (arm_errors = 1); of the perfect one only LiDAR, base and "
    "servos are not. The LiDAR has noise and a systematic error (20 mm, one sigma) in all of them.",
    "Planes: from one to the next along the row, by the truth. A cloud is told by the stamped poses of the encoders; "
    "off the surface: its points in the row, over 0.3 m of the ground, from the nearest true surface.",
    "In sight: from the LiDAR abreast, within ranges and bearings that a scan keeps. Nearby: within 20 mm.",
    "Broken: from a drawn moment of the sweep on a joint, drawn, stands still, or on odd seeds runs backwards; how far "
    "off is by the truth.",
)


def _options(seed: int, style: str) -> VineyardOptions:
    return VineyardOptions(seed=seed, style=style, rows=1, vines_per_row=VINES)  # type: ignore[arg-type]


class ScanBench(TrackedBench):
    """A `TrackedBench` that keeps the times of the LiDAR's planes while its hand sweeps."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.planes_s: list[float] = []  # when the beam in the middle of each scan was
        super().__init__(*args, **kwargs)

    def _sense(self) -> None:
        super()._sense()
        if self.has_done(SCANNING, 0.0):
            scan = self.ctx.drivers.scans[WRIST_LIDAR].latest()
            middle = scan.stamp + 0.5 * scan.scan_time
            if not self.planes_s or middle > self.planes_s[-1]:
                self.planes_s.append(middle)


def _bench(seed: int, style: str, errors: float, wound_share: float = 0.0) -> ScanBench:
    """Parked where a mission stops first, its last joint wound by a share of its budget."""
    arm, plant = DESCRIPTION.arm, f"r0v{seed % VINES}"
    poses = {**arm.poses, "wound": arm.poses["travel"] + np.r_[np.zeros(5), wound_share * arm.cable_turns]}
    stop = first_stop(build_robot(DESCRIPTION), "vine")
    parking = Parking(plant=plant, ahead_m=stop.ahead_m, beside_m=stop.beside_m)
    description = replace(DESCRIPTION, arm=replace(arm, poses=poses))
    return ScanBench(description, parking, _options(seed, style), arm_errors=errors, arm_pose="wound")


def _scans(key: Key) -> Trial:
    """A scan by a perfect arm; or by a flawed one as it comes, and again when it has calibrated itself."""
    style, which = key.case.split(", ")
    rng = np.random.default_rng([key.seed, 7, STYLES.index(style)])
    wound = float(rng.choice([-1.0, 1.0]) * rng.uniform(*WOUND))
    plant, found = f"r0v{key.seed % VINES}", []
    with _bench(key.seed, style, float(which == "flawed"), wound) as bench:
        for arm in (PERFECT,) if which == "perfect" else (AS_IT_COMES, CALIBRATED):
            if arm == CALIBRATED:
                bench.observe(calibrate_arm(CalibrateArmGoal(), bench.ctx))
            begin = cable_share(DESCRIPTION.arm, bench.ctx.world.joints())
            motion = bench.observe(scan_action(ScanVineGoal(plant=plant), bench.ctx))
            found.append({"arm": arm, "style": style, "begin_share": begin, **_judged(bench, plant, motion)})
    return {"scans": found}


def scan_action(goal: ScanVineGoal, ctx: Context) -> Generator[Feedback, None, ScanVineResult]:
    """The whole of a scan."""
    yield from unwind(UnwindGoal(), ctx)
    result = yield from scan_vine(goal, ctx)
    yield from unwind(UnwindGoal(), ctx)
    yield from retract(RetractGoal(), ctx)
    return result


def _judged(bench: ScanBench, plant: str, motion: Motion) -> Trial:
    arm, beats = DESCRIPTION.arm, motion.during(SCANNING)
    told: Trial = {
        "converged": not motion.reason,
        "reason": motion.reason,
        "detail": motion.detail,
        "action_s": motion.duration_s,
        "cable_share": max(cable_share(arm, beat.q) for beat in motion.beats),
        "unwound": is_unwound(motion),
        "touched": motion.touched,
    }
    if motion.result is None:
        return told
    path = way_of(bench, plant, beats)
    passes = [leg_beats(beats, path, leg) for leg in (0, 2)]
    lidars = [_lidars(bench, own) for own in passes]
    told |= {
        "linear_s": beats[-1].time_s - beats[0].time_s,
        "end_share": cable_share(arm, bench.ctx.world.joints()),
        "gaps_mm": [
            gap
            for own, T in zip(passes, lidars, strict=True)
            for gap in plane_gaps_mm(
                bench.planes_s, [b.time_s for b in own], along_row(bench.truth, plant, T[:, :3, 3])
            )
        ],
        **_straightness(passes, path),
    }
    return told | _cloud(bench, plant, motion.result, lidars)


def is_unwound(motion: Motion) -> bool:
    """Whether the cables were turned back before the sweep."""
    before = takewhile(lambda beat: beat.status != SCANNING, motion.beats)
    turning = [cable_share(DESCRIPTION.arm, beat.q) for beat in before if beat.status == "unwinding"]
    return min(turning, default=1.0) < UNWOUND_SHARE


def way_of(bench: ScanBench, plant: str, beats: Sequence[Beat]) -> SweepPath:
    """The way that the hand was sent, from the end that it began with."""
    goal, T_base_arm = ScanVineGoal(plant=plant), DESCRIPTION.arm.T_base_link_arm_base
    path = sweep_path(goal, T_base_arm, row_distance(bench.ctx, plant))
    first, last = (float(np.linalg.norm(beats[0].T_told[:3, 3] - path.poses[k][:3, 3])) for k in (0, -1))
    return path if first <= last else path.backwards()


def leg_beats(beats: Sequence[Beat], path: SweepPath, leg: int) -> list[Beat]:
    """The beats on one straight part of the way."""
    begin, end = path.times[leg] / path.times[-1], path.times[leg + 1] / path.times[-1]
    return [beat for beat in beats if begin <= beat.progress <= end]


def plane_gaps_mm(times: Sequence[float], beat_times: Sequence[float], along: Array) -> list[float]:
    """Distances from one plane of the LiDAR to the next, mm.

    Args:
        times: s, of the planes; those that are not within the pass are left out.
        beat_times: s, along a pass, and `along` (n,) m, where along the row the LiDAR was then.
    """
    inside = [t for t in times if beat_times[0] <= t <= beat_times[-1]]
    return [float(gap) for gap in 1e3 * np.abs(np.diff(np.interp(inside, beat_times, along)))]


def _lidars(bench: ScanBench, beats: Sequence[Beat]) -> Array:
    """(k, 4, 4) true poses of the LiDAR in map."""
    T_map_base, T_hand_lidar = bench.simulation.referee.true_pose(), DESCRIPTION.mounts[WRIST_LIDAR].T_parent_sensor
    return np.array([T_map_base @ beat.T_true @ T_hand_lidar for beat in beats])


def _straightness(passes: Sequence[Sequence[Beat]], path: SweepPath) -> Trial:
    """The worst of both passes."""
    found: dict[str, list[float]] = {"told_off_mm": [], "told_deg": [], "true_bend_mm": [], "true_deg": []}
    for beats, leg in zip(passes, (0, 2), strict=True):
        T_a, T_b = path.poses[leg], path.poses[leg + 1]
        told, true = (np.array([T for T in hands]) for hands in ([b.T_told for b in beats], [b.T_true for b in beats]))
        found["told_off_mm"].append(1e3 * float(off_line_m(told[:, :3, 3], T_a[:3, 3], T_b[:3, 3]).max()))
        found["told_deg"].append(float(np.degrees(turned_rad(told[:, :3, :3], T_a[:3, :3]))))
        found["true_bend_mm"].append(1e3 * bend_m(true[:, :3, 3]))
        found["true_deg"].append(float(np.degrees(turned_rad(true[:, :3, :3], true[0, :3, :3]))))
    return {name: max(values) for name, values in found.items()}


def _cloud(bench: ScanBench, plant: str, result: ScanVineResult, lidars: Sequence[Array]) -> Trial:
    """How good the cloud is, and its picture from the side."""
    points = transform(bench.simulation.referee.true_pose(), result.scan.sweep.points)
    score = score_cloud(bench.truth, plant, points, [T[::5] for T in lidars])
    return {
        "points": len(points),
        "off_median_mm": float(np.median(score.off_mm)),
        "off_p95_mm": float(np.percentile(score.off_mm, 95)),
        "had_of_seen": score.had / score.seen,
        "had_of_swept": score.had / score.swept,
        "side": _side(bench, plant, points),
    }


def _side(bench: ScanBench, plant: str, points: Array) -> Trial:
    """What the picture from the side shows: points and rods, along the row and over the plant's foot, m."""
    world = bench.truth
    vine = points[of_vine(world, plant, points, -0.5, 0.5)]
    some = vine[:: max(1, len(vine) // SHOWN_POINTS)]
    foot = float(world.terrain.height(world.site.plant(plant).position))

    def flat(p: Array) -> list[list[float]]:
        return np.round(np.column_stack([along_row(world, plant, p), p[:, 2] - foot]), 3).tolist()

    rods = [[*flat(np.array([rod.p0, rod.p1])), round(rod.radius, 4)] for rod in wood_of(world, plant)]
    return {"points": flat(some), "rods": rods}


def _broken(seed: int) -> Trial:
    """A scan on which a joint stands still, or runs backwards."""
    rng, plant = np.random.default_rng([seed, 77]), f"r0v{seed % VINES}"
    with _bench(seed, STYLES[0], 1.0) as bench:
        joint, seconds = int(rng.integers(len(DESCRIPTION.arm.joints))), rng.uniform(1.0, 12.0)
        bench.break_joint(joint, -1.0 if seed % 2 else 0.0, SCANNING, seconds)
        motion = bench.observe(scan_vine(ScanVineGoal(plant=plant), bench.ctx))
        beats = motion.during(SCANNING)
        path = way_of(bench, plant, beats)
    off = np.array([beat.T_true[:3, 3] - path.at(beat.progress * path.times[-1])[:3, 3] for beat in beats])
    leg = int(np.searchsorted(path.times[1:-1], beats[-1].progress * path.times[-1], side="right"))
    left = [float(np.linalg.norm(b.T_told[:3, 3] - path.poses[leg + 1][:3, 3])) for b in leg_beats(beats, path, leg)]
    return {
        "converged": bool(motion.reason),
        "reason": motion.reason,
        "detail": motion.detail,
        "touched": motion.touched,
        "off_mm": 1e3 * float(np.linalg.norm(off - off[0], axis=1).max()),
        "grown_mm": 1e3 * (left[-1] - min(left)),
    }


def _motion_quantities(scans: Sequence[Trial]) -> list[Quantity]:
    done = [scan for scan in scans if scan["converged"]]
    gaps = np.array([gap for scan in done for gap in scan["gaps_mm"]])
    needed = [scan for scan in scans if scan["begin_share"] > 0.5]
    spread = [("median", 50), ("5th percentile", 5), ("95th percentile", 95), ("largest", 100)]
    return [
        rate("scans that came to their end", scans),
        _largest("linear part, largest", "s", [scan["linear_s"] for scan in done], "<= 15"),
        quantile("whole action, median", "s", scans, "action_s", 0.5, reference="about 30 s"),
        quantile("whole action, largest", "s", scans, "action_s", 1.0, reference="about 30 s"),
        *(
            Quantity(name=f"from one plane to the next, {name}", unit="mm", n=len(gaps),
                     value=float(np.percentile(gaps, q)) if len(gaps) else None)
            for name, q in spread
        ),
        _largest("cable, of its budget, largest", "1", [scan["cable_share"] for scan in scans], "<= 1"),
        rate("cable beyond half of its budget: unwound before the scan",
             [scan | {"converged": scan["unwound"]} for scan in needed], goal=">= 1"),
        _largest("cable when the arm is back, of its budget, largest", "1", [scan["end_share"] for scan in done]),
        quantile("off the line as told, 95th percentile", "mm", scans, "told_off_mm", 0.95),
        quantile("off the orientation as told, 95th percentile", "deg", scans, "told_deg", 0.95),
        *(
            quantile(f"{arm}: {name}, 95th percentile", unit, [s for s in scans if s["arm"] == arm], key, 0.95)
            for arm in ARMS
            for name, unit, key in (
                ("straightness by the truth", "mm", "true_bend_mm"),
                ("orientation held by the truth", "deg", "true_deg"),
            )
        ),
        count_of("collisions of the robot", [len(scan["touched"]) for scan in scans]),
    ]  # fmt: skip


def _cloud_quantities(scans: Sequence[Trial]) -> list[Quantity]:
    found = []
    for arm in ARMS:
        for style in STYLES:
            own = [scan for scan in scans if (scan["arm"], scan["style"]) == (arm, style)]
            reference = "" if arm == PERFECT else REFERENCE_ARM
            found += [
                quantile(f"{style}, {arm}: point off the surface, median of a scan", "mm", own, "off_median_mm", 0.5,
                         reference=reference),
                quantile(f"{style}, {arm}: point off the surface, 95th percentile of a scan", "mm", own, "off_p95_mm",
                         0.5, reference=reference),
                quantile(f"{style}, {arm}: surface in sight with a point nearby", "1", own, "had_of_seen", 0.5),
                quantile(f"{style}, {arm}: swept surface, its back too, with a point nearby", "1", own, "had_of_swept",
                         0.5),
            ]  # fmt: skip
    return found


def _broken_quantities(broken: Sequence[Trial]) -> list[Quantity]:
    grown = [trial | {"converged": trial["reason"] == "distance_grows"} for trial in broken]
    return [
        rate("a broken joint: the scan ended with a reason", broken),
        rate("a broken joint: because the distance grew", grown, reference="the only reason"),
        quantile("a broken joint: distance grown, largest", "mm", broken, "grown_mm", 1.0),
        quantile("a broken joint: off the way by the truth, median", "mm", broken, "off_mm", 0.5),
        quantile("a broken joint: off the way by the truth, largest", "mm", broken, "off_mm", 1.0),
        count_of("a broken joint: collisions of the robot", [len(trial["touched"]) for trial in broken]),
    ]


def _largest(name: str, unit: str, values: Sequence[float], goal: str = "") -> Quantity:
    return Quantity(name=name, unit=unit, value=max(values, default=None), n=len(values), goal=goal)


def _figures(scans: Sequence[Trial]) -> tuple[Figure, ...]:
    """The first cloud of each style by a calibrated arm."""
    found = []
    for style in STYLES:
        sides = [s["side"] for s in scans if s["converged"] and (s["arm"], s["style"]) == (CALIBRATED, style)]
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
