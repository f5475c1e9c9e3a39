"""Scans of vines for row G7, from unwinding to retracting, each with what came of it by the simulator's truth."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any

import numpy as np

from grape.actions.core import Context, Feedback
from grape.actions.retract import RetractGoal, retract
from grape.actions.robot import build_robot
from grape.actions.unwind import UnwindGoal, unwind
from grape.experiments.arm_bench import Parking
from grape.experiments.arm_track import Beat, Motion, TrackedBench, bend_m, cable_share, off_line_m, turned_rad
from grape.experiments.servo_trials import Key, Trial
from grape.experiments.vine_surface import along_row, of_vine, score_cloud, wood_of
from grape.geometry import transform
from grape.messages import Array
from grape.perception.cloud import image_to_points, voxel_grid
from grape.perception.sweep import debias, range_bias, smooth_sweep
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.worlds import VineyardOptions
from grape.tasks.dispenser.actions.calibrate_arm import CalibrateArmGoal, calibrate_arm
from grape.tasks.dispenser.actions.scan_vine import (
    WRIST_LIDAR,
    ScanVineGoal,
    ScanVineResult,
    SweepPath,
    VineScan,
    scan_vine,
    sweep_path,
)
from grape.tasks.dispenser.own_hand import without_hand
from grape.tasks.dispenser.row import row_distance
from grape.tasks.dispenser.stops import first_stop

STYLES = ("cordon", "gobelet")
PERFECT, AS_IT_COMES, CALIBRATED = ARMS = ("perfect arm", "as it comes", "calibrated")
VINES = 3  # in the row
WOUND = (0.55, 0.9)  # of its budget the last joint's cable is wound before the first scan
UNWOUND_SHARE = 0.05  # of its budget: less than that is what the encoders are off
SCANNING = "scanning"
SHOWN_POINTS = 1200


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


def scan_trial(key: Key) -> Trial:
    """A scan by a perfect arm; or by a flawed one as it comes, and again when it has calibrated itself."""
    style, which = key.case.split(", ")
    rng = np.random.default_rng([key.seed, 7, STYLES.index(style)])
    wound = float(rng.choice([-1.0, 1.0]) * rng.uniform(*WOUND))
    plant, found, uncalibrated = f"r0v{key.seed % VINES}", [], ""
    with _bench(key.seed, style, float(which == "flawed"), wound) as bench:
        for arm in (PERFECT,) if which == "perfect" else (AS_IT_COMES, CALIBRATED):
            if arm == CALIBRATED:
                uncalibrated = bench.observe(calibrate_arm(CalibrateArmGoal(), bench.ctx)).reason
            begin = cable_share(DESCRIPTION.arm, bench.ctx.world.joints())
            bench.log.events.clear()
            motion = bench.observe(scan_action(ScanVineGoal(plant=plant), bench.ctx))
            found.append({"arm": arm, "style": style, "begin_share": begin, **_judged(bench, plant, motion)})
    return {"scans": found, "uncalibrated": uncalibrated}


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
        "hindered": len(bench.log.of("sweep_hindered")),
    }
    if motion.result is None:
        return told
    told |= {
        "linear_s": beats[-1].time_s - beats[0].time_s,
        "end_share": cable_share(arm, bench.ctx.world.joints()),
    }
    if told["hindered"]:
        return told
    path = way_of(bench, plant, beats)
    passes = [leg_beats(beats, path, leg) for leg in (0, 2)]
    lidars = [_lidars(bench, own) for own in passes]
    told |= {
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
    """How good the cloud is, as assembled and as it is used, and its picture from the side."""
    T_map_base, passes = bench.simulation.referee.true_pose(), [T[::5] for T in lidars]
    bias = range_bias(smooth_sweep(result.scan.sweep), depth_cloud(result.scan))
    used = debias(result.scan.sweep, bias or 0.0)
    points = transform(T_map_base, used.points)
    assembled = score_cloud(bench.truth, plant, transform(T_map_base, result.scan.sweep.points), passes)
    score = score_cloud(bench.truth, plant, points, passes)
    return {
        "points": len(points),
        "range_off_mm": None if bias is None else 1e3 * bias,
        "assembled_median_mm": float(np.median(assembled.off_mm)),
        "assembled_p95_mm": float(np.percentile(assembled.off_mm, 95)),
        "off_median_mm": float(np.median(score.off_mm)),
        "off_p95_mm": float(np.percentile(score.off_mm, 95)),
        "had_of_seen": score.had / score.seen,
        "had_of_swept": score.had / score.swept,
        "side": _side(bench, plant, points),
    }


def depth_cloud(scan: VineScan) -> Array:
    """(n, 3) m in base_link, what the depth frames of a scan show beside the hand."""
    frames = zip(scan.images, scan.T_base_camera, strict=True)
    clouds = [transform(T, without_hand(image_to_points(i), scan.T_hand_camera, scan.holding)) for i, T in frames]
    return voxel_grid(np.vstack(clouds), 0.005)


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


def broken_scan(seed: int) -> Trial:
    """A scan on which a joint stands still, or runs backwards."""
    rng, plant = np.random.default_rng([seed, 77]), f"r0v{seed % VINES}"
    with _bench(seed, STYLES[0], 1.0) as bench:
        joint, seconds = int(rng.integers(len(DESCRIPTION.arm.joints))), rng.uniform(1.0, 12.0)
        bench.break_joint(joint, -1.0 if seed % 2 else 0.0, SCANNING, seconds)
        motion = bench.observe(scan_vine(ScanVineGoal(plant=plant), bench.ctx))
        beats, hindered = motion.during(SCANNING), len(bench.log.of("sweep_hindered"))
        path = way_of(bench, plant, beats)
    told: Trial = {
        "converged": bool(motion.reason),
        "reason": motion.reason,
        "detail": motion.detail,
        "touched": motion.touched,
        "hindered": hindered,
    }
    if hindered:
        return told
    off = np.array([beat.T_true[:3, 3] - path.at(beat.progress * path.times[-1])[:3, 3] for beat in beats])
    leg = int(np.searchsorted(path.times[1:-1], beats[-1].progress * path.times[-1], side="right"))
    left = [float(np.linalg.norm(b.T_told[:3, 3] - path.poses[leg + 1][:3, 3])) for b in leg_beats(beats, path, leg)]
    return told | {
        "off_mm": 1e3 * float(np.linalg.norm(off - off[0], axis=1).max()),
        "grown_mm": 1e3 * (left[-1] - min(left)),
    }
