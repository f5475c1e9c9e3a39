"""With the joints' offsets known, a spur is where it is and not where the arm saw it when it scanned."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.hand_path import JOINT_OFFSETS, hand_correction
from grape.geometry import inverse, pose, rotation_x, rotation_z, transform
from grape.kinematics import inverse_all
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.servo_to_spur import servo_to_spur
from grape.tasks.dispenser.scan_views import as_calibrated, remember_views
from grape.tasks.dispenser.servo_target import ServoToTargetGoal
from grape.tasks.dispenser.targets import HangTarget

BIAS = np.radians([1.5, -1.2, 1.0, 2.0, -2.0, 1.5])  # the encoders tell so much more than the links have turned
SCAN_HAND = pose(rotation_x(np.radians(80.0)) @ rotation_z(np.pi), (0.45, 0.42, 0.86))


def true_hand(bench: Bench, q: Any) -> Any:
    return bench.robot.hand_pose(q - BIAS)


def scanned(bench: Bench, target: HangTarget, remember: bool = True) -> HangTarget:
    """The target as a scan with the biased arm tells it."""
    q = inverse_all(bench.robot.arm, bench.robot.in_arm_base(SCAN_HAND), bench.arm.q)[0].q
    T_told, T_true = bench.robot.hand_pose(q), true_hand(bench, q)
    if remember:
        remember_views(bench.ctx, [T_told @ DESCRIPTION.mounts["camera_optical"].T_parent_sensor], [q])
    wrong = T_told @ inverse(T_true)
    return HangTarget(
        plant=target.plant, kind="spur", tip=transform(wrong, target.tip), direction=wrong[:3, :3] @ target.direction,
        pitch=target.pitch,
    )  # fmt: skip


def biased(bench: Bench) -> None:
    """From now on the camera sees from where the links are, which the encoders do not tell."""
    see: Callable[..., None] = bench.camera.advance
    bench.camera.advance = lambda now, q, fingers: see(now, q - BIAS, fingers)  # type: ignore[method-assign]


def test_a_scanned_target_is_put_right(bench: Bench, task: SimpleNamespace) -> None:
    truth = task.spur_target(bench)
    told = scanned(bench, truth)
    assert np.linalg.norm(told.tip - truth.tip) > 0.015
    bench.world.committed[JOINT_OFFSETS] = BIAS
    found = as_calibrated(bench.ctx, told)
    assert found.tip == pytest.approx(truth.tip, abs=1e-6)
    assert found.direction == pytest.approx(truth.direction, abs=1e-6)


@pytest.mark.parametrize(("offsets", "remember"), [(None, True), (BIAS, False)])
def test_without_offsets_or_views_nothing_is_put_right(
    bench: Bench, task: SimpleNamespace, offsets: Any, remember: bool
) -> None:
    told = scanned(bench, task.spur_target(bench), remember)
    if offsets is not None:
        bench.world.committed[JOINT_OFFSETS] = offsets
    assert as_calibrated(bench.ctx, told) is told


def test_the_hand_is_corrected_by_the_offsets(bench: Bench) -> None:
    assert hand_correction(bench.ctx) == pytest.approx(np.eye(4))
    bench.world.committed[JOINT_OFFSETS] = BIAS
    q = bench.arm.q + 0.1
    assert hand_correction(bench.ctx, q) @ bench.robot.hand_pose(q) == pytest.approx(true_hand(bench, q))


def test_servoing_with_a_biased_arm_takes_the_right_one_of_two_spurs(bench: Bench, task: SimpleNamespace) -> None:
    truth = task.spur_target(bench)
    told = scanned(bench, truth)
    biased(bench)
    task.at_target(bench, told, 0.10)
    aside = np.array([0.05, 0.0, 0.0])
    bench.scene.rods = [
        (truth.tip + shift - 0.08 * truth.direction, truth.tip + shift, 0.005) for shift in (0.0 * aside, aside, -aside)
    ]
    bench.world.committed[JOINT_OFFSETS] = BIAS
    bench.run(servo_to_spur(ServoToTargetGoal(target=told), bench.ctx))
    nails = bench.robot.hand.T_hand_nails(DESCRIPTION.gripper.open_angle)
    wanted = truth.hand_pose(nails)
    assert true_hand(bench, bench.arm.q)[:3, 3] == pytest.approx(wanted[:3, 3], abs=0.005)
