"""Killing and resuming: how the account is judged, and one real mission that is killed twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from grape.experiments import kill_resume
from grape.experiments.kill_resume import EXPERIMENT, judged, summary, trial


def result(**changes: Any) -> dict[str, Any]:
    truth = {"hanging": ["n"], "in_feeder": 2, "on_hand": 0, "dropped": 1} | changes
    return {
        "status": "partial",
        "plants": [{"id": "n", "outcome": "deployed", "reason": ""}, {"id": "v", "outcome": "skipped", "reason": "x"}],
        "dispensers": {"loaded": 4, "deployed": 1, "left": 2, "lost": 1, "on_hand": 0},
        "truth": truth,
    }


def started(*plants: str) -> list[dict[str, Any]]:
    return [{"kind": "plant_started", "plant": plant} for plant in plants]


def test_an_account_that_agrees_is_equal() -> None:
    found = judged(result(), started("n"))
    assert found["equal"] and found["misplaced"] == 0 and found["repeated"] == []


@pytest.mark.parametrize(
    ("changes", "misplaced"),
    [({"in_feeder": 1}, 1.0), ({"dropped": 0, "in_feeder": 3}, 1.0), ({"hanging": ["v"]}, 0.0)],
)
def test_an_account_that_differs_is_told(changes: dict[str, Any], misplaced: float) -> None:
    found = judged(result(**changes), [])
    assert not found["equal"] and found["misplaced"] == misplaced


def test_a_plant_that_is_begun_again_after_its_end_is_repeated() -> None:
    finished = [{"kind": "plant_finished", "plant": "n"}]
    assert judged(result(), [*started("n", "n"), *finished])["repeated"] == []
    assert judged(result(), [*started("n"), *finished, *started("n")])["repeated"] == ["n"]


def test_a_mission_that_does_not_end_counts_against_it() -> None:
    good = {"seed": 1, "kills": [{"t": 3.0, "action": "Retract"}] * 50, "ended": True, **judged(result(), [])}
    bad = {"seed": 2, "kills": [], "ended": False}
    met = {quantity.name: quantity.met for quantity in summary([good]).quantities}
    assert all(value is not False for value in met.values())
    proof = summary([good, bad])
    rate = next(q for q in proof.quantities if q.name.startswith("resumed"))
    assert (rate.value, rate.n, rate.met) == (0.5, 2, False)
    assert "2" in proof.notes[2] and EXPERIMENT.row == "K1"


@pytest.mark.slow
def test_a_mission_that_is_killed_twice_ends_with_the_right_account(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kill_resume, "KILLS", 2)
    monkeypatch.setattr(kill_resume, "PLANTS", "plants=[{plant: r0n0, mode: nail}]")
    found = trial(3, tmp_path / "run")
    assert len(found["kills"]) == 2 and found["ended"] and found["equal"] and found["repeated"] == []
    assert found["plants"] == [["r0n0", "deployed", ""]]
