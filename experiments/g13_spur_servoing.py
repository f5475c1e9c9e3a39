"""G13: servoing on one image point to a spur, with an arm as flawed as the real one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from grape.actions.move_arm import find_postures
from grape.experiments.arm_bench import ArmBench, Parking
from grape.experiments.servo_trials import (
    Key,
    Progress,
    Trial,
    attempt,
    convergence_figures,
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
from grape.tasks.dispenser.actions.servo_to_spur import servo_to_spur
from grape.tasks.dispenser.servo_target import ServoToTargetGoal
from grape.tasks.dispenser.targets import AIM_OFFSET_M, TOUCH_M, HangTarget, hang_line

VINE = "r0v0"
SCAN_ERROR_M = 0.006  # of each coordinate of a tip as a scan gives it, standard deviation
TURNS = [(pitch, azimuth) for pitch in np.radians((55.0, 65.0)) for azimuth in np.radians((0.0, 25.0, -25.0))]


def run(seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """Every seed once: the first spur of the vine that the arm reaches."""
    found = run_trials(folder, [Key(case="spur", seed=seed) for seed in seeds], _trial, progress).values()
    trials = [trial for trial in found if trial["reason"] != "no_spur"]
    return Proof(
        quantities=(
            rate("converged", trials),
            quantile("tip beside its place in the loop, median", "mm", trials, "point_mm", 0.5),
            quantile("tip beside its place in the loop, 95th percentile", "mm", trials, "point_mm", 0.95),
            quantile("open loop: what the arm is off at the start, 95th percentile", "mm", trials, "arm_off_mm", 0.95,
                     reference="0 to 50 mm"),
            quantile("duration, median", "s", trials, "duration_s", 0.5),
        ),
        figures=convergence_figures(trials, "Spur"),
        notes=(
            "The hand is empty, nothing was scanned: the target is the spur's true tip with errors of "
            f"{1e3 * SCAN_ERROR_M:.0f} mm a coordinate, as the arm would believe it to be if it did not err; the arm "
            "errs (arm_errors = 1).",
            f"In {len(found) - len(trials)} of {len(found)} worlds the arm reaches no spur from this stop.",
        ),
    )  # fmt: skip


def _trial(key: Key) -> Trial:
    rng = np.random.default_rng([key.seed, 13])
    bench = ArmBench(DESCRIPTION, Parking(plant=VINE), small_world(key.seed))
    try:
        T_base_map = inverse(bench.simulation.referee.true_pose())
        spurs = [spur for spur in bench.truth.spurs if spur.plant == VINE]
        for k in rng.permutation(len(spurs)):
            tip, direction = transform(T_base_map, spurs[k].tip), T_base_map[:3, :3] @ spurs[k].direction
            target = _reached(bench, tip + SCAN_ERROR_M * rng.normal(size=3), direction)
            if target is not None:
                break
        else:
            return {"reason": "no_spur", "converged": False, "events": []}
        opened = DESCRIPTION.gripper.open_angle
        with bench.ctx.gripper.lease("start") as gripper:
            gripper.send(np.array([DESCRIPTION.gripper.thumb_clear, opened, opened]))
            bench.run(approach_spur(ApproachSpurGoal(target=target), bench.ctx))
        servo = servo_to_spur(ServoToTargetGoal(target=target), bench.ctx)
        return attempt(bench, servo, lambda: _judgement(bench, target, tip))
    finally:
        bench.close()


def _reached(bench: ArmBench, tip: Array, direction: Array) -> HangTarget | None:
    for pitch, azimuth in TURNS:
        target = HangTarget(plant=VINE, kind="spur", tip=tip, direction=direction, pitch=pitch, azimuth=azimuth)
        if find_postures(bench.ctx, hang_line(bench.robot, target, 0.10), touch=(tip, TOUCH_M)):
            return target
    return None


def _judgement(bench: ArmBench, target: HangTarget, tip: Array) -> Mapping[str, float]:
    """How far the tip is from its place between the nails' line and the end of the loop."""
    nails = bench.robot.hand.T_hand_nails(DESCRIPTION.gripper.open_angle)
    wanted = transform(inverse(target.hand_pose(nails)), target.tip)  # in the hand
    missed = transform(inverse(bench.true_hand()), tip) - wanted
    across = float(np.hypot(missed[0], missed[1]))
    return {"point_mm": 1e3 * float(np.linalg.norm(missed)), "across_mm": 1e3 * across, "aim_mm": 1e3 * AIM_OFFSET_M}


EXPERIMENT = Experiment(
    row="G13",
    summary="Servos on one image point to the tip of a spur, with the real arm's flaws.",
    seeds=range(500, 530),
    run=run,
)
