"""Row G8: what counts as a right pose, and that an experiment goes on from what it has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grape.experiments import g8_deployment_points as g8
from grape.experiments.spur_scores import match, tally, usable
from grape.experiments.vine_scans import ScannedVine, TrueSpur
from grape.perception.sweep import assemble
from grape.tasks.dispenser.actions.scan_vine import VineScan
from grape.tasks.dispenser.perception.deployment_pose import DeploymentPose


def leaning(degrees: float) -> np.ndarray:
    return np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])


def true_spur(x: float, lean: float = 0.0, **changes) -> TrueSpur:
    tip, direction = np.array([x, 1.0, 0.8]), leaning(lean)
    values = {"own": True, "height_m": 0.93, "seen": 1.0, "beside_m": x, **changes}
    return TrueSpur(tip=tip, base=tip - 0.1 * direction, direction=direction, diameter_m=0.009, **values)


def found(x: float, lean: float = 0.0, depth: float = 0.0, score: float = 0.9) -> DeploymentPose:
    tip, direction = np.array([x, 1.0 + depth, 0.8]), leaning(lean)
    return DeploymentPose(
        tip=tip, base=tip - 0.1 * direction, direction=direction, diameter_m=0.01, length_m=0.1, score=score, factors={}
    )


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, True),
        ({"lean": 49.0}, True),
        ({"lean": 51.0}, False),
        ({"own": False}, False),
        ({"seen": 0.4}, False),
        ({"height_m": 0.40}, False),
        ({"beside_m": 0.6}, False),
    ],
)
def test_usable_spurs_are_upright_seen_and_before_the_arm(changes: dict, expected: bool) -> None:
    assert usable(true_spur(0.0, **changes)) is expected


@pytest.mark.parametrize(
    ("pose", "right", "first"),
    [
        (found(0.02), True, True),
        (found(0.0, depth=0.05), True, False),
        (found(0.0, lean=22.0), True, False),
        (found(0.0, lean=26.0), False, False),
        (found(0.05), False, False),
    ],
)
def test_poses_are_right_near_a_true_spur_that_points_alike(pose: DeploymentPose, right: bool, first: bool) -> None:
    (m,) = match([pose], [true_spur(0.0)])
    assert (m.right, m.right_first) == (right, first)


def test_a_spur_counts_once_and_a_missed_one_is_missed() -> None:
    spurs = [true_spur(0.0), true_spur(0.3), true_spur(-0.3, lean=80.0)]
    counts = tally([found(0.0), found(0.01), found(-0.3, lean=80.0)], spurs)
    assert (counts.poses, counts.right, counts.first) == (3, 1, 1)
    assert (counts.usable, counts.found) == (2, 1)
    assert counts.tip_m == pytest.approx((0.0,)) and counts.diameter_m == pytest.approx((0.001,))
    empty = tally([], spurs)
    both = counts + empty
    assert (both.vines, both.listed, both.first, both.usable) == (2, 1, 1, 4)


def test_vines_that_the_folder_has_are_not_scanned_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scanned: list[tuple[int, str]] = []

    def scan(seed: int, style: str) -> ScannedVine:
        scanned.append((seed, style))
        nothing = VineScan(sweep=assemble([], []), images=(), T_base_camera=(), T_hand_camera=np.eye(4))
        return ScannedVine(scan=nothing, worst=nothing.sweep, foot=np.zeros(2), spurs=(true_spur(0.0),))

    monkeypatch.setattr(g8, "scan_simulated_vine", scan)
    monkeypatch.setattr(g8, "_cloud_ms", lambda looks, box: 120.0)
    heard: list[float] = []
    g8.run(range(500, 501), tmp_path, lambda fraction, text: heard.append(fraction))
    proof = g8.run(range(500, 502), tmp_path, lambda fraction, text: heard.append(fraction))
    assert scanned == [(500, "cordon"), (500, "gobelet"), (501, "cordon"), (501, "gobelet")]
    by_name = {q.name: q for q in proof.quantities}
    assert by_name["cordon, camera and LiDAR: recall of usable spurs"].value == 0.0
    assert by_name["cordon, camera and LiDAR: first pose right"].met is False
    assert by_name["gobelet, LiDAR alone: precision of the list"].value is None
    assert by_name["cloud of 100 000 points to poses, median"].met is True
