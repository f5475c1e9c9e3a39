"""What servo experiments share: starts, trials that go on where they stopped, figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grape.experiments.servo_trials import (
    START_M,
    START_RAD,
    Key,
    convergence_figures,
    marker_quantities,
    moved_start,
    run_trials,
)
from grape.geometry import pose_error


def trial(converged: bool = True, error: float = 0.5, looked: int = 0) -> dict[str, Any]:
    samples = [
        {"kind": "servo_sample", "action": "A", "t": 0.1 * k, "error_px": 10.0 / (k + 1), "ids": [1],
         "corners": [[300.0 - k, 200.0]], "desired": [[280.0, 200.0]]}
        for k in range(9)
    ]  # fmt: skip
    return {
        "converged": converged, "error_px": error, "hand_mm": error, "point_mm": error, "arm_off_mm": 20.0,
        "duration_s": 8.0, "looked_around": looked, "reason": "", "events": samples,
    }  # fmt: skip


def test_starts_are_within_5_cm_and_10_degrees() -> None:
    rng = np.random.default_rng(0)
    errors = np.array([pose_error(moved_start(rng, np.eye(4)), np.eye(4)) for _ in range(300)])
    way, turn = np.linalg.norm(errors[:, :3], axis=1), np.linalg.norm(errors[:, 3:], axis=1)
    assert 0.9 * START_M < way.max() <= START_M and 0.9 * START_RAD < turn.max() <= START_RAD + 1e-9


def test_errors_are_those_of_the_runs_that_converged() -> None:
    found = {q.name: q for q in marker_quantities([trial(), trial(error=0.7), trial(False, 90.0, 1)], "figure")}
    assert found["converged"].value == pytest.approx(2 / 3)
    assert (
        found["corner error, 95th percentile"].value == pytest.approx(0.69)
        and found["corner error, 95th percentile"].n == 2
    )
    assert found["hand position error, 95th percentile"].met is True
    assert found["began out of view and looked around"].value == pytest.approx(1 / 3)


def test_the_plots_show_paths_and_errors_over_iterations() -> None:
    paths, errors = convergence_figures([trial() | {"seed": seed} for seed in (3, 4)], "Nail")
    assert "<polyline" in paths.svg and "iteration" in errors.svg and "2 runs" in errors.title
    assert convergence_figures([trial() | {"events": []}], "Nail") == ()


def test_trials_that_were_run_are_not_run_again(tmp_path: Path) -> None:
    ran: list[Key] = []

    def run(key: Key) -> dict[str, Any]:
        ran.append(key)
        if key.seed == 2 and len(ran) == 3:
            raise KeyboardInterrupt
        return trial()

    keys = [Key(case="a", seed=seed) for seed in range(4)]
    with pytest.raises(KeyboardInterrupt):
        run_trials(tmp_path, keys, run, lambda share, text: None)
    assert len(run_trials(tmp_path, keys, run, lambda share, text: None)) == 4
    assert [key.seed for key in ran] == [0, 1, 2, 2, 3]
