"""Killing and resuming: how the account is judged, and one real mission that is killed twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from grape.experiments import kill_resume
from grape.experiments.kill_resume import EXPERIMENT, judged, judged_kills, summary, trial


def result(**changes: Any) -> dict[str, Any]:
    places = {"feeder": 1, "hand": 0, "dropped": 1, "n": 1} | changes
    return {
        "status": "partial",
        "plants": [{"id": "n", "outcome": "deployed", "reason": ""}, {"id": "v", "outcome": "skipped", "reason": "x"}],
        "places": {"feeder": 1, "hand": 0, "lost": 1, "n": 1, "v": 0},
        "truth": {"places": places, "hanging": [plant for plant in ("n", "v") if places.get(plant)]},
    }


def started(*plants: str, t: float = 1.0) -> list[dict[str, Any]]:
    return [{"kind": "plant_started", "plant": plant, "t": t} for plant in plants]


def test_an_account_that_agrees_is_equal() -> None:
    found = judged(result(), started("n"))
    assert found["equal"] and found["misplaced"] == 0 and found["repeated"] == []
    assert found["account"] == found["truth"] == {"feeder": 1, "lost": 1, "n": 1}


@pytest.mark.parametrize(
    ("changes", "misplaced"),
    [
        ({"feeder": 0, "dropped": 2}, 1),
        ({"dropped": 0, "feeder": 2}, 1),
        ({"n": 0, "v": 1}, 1),
        ({"n": 0, "hand": 1}, 1),
    ],
)
def test_an_account_that_differs_is_told(changes: dict[str, Any], misplaced: int) -> None:
    found = judged(result(**changes), [])
    assert not found["equal"] and found["misplaced"] == misplaced


def test_a_plant_that_is_begun_again_after_its_end_is_repeated() -> None:
    finished = [{"kind": "plant_finished", "plant": "n", "t": 2.0}]
    assert judged(result(), [*started("n", "n"), *finished])["repeated"] == []
    assert judged(result(), [*started("n"), *finished, *started("n", t=3.0)])["repeated"] == ["n"]


def test_each_kill_is_judged_by_the_look_after_it() -> None:
    kills = [
        {"t": 10.0, "action": "A"},
        {"t": 20.0, "action": "B"},
        {"t": 21.0, "action": "C"},
        {"t": 50.0, "action": "D"},
    ]
    account = {"feeder": 2, "hand": 1, "lost": 0, "n": 0}
    events = [
        {"kind": "plant_finished", "plant": "n", "t": 5.0},
        {"kind": "settled", "t": 12.0, "places": account},
        {"kind": "plant_started", "plant": "n", "t": 14.0},
        {"kind": "settled", "t": 25.0, "places": account},
    ]
    seen = [
        {"check": "settled", "time_s": 12.0, "places": {"feeder": 1, "hand": 1, "dropped": 1}},
        {"check": "settled", "time_s": 25.0, "places": {"feeder": 2, "hand": 0, "dropped": 1}},
        {"check": "grasp", "time_s": 40.0, "places": {}},
    ]
    found = judged_kills(kills, events, seen)
    assert [kill["equal"] for kill in found] == [True, False, False, None], "the feeder is looked at later"
    assert [kill["repeated"] for kill in found] == [["n"], [], [], []]
    assert [kill["settled_s"] for kill in found] == [12.0, 25.0, 25.0, None]
    assert judged_kills([], events, seen) == []


def test_a_mission_that_does_not_end_counts_against_it_and_one_that_was_stopped_does_not() -> None:
    kill = {"t": 3.0, "action": "Retract", "equal": True, "repeated": [], "settled_s": 4.0}
    good = {"seed": 1, "kills": [kill] * 50, "ended": True, **judged(result(), [])}
    bad = {"seed": 2, "kills": [], "ended": False}
    stopped = {"seed": 3, "kills": [{**kill, "equal": None}], "ended": False, "stopped": True}
    met = {quantity.name: quantity.met for quantity in summary([good, stopped]).quantities}
    assert all(value is not False for value in met.values())
    proof = summary([good, bad, stopped])
    figures = {q.name: (q.value, q.n, q.met) for q in proof.quantities}
    assert figures["resumed missions whose account equals the referee's"] == (0.5, 2, False)
    assert figures["kills"] == (51, 3, True)
    assert figures["kills after which the settled account equals the referee's"] == (1.0, 50, True)
    assert "2" in proof.notes[2] and "3.0 s Retract, account right" in proof.notes[3]
    assert "3.0 s Retract, not settled yet" in proof.notes[4] and "seed 3" in proof.notes[5]
    assert EXPERIMENT.row == "K1"


@pytest.mark.slow
def test_a_mission_that_is_killed_twice_ends_with_the_right_account(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kill_resume, "KILLS", 2)
    monkeypatch.setattr(kill_resume, "SETTINGS", (*kill_resume.SETTINGS[:2], "dispensers=2"))
    monkeypatch.setattr(kill_resume, "PLANTS", "plants=[{plant: r0n0, mode: nail}]")
    found = trial(3, tmp_path / "run")
    assert len(found["kills"]) == 2 and found["ended"] and found["equal"] and found["repeated"] == []
    assert all(kill["equal"] is not False for kill in found["kills"])
    assert found["plants"] == [["r0n0", "deployed", ""]]
