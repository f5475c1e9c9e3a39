"""G13: servoing on one image point to a spur, with an arm as flawed as the real one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from grape.actions.move_arm import find_postures, move_to_pose
from grape.actions.servoing import leave
from grape.errors import ActionFailed
from grape.experiments.arm_bench import ArmBench, Parking
from grape.experiments.servo_trials import (
    Key,
    Progress,
    Trial,
    attempt,
    convergence_figures,
    open_loop_and_time,
    quantile,
    rate,
    run_trials,
    small_world,
)
from grape.geometry import inverse, transform
from grape.messages import Array
from grape.proof import Experiment, Proof
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.approach_spur import ApproachSpurGoal, approach_spur
from grape.tasks.dispenser.actions.scan_vine import ScanVineGoal, sweep_path
from grape.tasks.dispenser.actions.servo_to_feeder import ServoToFeederGoal, servo_to_feeder
from grape.tasks.dispenser.actions.servo_to_spur import servo_to_spur
from grape.tasks.dispenser.feeder import FEEDER_BOXES, VIEW_M, hand_at_feeder
from grape.tasks.dispenser.row import row_boxes, row_distance
from grape.tasks.dispenser.scan_views import remember_views
from grape.tasks.dispenser.servo_target import ServoToTargetGoal
from grape.tasks.dispenser.targets import HangTarget, hang_line

VINE = "r0v0"
NO_START = "no_start"  # reason of a trial that did not get as far as servoing
SCAN_ERROR_M = 0.006  # of each coordinate of a tip as a scan gives it, standard deviation, besides what the arm errs
TURNS = [(pitch, azimuth) for pitch in np.radians((55.0, 65.0)) for azimuth in np.radians((0.0, 25.0, -25.0))]
TOP = DESCRIPTION.feeder.levels - 1


def run(seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """Every seed once: the first spur of the vine that the arm reaches."""
    found = run_trials(folder, [Key(case="spur", seed=seed) for seed in seeds], _trial, progress).values()
    trials = [trial for trial in found if trial["reason"] != NO_START]
    return Proof(
        quantities=(
            rate("converged", trials),
            quantile("tip beside its place in the loop, median", "mm", trials, "point_mm", 0.5),
            quantile("tip beside its place in the loop, 95th percentile", "mm", trials, "point_mm", 0.95),
            quantile("of that, across the fingers, 95th percentile", "mm", trials, "across_mm", 0.95),
            *open_loop_and_time(trials),
        ),
        figures=convergence_figures(trials, "Spur", "tip"),
        notes=(
            "The hand is empty. The target is the spur's true tip with errors of "
            f"{1e3 * SCAN_ERROR_M:.0f} mm a coordinate, and with what the arm errs in a posture from which a scan sees "
            "it. As in a mission the hand was at the feeder's markers before. The arm errs (arm_errors = 1).",
            f"In {len(found) - len(trials)} of {len(found)} worlds the arm came before no spur; they do not count.",
        ),
    )


def _trial(key: Key) -> Trial:
    rng = np.random.default_rng([key.seed, 13])
    with ArmBench(DESCRIPTION, Parking(plant=VINE), small_world(key.seed)) as bench:
        T_base_map = inverse(bench.simulation.referee.true_pose())
        spurs = [spur for spur in bench.truth.spurs if spur.plant == VINE]
        for k in rng.permutation(len(spurs)):
            tip, direction = transform(T_base_map, spurs[k].tip), T_base_map[:3, :3] @ spurs[k].direction
            if _reached(bench, tip, direction) is None:
                continue
            T_told_true = _scan(bench, tip)
            told = transform(T_told_true, tip + SCAN_ERROR_M * rng.normal(size=3))
            target = _reached(bench, told, T_told_true[:3, :3] @ direction)
            if target is not None:
                break
        else:
            return {"reason": NO_START, "detail": "no spur", "converged": False, "events": []}
        try:
            _visit_feeder(bench)
            _set_fingers(bench, DESCRIPTION.gripper.open_angle)
            bench.run(approach_spur(ApproachSpurGoal(target=target), bench.ctx))
        except ActionFailed as failed:  # nothing was scanned, so the arm may run into the vine
            return {"reason": NO_START, "detail": failed.detail, "converged": False, "events": []}
        servo = servo_to_spur(ServoToTargetGoal(target=target), bench.ctx)
        return attempt(bench, servo, lambda: _judgement(bench, target, tip))


def _reached(bench: ArmBench, tip: Array, direction: Array) -> HangTarget | None:
    for pitch, azimuth in TURNS:
        target = HangTarget(plant=VINE, kind="spur", tip=tip, direction=direction, pitch=pitch, azimuth=azimuth)
        if find_postures(bench.ctx, hang_line(bench.robot, target, 0.10), touch=target.touched()):
            return target
    return None


def _scan(bench: ArmBench, tip: Array) -> Array:
    """Goes to where a scan sees a spur; (4, 4) from where things are to where the arm makes them out to be there."""
    ctx = bench.ctx
    path = sweep_path(ScanVineGoal(plant=VINE), DESCRIPTION.arm.T_base_link_arm_base, row_distance(ctx, VINE))
    poses = [path.at(t) for t in np.linspace(path.times[0], path.times[-1], 40)]
    nearest = min(poses, key=lambda T: abs(T[0, 3] - tip[0]))
    with ctx.arm.lease("scan") as arm:
        bench.run(move_to_pose(ctx, arm, (nearest,), status="to the scan", boxes=row_boxes(ctx, VINE)))
    remember_views(ctx, [ctx.world.frames.lookup("base_link", "camera_optical")], [ctx.world.joints()])
    return np.asarray(bench.robot.hand_pose(ctx.world.joints()) @ inverse(bench.true_hand()))


def _visit_feeder(bench: ArmBench) -> None:
    """As before every deployment, but nothing is taken: the feeder is empty."""
    ctx, closed = bench.ctx, DESCRIPTION.gripper.closed_angle
    _set_fingers(bench, closed)
    line = (hand_at_feeder(bench.robot, TOP, VIEW_M), hand_at_feeder(bench.robot, TOP, 0.0))
    with ctx.arm.lease("feeder") as arm:
        bench.run(move_to_pose(ctx, arm, line, status="to the feeder", touch_boxes=FEEDER_BOXES))
    bench.run(servo_to_feeder(ServoToFeederGoal(level=TOP), ctx))
    with ctx.arm.lease("feeder") as arm:
        bench.run(leave(ctx, arm, np.array([0.0, 0.0, 1.0]), VIEW_M))
    bench.log.events.clear()


def _set_fingers(bench: ArmBench, angle: float) -> None:
    with bench.ctx.gripper.lease("start") as gripper:
        gripper.send(np.array([DESCRIPTION.gripper.thumb_clear, angle, angle]))


def _judgement(bench: ArmBench, target: HangTarget, tip: Array) -> Mapping[str, float]:
    """How far the tip is from its place between the nails' line and the end of the loop."""
    nails = bench.robot.hand.T_hand_nails(DESCRIPTION.gripper.open_angle)
    wanted = transform(inverse(target.hand_pose(nails)), target.tip)  # in the hand
    missed = transform(inverse(bench.true_hand()), tip) - wanted
    return {
        "point_mm": 1e3 * float(np.linalg.norm(missed)),
        "across_mm": 1e3 * float(np.hypot(missed[0], missed[1])),
        "missed_mm": (1e3 * missed).tolist(),
    }


EXPERIMENT = Experiment(
    row="G13",
    summary="Servos on one image point to the tip of a spur, with the real arm's flaws.",
    seeds=range(500, 530),
    run=run,
)
