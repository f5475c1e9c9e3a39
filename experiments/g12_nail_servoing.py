"""G12: servoing to a nail by the markers beside it, with an arm as flawed as the real one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from grape.experiments.arm_bench import ArmBench, Parking
from grape.experiments.servo_trials import (
    Key,
    Progress,
    Trial,
    attempt,
    convergence_figures,
    go_to_start,
    marker_quantities,
    pose_judgement,
    run_trials,
    small_world,
)
from grape.geometry import inverse, transform
from grape.proof import Experiment, Proof
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.servo_to_nail import servo_to_nail
from grape.tasks.dispenser.nail_board import NailBoard, nail_target
from grape.tasks.dispenser.row import ROW, expect_row
from grape.tasks.dispenser.servo_target import ServoToTargetGoal
from grape.tasks.dispenser.targets import hang_line

NAIL = "r0n0"
STAND_OFF_M = 0.14


def run(seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """Every seed once, the nail fore and aft of the arm's base in turn."""
    keys = [Key(case="aft" if seed % 2 else "fore", seed=seed) for seed in seeds]
    trials = list(run_trials(folder, keys, _trial, progress).values())
    return Proof(
        quantities=marker_quantities(trials, "figure 7.5: corners end on their targets"),
        figures=convergence_figures(trials, "Nail"),
        notes=(
            "The hand is empty. Starts are up to 5 cm and 10 degrees beside the pose before the nail, and the arm errs "
            "on top of that (arm_errors = 1). Errors are those of the runs that converged, by the simulator's truth.",
        ),
    )


def _trial(key: Key) -> Trial:
    rng = np.random.default_rng([key.seed, 12])
    parking = Parking(plant=NAIL, ahead_m=-0.22 if key.case == "aft" else 0.22)
    with ArmBench(DESCRIPTION, parking, small_world(key.seed)) as bench:
        robot, opened = bench.robot, DESCRIPTION.gripper.open_angle
        surveyed = nail_target(bench.ctx, NAIL, NailBoard())
        expect_row(bench.ctx, NAIL)
        go_to_start(bench, rng, hang_line(robot, surveyed, STAND_OFF_M), opened, touch_boxes=(ROW,))
        nails = robot.hand.T_hand_nails(opened)
        (truth,) = bench.truth.nails
        tip = transform(inverse(bench.simulation.referee.true_pose()), truth.tip)
        wanted = replace(surveyed, tip=tip).hand_pose(nails)
        servo = servo_to_nail(ServoToTargetGoal(target=surveyed), bench.ctx)
        return attempt(bench, servo, lambda: pose_judgement(bench.true_hand(), wanted, nails[:3, 3]))


EXPERIMENT = Experiment(
    row="G12",
    summary="Servos from up to 5 cm and 10 degrees off to a nail, with the real arm's flaws.",
    seeds=range(500, 530),
    run=run,
)
