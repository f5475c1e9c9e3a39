"""What the events of a mission add up to, and the robot's account held against the referee's, place by place."""

from __future__ import annotations

from typing import Any

import pytest

from grape.mission.result import lost_unnoticed, misplaced, plant_records


def action(name: str, start: float, end: float, status: str = "succeeded") -> dict[str, Any]:
    return {"kind": "action", "name": name, "start": start, "end": end, "status": status, "t": end}


def started(plant: str) -> dict[str, Any]:
    return {"kind": "plant_started", "plant": plant}


def test_a_cycle_counts_from_the_base_stop_across_an_interruption() -> None:
    before = [started("a"), action("DriveToPlant", 0.0, 12.0), action("CheckFeeder", 12.0, 14.0)]
    after = [
        {"kind": "mission_resumed"},
        action("Retract", 30.0, 33.0),
        started("a"),
        action("DriveToPlant", 33.0, 33.01),
    ]
    end = [action("HangDispenser", 40.0, 44.0), action("Retract", 44.0, 50.0)]
    records = plant_records([*before, *after, *end])
    assert records["a"].cycle_s == pytest.approx(38.0)


def test_a_second_stop_begins_the_cycle_anew() -> None:
    events = [
        started("a"), action("DriveToPlant", 0.0, 12.0), action("Retract", 20.0, 22.0),
        action("DriveToPlant", 22.0, 25.0), action("Retract", 60.0, 65.0),
    ]  # fmt: skip
    assert plant_records(events)["a"].cycle_s == pytest.approx(40.0)


def result(account: dict[str, int], seen: dict[str, int]) -> dict[str, Any]:
    return {"places": account, "truth": {"places": seen, "dropped": seen.get("dropped", 0)}}


@pytest.mark.parametrize(
    ("account", "seen", "unnoticed"),
    [
        ({"feeder": 5, "hand": 0, "lost": 1, "a": 1}, {"feeder": 5, "hand": 0, "dropped": 1, "a": 1}, 0),
        ({"feeder": 5, "hand": 1, "lost": 0}, {"feeder": 5, "hand": 0, "dropped": 1}, 1),
        # One is believed lost that hangs, one on the ground is believed to hang: the sums agree, the places do not.
        ({"feeder": 4, "lost": 1, "a": 1, "b": 0}, {"feeder": 4, "dropped": 1, "a": 0, "b": 1}, 1),
        ({"feeder": 4, "hand": 1, "a": 1}, {"feeder": 5, "dropped": 0, "a": 1}, 0),
        ({"feeder": 6, "lost": 0}, {"feeder": 4, "dropped": 2}, 2),
    ],
)
def test_dispensers_on_the_ground_that_are_counted_elsewhere(
    account: dict[str, int], seen: dict[str, int], unnoticed: int
) -> None:
    assert lost_unnoticed(result(account, seen)) == unnoticed


def test_without_a_referee_nothing_is_known_to_be_lost() -> None:
    assert lost_unnoticed({"places": {"feeder": 8}, "truth": None}) == 0
    old = {"dispensers": {"lost": 1}, "truth": {"dropped": 3}}
    assert lost_unnoticed(old) == 2, "results of earlier versions have numbers alone"


def test_what_is_misplaced_is_told_by_place() -> None:
    assert misplaced({"feeder": 3, "hand": 1, "a": 0}, {"feeder": 2, "a": 2}) == {"feeder": 1, "hand": 1}
