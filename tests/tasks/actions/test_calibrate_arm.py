"""Calibrating the arm by the feeder's markers, and adopting what servoing shows later."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.account import RESUMED
from grape.actions.calibration import ENCODER_OFFSETS, adopt_offsets, recall_offsets, remember_offsets
from grape.actions.hand_path import JOINT_OFFSETS, calibrated_joints
from grape.actions.obstacles import OBSTACLES, Obstacles
from grape.errors import Reason
from grape.tasks.dispenser.actions.calibrate_arm import CalibrateArmGoal, calibrate_arm
from grape.tasks.dispenser.actions.drive_to_plant import PARKED, DriveToPlantGoal, drive_to_plant
from grape.tasks.dispenser.actions.withdraw_hand import WithdrawHandGoal, withdraw_hand

BIAS = np.radians([2.0, -1.5, 1.0, 2.0, -2.0, 2.5])


def test_looks_round_the_feeder_show_every_joint(bench: Bench, task: SimpleNamespace) -> None:
    task.fill_feeder(bench, 6)
    bench.bias = BIAS
    bench.advance()
    off = np.linalg.norm(bench.robot.hand_pose(bench.world.joints())[:3, 3] - bench.hand[:3, 3])
    assert off > 0.02
    bench.run(calibrate_arm(CalibrateArmGoal(), bench.ctx))
    assert bench.world.encoder_offsets == pytest.approx(BIAS, abs=np.radians(0.6))
    bench.advance()
    for pose in ("travel", "ready_left_fore"):
        bench.put_arm(bench.robot.description.arm.poses[pose])
        told = bench.robot.hand_pose(bench.world.joints())
        assert np.linalg.norm(told[:3, 3] - bench.hand[:3, 3]) < 0.004, pose
    assert bench.log.last("calibrated")["looks"] >= 5
    assert bench.ledger.recall(ENCODER_OFFSETS) == bench.world.encoder_offsets.tolist()


def test_a_dispenser_in_the_hand_is_not_dropped(bench: Bench) -> None:
    gripper = bench.robot.description.gripper
    bench.ledger.move_dispenser("feeder", "hand")
    spread = np.array([gripper.thumb_clear, gripper.open_angle, gripper.open_angle])
    bench.fingers.angles = bench.fingers.target = spread
    bench.failure(calibrate_arm(CalibrateArmGoal(), bench.ctx))
    assert (bench.fingers.angles == spread).all()


def test_an_arm_is_calibrated_once(bench: Bench) -> None:
    bench.world.encoder_offsets = np.zeros(6)
    bench.run(calibrate_arm(CalibrateArmGoal(), bench.ctx), limit_s=0.1)
    assert bench.arm.sent == 0


def test_what_an_interrupted_session_learned_of_the_joints_counts_once(bench: Bench, task: SimpleNamespace) -> None:
    task.fill_feeder(bench, 6)
    bench.bias = BIAS
    bench.ledger.remember(PARKED, ["n0", 0.3, 0.62])
    bench.ledger.remember(JOINT_OFFSETS, BIAS.tolist())
    bench.world.committed[RESUMED] = True
    bench.advance()
    bench.run(withdraw_hand(WithdrawHandGoal(), bench.ctx))
    bench.run(calibrate_arm(CalibrateArmGoal(), bench.ctx), limit_s=0.1)
    assert bench.world.encoder_offsets is None and bench.arm.sent == 0
    assert bench.robot.hand_pose(calibrated_joints(bench.ctx)) == pytest.approx(bench.hand, abs=1e-6)
    bench.run(drive_to_plant(DriveToPlantGoal(plant="n0"), bench.ctx), limit_s=0.1)
    assert bench.world.encoder_offsets is None, "the base stands where it stood"
    drive = drive_to_plant(DriveToPlantGoal(plant="v0"), bench.ctx)
    for _ in range(10):
        next(drive)
        bench.advance()
    drive.close()
    assert bench.world.encoder_offsets == pytest.approx(BIAS) and JOINT_OFFSETS not in bench.world.committed


def test_what_was_seen_by_an_arm_that_is_not_calibrated_stays_in_its_frame(bench: Bench) -> None:
    bench.world.committed[OBSTACLES] = Obstacles(np.array([[0.4, 0.9, 0.5]]))
    bench.run(calibrate_arm(CalibrateArmGoal(), bench.ctx), limit_s=0.1)
    assert bench.world.encoder_offsets is None and bench.arm.sent == 0


def test_an_arm_may_be_left_as_it_comes(bench: Bench) -> None:
    bench.run(calibrate_arm(CalibrateArmGoal(skip=True), bench.ctx), limit_s=0.1)
    assert bench.world.encoder_offsets is None and bench.arm.sent == 0


def test_without_markers_the_arm_stays_uncalibrated_and_says_why(bench: Bench) -> None:
    failure = bench.failure(calibrate_arm(CalibrateArmGoal(), bench.ctx))
    assert failure.reason is Reason.FEATURE_LOST and "0 of 7 looks" in failure.detail
    assert bench.world.encoder_offsets is None and bench.ctx.arm.owner is None


def test_offsets_that_servoing_shows_add_up_when_the_base_drives_on(bench: Bench) -> None:
    bench.world.encoder_offsets = np.full(6, 0.02)
    bench.world.committed[JOINT_OFFSETS] = np.full(6, 0.001)
    told = bench.world.joints()
    adopt_offsets(bench.ctx)
    bench.advance()
    assert bench.world.joints() == pytest.approx(told - 0.021), "less all that is known, from the next beat on"
    assert JOINT_OFFSETS not in bench.world.committed
    remember_offsets(bench.ctx)
    bench.world.encoder_offsets = None
    recall_offsets(bench.ctx)
    assert bench.world.encoder_offsets == pytest.approx(np.full(6, 0.021))
