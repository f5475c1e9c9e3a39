"""Damaged results and events are refused by name, whatever is wrong; those that are read lead to figures and a page."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from paper_campaign import write_run

from grape.campaign.command import read_campaign
from grape.campaign.plan import Job, make_jobs, make_plan
from grape.campaign.report import campaign_page
from grape.errors import FileError
from grape.mission.display import summary
from grape.mission.result_file import read_result

PLAN = make_plan("dispenser_deployment", [], [])


@pytest.fixture
def job(tmp_path: Path) -> Job:
    """A mission that has run, with a plant that failed and a dispenser on the ground."""
    (job,) = make_jobs(PLAN, [3], tmp_path)
    failures = (("r0v1", "DriveToPlant", "blocked", 12.0),)
    write_run(job, outcomes={"r0v1": "blocked"}, hanging=("r0n0",), failures=failures, levels=((1, 1),), dropped=1)
    return job


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path of everything inside a JSON value."""
    for key in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield (*at, key)
        yield from places(value[key], (*at, key))


def damaged(whole: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The result with each thing in it gone, or something else in its place."""
    for *above, last in places(whole):
        for wrong in ("gone", None, []):
            broken = copy.deepcopy(whole)
            at: Any = broken
            for key in above:
                at = at[key]
            if wrong == "gone":
                del at[last]
            else:
                at[last] = wrong
            yield f"{[*above, last]} {wrong}", broken


def test_a_result_is_read_to_the_end_or_refused_by_name(job: Job, tmp_path: Path) -> None:
    path = job.folder / "result.json"
    read = refused = 0
    for what, content in damaged(json.loads(path.read_text())):
        path.write_text(json.dumps(content))
        try:
            summary(read_result(path))
            read_campaign(PLAN, range(3, 4), tmp_path)
            read += 1
        except FileError as error:
            assert str(error).startswith(f"{path}: "), what
            refused += 1
    assert read > 20 and refused > 100


def test_a_result_without_plants_is_read_to_the_end(job: Job, tmp_path: Path) -> None:
    path = job.folder / "result.json"
    content = json.loads(path.read_text())
    content["plants"], content["places"] = [], {"feeder": 7}
    path.write_text(json.dumps(content))
    (failure,) = read_campaign(PLAN, range(3, 4), tmp_path).summary["failures"]
    assert (failure["reason"], failure["picture"]) == ("lost unnoticed", "")


def test_events_are_read_to_the_end_or_refused_by_line(job: Job, tmp_path: Path) -> None:
    path = job.folder / "events.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    lines += [
        {"t": 99.0, "kind": "crash", "name": "Retract", "error": "KeyError: 'x'"},
        {"t": 99.5, "kind": "a task's own"},
    ]
    read = refused = 0
    for number in range(len(lines)):
        for what, line in damaged(lines[number]):
            told = [*lines[:number], line, *lines[number + 1 :]]
            path.write_text("".join(json.dumps(event) + "\n" for event in told))
            try:
                campaign_page(read_campaign(PLAN, range(3, 4), tmp_path).summary, [], tmp_path)
                read += 1
            except FileError as error:
                assert str(error).startswith(f"{path}:{number + 1}: "), what
                refused += 1
    assert read > 5 and refused > 50


def test_what_is_wrong_deep_inside_is_named_with_its_place(job: Job) -> None:
    path = job.folder / "result.json"
    content = json.loads(path.read_text())
    del content["plants"][1]["phases_s"]
    content["truth"]["plants"]["r0v1"]["hanging"] = "yes"
    path.write_text(json.dumps(content))
    with pytest.raises(FileError) as error:
        read_result(path)
    assert [problem.path for problem in error.value.problems] == ["plants.1.phases_s", "truth.plants.r0v1.hanging"]


def test_a_robot_without_a_referee_has_a_result(job: Job, tmp_path: Path) -> None:
    path = job.folder / "result.json"
    content = json.loads(path.read_text()) | {"truth": None}
    path.write_text(json.dumps(content))
    assert read_result(path)["truth"] is None and read_campaign(PLAN, range(3, 4), tmp_path).summary["missions"] == 1
