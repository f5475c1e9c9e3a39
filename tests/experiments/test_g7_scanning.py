"""Row G7: how evenly a vine is scanned, how true its cloud is, and what is told of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grape.experiments import g7_scanning as g7
from grape.experiments import scan_trials, vine_surface
from grape.experiments.arm_track import Beat, Motion
from grape.geometry import pose, rotation_z
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.worlds import VineyardOptions, World, generate_vineyard
from grape.tasks.dispenser.actions.scan_vine import ScanVineGoal, sweep_path

PLANT, TRAVEL = "r0v1", DESCRIPTION.arm.poses["travel"]
PATH = sweep_path(ScanVineGoal(plant=PLANT), DESCRIPTION.arm.T_base_link_arm_base, 0.9)


@pytest.fixture(scope="module")
def world() -> World:
    return generate_vineyard(VineyardOptions(seed=4, rows=1, vines_per_row=3))


def beat(progress: float = 0.0, status: str = "scanning", turned: float = 0.0) -> Beat:
    """One on the way of a scan, the last joint wound by a share of its budget."""
    q = TRAVEL + np.r_[np.zeros(5), turned * DESCRIPTION.arm.cable_turns]
    T = PATH.at(progress * PATH.times[-1])
    return Beat(time_s=10 * progress, status=status, progress=progress, q=q, speed=np.zeros(6), T_told=T, T_true=T)


def scan(**changes: Any) -> dict[str, Any]:
    """What came of a scan."""
    return {
        "arm": "calibrated", "style": "cordon", "converged": True, "reason": "", "detail": "", "action_s": 29.0,
        "linear_s": 14.5, "cable_share": 0.8, "begin_share": 0.7, "end_share": 0.01, "unwound": True, "touched": [],
        "hindered": 0, "gaps_mm": [6.0, 7.0, 6.5], "told_off_mm": 1.0, "told_deg": 0.1, "true_bend_mm": 2.0,
        "true_deg": 0.2, "points": 900, "range_off_mm": 20.0, "assembled_median_mm": 21.0, "assembled_p95_mm": 50.0,
        "off_median_mm": 4.0, "off_p95_mm": 30.0, "had_of_seen": 0.9, "had_of_swept": 0.4,
        "side": {"points": [[0.0, 0.8]], "rods": [[[0.0, 0.2], [0.0, 0.7], 0.03]]},
    } | changes  # fmt: skip


def test_planes_are_apart_as_far_as_the_lidar_moved_between_them() -> None:
    beat_times, along = np.linspace(0.0, 2.0, 201), 1.0 - 0.1 * np.linspace(0.0, 2.0, 201)
    gaps = scan_trials.plane_gaps_mm([-0.1, 0.0, 0.066, 0.132, 0.2, 2.1], beat_times, along)
    assert gaps == pytest.approx([6.6, 6.6, 6.8]), "planes before and after the pass do not count"


def test_the_parts_of_a_sweep_are_told_by_its_progress() -> None:
    beats = [beat(p) for p in np.linspace(0.0, 1.0, 101)]
    forth, between, back = (scan_trials.leg_beats(beats, PATH, leg) for leg in range(3))
    x = [b.T_told[0, 3] for b in forth]
    assert max(x) - min(x) == pytest.approx(0.68, abs=0.02) and len(between) < 10 < len(back)
    assert {round(b.T_told[2, 3], 6) for b in back} == {round(PATH.poses[2][2, 3], 6)}


def test_unwinding_counts_when_it_came_first_and_left_nothing() -> None:
    def moved(*beats: Beat) -> Motion:
        return Motion(beats=beats, result=None, reason="", detail="", touched=())

    first, last = beat(0.0, "unwinding", 0.8), beat(0.01, "unwinding", 0.01)
    assert scan_trials.is_unwound(moved(first, last, beat(0.5)))
    assert not scan_trials.is_unwound(moved(first, beat(0.5)))
    assert not scan_trials.is_unwound(moved(beat(0.5, turned=0.8), last))


def test_points_on_the_wood_are_on_the_surface_and_beside_it_are_not(world: World) -> None:
    samples = vine_surface.surface_samples(world, PLANT)
    assert len(samples) > 500
    along = vine_surface.along_row(world, PLANT, samples)
    spot = world.site.plant(PLANT)
    row = world.site.row(spot.row)
    lidar = [
        pose(np.column_stack([[*-row.aisle_normal, 0.0], [*row.work_direction, 0.0], [0.0, 0.0, 1.0]]),
             (*(spot.position + x * row.work_direction + 0.6 * row.aisle_normal), samples[:, 2].mean()))
        for x in np.linspace(-0.3, 0.3, 61)
    ]  # fmt: skip
    true = vine_surface.score_cloud(world, PLANT, samples, [np.array(lidar)])
    assert np.percentile(true.off_mm, 95) < 2.0 and 0 < true.had == true.seen < true.swept < len(samples)
    half = vine_surface.score_cloud(world, PLANT, samples[along < 0.0], [np.array(lidar)])
    assert 0.2 * true.seen < half.had < 0.8 * true.seen
    off = vine_surface.score_cloud(world, PLANT, samples + np.array([0.0, 0.0, 0.5]), [np.array(lidar)])
    assert np.median(off.off_mm) > 50.0


def test_a_sample_is_seen_from_abreast_when_nothing_is_before_it() -> None:
    lidar = np.array([pose(rotation_z(np.pi / 2), (x, 0.0, 0.0)) for x in (0.0, 0.1, 0.2)])
    samples = np.array([[0.1, 0.5, 0.0], [0.1, 0.2, 0.0], [0.1, 1.3, 0.0], [0.3, 0.5, 0.0], [0.1, 0.1, 0.5]])
    asked: list[np.ndarray] = []

    def cast(origins: np.ndarray, ways: np.ndarray) -> np.ndarray:
        asked.append(origins)
        return np.full(len(ways), np.inf)

    places = lidar[:, 0, 3]
    seen = vine_surface.seen_from(cast, samples, samples[:, 0], lidar, places)
    assert seen.tolist() == [True, False, False, False, False], "too near, too far, beside the pass, beside the beams"
    assert asked[0][0] == pytest.approx([0.1, 0.0, 0.0])
    back = vine_surface.seen_from(lambda o, w: np.full(len(w), 0.4), samples, samples[:, 0], lidar[::-1], places[::-1])
    assert not back.any(), "something is before them"


def test_goals_hold_the_worst_scan(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bad = scan(linear_s=15.2, cable_share=1.1, unwound=False, style="gobelet")
    failed = {key: scan()[key] for key in ("arm", "style", "action_s", "cable_share", "unwound", "touched", "hindered")}
    failed |= {
        "arm": "as it comes",
        "converged": False,
        "reason": "unreachable",
        "detail": "no way",
        "begin_share": 0.6,
    }
    kept = [key for key in scan() if not key.endswith(("_mm", "_deg"))]
    over = {key: scan(hindered=1, begin_share=0.2)[key] for key in kept}
    ran: list[Any] = []

    def scans(key: Any) -> dict[str, Any]:
        ran.append(key)
        flawed = key.case == "cordon, flawed"
        return {"scans": [scan(), bad, failed, over] if flawed else [], "uncalibrated": "feature_lost" * flawed}

    broken = {
        "converged": True,
        "reason": "distance_grows",
        "touched": [],
        "hindered": 0,
        "off_mm": 30.0,
        "grown_mm": 6.5,
    }
    monkeypatch.setattr(g7, "scan_trial", scans)
    monkeypatch.setattr(g7, "broken_scan", lambda seed: broken)
    g7.run([1], tmp_path, lambda share, text: None)
    proof = g7.run([1, 2], tmp_path, lambda share, text: None)
    assert len(ran) == 8, "what the folder has is not scanned again"
    found = {q.name: q for q in proof.quantities}
    assert found["scans that came to their end"].value == pytest.approx(6 / 8)
    assert found["scans hindered by wood"].value == pytest.approx(2 / 8)
    assert found["linear part, largest"].met is False and found["linear part, largest"].value == 15.2
    assert found["cable, of its budget, largest"].met is False
    assert found["cable beyond half of its budget: unwound before the scan"].value == pytest.approx(4 / 6)
    assert found["from one plane to the next, median"].value == pytest.approx(6.5)
    assert found["cordon, calibrated: surface in sight with a point nearby"].value == pytest.approx(0.9)
    assert found["gobelet, as it comes, as assembled: point off the surface, median of a scan"].value is None
    assert found["a broken joint: because the distance grew"].value == 1.0
    assert "Seed 2: not calibrated, feature_lost" in proof.notes
    assert "Seed 1, cordon, as it comes: unreachable, no way" in proof.notes
    assert len(proof.figures) == 2 and proof.figures[0].svg.count("<circle") == 1
