"""Row G6: what is measured of a motion, and that an experiment goes on from what it has."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grape.actions.core import Feedback
from grape.actions.move_arm import MoveArmToNamedGoal, move_arm_to_named
from grape.errors import ActionFailed, Reason
from grape.experiments import g6_arm_motion as g6
from grape.experiments.arm_moves import LINE, PARKING, draw_free, stray
from grape.experiments.arm_track import (
    Beat,
    BrokenArm,
    Motion,
    TrackedBench,
    bend_m,
    cable_share,
    off_line_m,
    turned_rad,
)
from grape.experiments.servo_trials import small_world
from grape.geometry import pose, rotation_z
from grape.planning import StateChecker
from grape.robots.husky_jaco2 import DESCRIPTION

ARM = DESCRIPTION.arm


def motion(hand_mm: float = 1.0, **changes: Any) -> dict[str, Any]:
    """What came of a motion of any of the four ways."""
    return {
        "arm": "as it comes", "converged": True, "reason": "", "detail": "", "hand_mm": hand_mm, "hand_deg": 0.5,
        "duration_s": 4.0, "speed_share": 0.9, "cable_share": 0.3, "touched": [], "begin_share": 0.8,
        "turns_left": 0.01, "followed": True, "told_off_mm": 2.0, "told_deg": 0.1, "true_bend_mm": 3.0, "true_deg": 0.4,
        "told_end_mm": 1.0,
        "true_end_mm": 9.0, "track_mm": [(0.0, 0.0), (100.0, 1.0)], "off_mm": 12.0, "turned_deg": 1.0, "grown_mm": 7.0,
    } | changes  # fmt: skip


def figures_of(monkeypatch: pytest.MonkeyPatch, folder: Path, **kinds: list[dict[str, Any]]) -> dict[str, Any]:
    """Quantities by name, of one seed with these motions."""
    trial = {"converged": True, "hand_mm": 0.4, "uncalibrated": ""} | {
        kind: [] for kind in ("planned", "lines", "unwound", "astray")
    }
    cases = {case: lambda seed: trial | kinds for case in ("moves", "unwound", "astray", "servo")}
    monkeypatch.setattr(g6, "CASES", cases)
    proof = g6.run([3], folder, lambda share, text: None)
    return {q.name: q for q in proof.quantities} | {"notes": proof.notes, "figures": proof.figures}


def test_what_is_off_a_straight_line() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.003, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.004]])
    assert off_line_m(points, np.zeros(3), np.array([2.0, 0.0, 0.0])) == pytest.approx([0.0, 0.003, 0.0, 0.004])
    assert bend_m(points[:3] + np.array([5.0, 1.0, 0.0])) == pytest.approx(0.002, abs=1e-5)
    assert bend_m(points[[0, 2]]) == pytest.approx(0.0, abs=1e-12)
    assert turned_rad([rotation_z(0.1), rotation_z(-0.3)], np.eye(3)) == pytest.approx(0.3)


def test_a_line_that_was_left_is_told_by_how_far_and_how_much_of_the_way_was_lost() -> None:
    def beat(told_x: float, true_y: float) -> Beat:
        told, true = pose(None, (told_x, 0.0, 0.0)), pose(rotation_z(true_y), (told_x, 0.02 + true_y, 0.0))
        q = np.array(ARM.unwound)
        return Beat(time_s=0.0, status=LINE, progress=0.0, q=q, speed=np.zeros(6), T_told=told, T_true=true)

    beats = [beat(0.0, 0.0), beat(0.1, 0.01), beat(0.2, 0.03), beat(0.17, 0.02)]
    end = pose(None, (0.5, 0.0, 0.0))
    left = stray(Motion(beats=beats, result=None, reason="r", detail="", touched=()), pose(), end)
    assert (left["off_mm"], left["grown_mm"]) == pytest.approx((30.0, 30.0))
    assert left["turned_deg"] == pytest.approx(np.degrees(0.03)) and not left["converged"]
    assert not stray(Motion(beats=(), result=None, reason="r", detail="", touched=()), pose(), end)["followed"]


def test_drawn_states_are_free_and_within_the_cables(robot_models: Any) -> None:
    checker = StateChecker(robot_models.body)
    for q in islice(draw_free(robot_models, checker, np.random.default_rng(0)), 20):
        assert checker.is_valid(q) and cable_share(ARM, q) <= 1.0


def test_only_continuous_joints_wind_cables() -> None:
    assert cable_share(ARM, ARM.unwound) == 0.0
    turned = np.array([0.0, 2.0, 2.0, 0.0, 0.0, -0.5 * ARM.cable_turns])
    assert cable_share(ARM, ARM.unwound + turned) == pytest.approx(0.5)


def test_a_broken_joint_moves_by_its_factor_from_when_it_is_due() -> None:
    class Arm:
        def send(self, velocity: np.ndarray) -> np.ndarray:
            return velocity

        def stop(self) -> str:
            return "stopped"

    due = iter([False, True, False])
    arm = BrokenArm(Arm(), 1, -1.0, lambda: next(due))  # type: ignore[arg-type]
    assert [arm.send(np.array([1.0, 2.0]))[1] for _ in range(3)] == [2.0, -2.0, -2.0]
    assert arm.stop() == "stopped"


def test_hand_errors_are_told_as_the_arm_comes_and_calibrated(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    planned = [motion(20.0), motion(40.0), motion(2.0, arm="calibrated", touched=[["hand", "feeder"]])]
    lost = motion(900.0, converged=False, reason="no_plan", detail="nowhere")
    found = figures_of(monkeypatch, tmp_path, planned=[*planned, lost])
    assert found["planned, as it comes: hand off its goal, median"].value == pytest.approx(30.0)
    assert found["planned, as it comes: reached"].value == pytest.approx(2 / 3)
    assert found["planned, calibrated: hand off its goal, largest"].value == pytest.approx(2.0)
    assert found["planned: collisions of the robot"].met is False
    assert not any("not calibrated" in note for note in found["notes"])
    assert found["notes"][-1] == "Seed 3, planned: no_plan, nowhere"
    assert "<polyline" in found["figures"][0].svg


def test_lines_that_come_to_nothing_are_told_by_what_ended_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    strays = [
        motion(why="out of reach", converged=False, reason="tracking_error", off_mm=20.0, grown_mm=0.0),
        motion(why="a joint runs backwards", converged=False, reason="distance_grows", off_mm=30.0),
        motion(why="a joint stands still"),
        {**motion(why="out of reach", converged=False, reason="no_plan"), "followed": False},
    ]
    found = figures_of(monkeypatch, tmp_path, astray=strays)
    assert found["lines, out of reach: ended with a reason"].n == 1, "one never began"
    assert found["lines, a joint stands still: ended with a reason"].value == 0.0
    assert found["ended lines: because the distance grew"].value == 0.5
    assert found["ended lines: off the line, median"].value == pytest.approx(25.0)
    assert found["ended lines: distance grown, largest"].value == pytest.approx(7.0)


def test_nothing_was_moved_yet(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = figures_of(monkeypatch, tmp_path)
    assert found["unwinding: turns left over, largest"].value is None and found["lines: followed to the end"].n == 0


def test_the_beats_of_an_action_are_kept_whatever_its_end() -> None:
    with TrackedBench(DESCRIPTION, PARKING, small_world(1), arm_errors=0.0) as bench:
        seen = bench.observe(move_arm_to_named(MoveArmToNamedGoal(pose="home"), bench.ctx), limit_s=0.5)
        assert seen.reason == str(Reason.TIMEOUT) and 45 <= len(seen.beats) <= 51
        assert seen.during("moving to the home pose") and 0.0 < seen.speed_share(ARM) <= 1.01

        def fails():
            yield Feedback(status="waiting")
            raise ActionFailed(Reason.NO_PLAN, "no way")

        seen = bench.observe(fails())
        assert (seen.reason, seen.detail, seen.result) == ("no_plan", "no way", None)
        assert [beat.status for beat in seen.beats] == ["waiting"]
