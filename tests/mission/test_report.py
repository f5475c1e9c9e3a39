"""The report: one page that holds everything and needs nothing else."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from grape.actions.core import Context, Outcome, Status
from grape.mission.file import Mission
from grape.mission.launch import finish
from grape.mission.report import write_report
from grape.mission.report_servo import servo_runs
from grape.mission.svg import line_chart, ticks


@pytest.fixture
def page(
    make_runner: Callable[..., Any], backend: Any, mission: Mission, serve: Callable[..., None], tmp_path: Path
) -> str:
    def script(context: Context, ticks: int) -> Status | None:
        if ticks == 2:
            serve(context, "r0v1", Outcome.DEPLOYED)
            context.log.picture("deployment", np.full((48, 64, 3), 90, np.uint8))
            context.log.event("plant_started", plant="r0n0", mode="nail")
        if 3 <= ticks < 30:
            corners = [[100 + ticks, 100], [200 + ticks, 100]]
            context.log.event(
                "servo_sample", action="ServoToNail", error_px=30.0 - ticks, corners=corners, desired=[[130, 100]]
            )
        if ticks == 30:
            context.log.event("servo", action="ServoToNail", error_px=1.0, iterations=27, converged=True)
            context.log.event(
                "action", name="CheckGrasp", status="aborted", reason="grasp_failed", detail="a < b & c", start=0, end=0
            )
            return Status.SUCCEEDED
        return None

    runner, _ = make_runner(script)
    finish(mission, runner, backend, tmp_path)
    return (tmp_path / "report.html").read_text()


def test_the_page_needs_no_other_file(page: str) -> None:
    assert re.findall(r'(?:src|href)="(?!data:)[^"#][^"]*"', page) == []
    assert "http" not in page.replace("http://www.w3.org/2000/svg", "")


def test_the_page_shows_plants_reasons_pictures_servo_runs_and_failures(page: str) -> None:
    for text in (
        "r0v1",
        "deployed",
        "not served",
        "data:image/jpeg;base64,",
        "ServoToNail",
        "converged",
        "grasp_failed",
    ):
        assert text in page
    assert "a &lt; b &amp; c" in page
    assert "link_5" in page, "collisions"


def test_a_film_plays_beside_the_map(page: str, tmp_path: Path) -> None:
    assert '<img id="drive-film"' not in page
    (tmp_path / "render").mkdir()
    for second in (0, 1):
        (tmp_path / "render" / f"{second:07.1f}s.jpg").write_bytes(b"jpeg")
    (tmp_path / "render" / "sheet.jpg").write_bytes(b"jpeg")
    write_report(tmp_path)
    filmed = (tmp_path / "report.html").read_text()
    assert re.findall(r'<img id="drive-film"[^>]* src="([^"]*)"', filmed) == ["render/00000.0s.jpg"]
    assert drive_data(filmed)["film"] == [[0.0, "render/00000.0s.jpg"], [1.0, "render/00001.0s.jpg"]]


def test_every_drawing_is_well_formed(page: str) -> None:
    drawings = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert len(drawings) >= 5
    for drawing in drawings:
        ElementTree.fromstring(drawing)
    assert "nan" not in "".join(drawings)


def drive_data(page: str) -> dict[str, Any]:
    (text,) = re.findall(r'<script type="application/json" id="drive-data">(.*?)</script>', page)
    data: dict[str, Any] = json.loads(text)
    return data


def test_the_page_moves_through_the_drive_with_every_estimate(page: str, tmp_path: Path) -> None:
    lines = [
        {"t": 0.1, "kind": "estimate", "source": "wheels", "pose": [1.0, 2.0, 0.1]},
        {"t": 0.1, "kind": "estimate", "source": "amcl</script>", "pose": [1.0, 2.0, 0.1]},
        {"t": 0.1, "kind": "plan", "points": [[0.0, 0.0], [1.0, 0.0]]},
        {"t": 0.1, "kind": "obstacles", "added": [[0, 0], [40, 0]], "gone": []},
        {"t": 0.1, "kind": "scan", "pose": [0, 0, 0], "points_cm": "ZAA4/w=="},
    ]
    with (tmp_path / "drive.jsonl").open("a") as file:
        file.writelines(json.dumps(line) + "\n" for line in lines)
    write_report(tmp_path)
    page = (tmp_path / "report.html").read_text()
    data = drive_data(page)
    assert data["path"] and data["fixes"] and set(data["estimates"]) == {"wheels", "amcl</script>"}
    assert (data["plans"], data["scans"]) == ([[0.1, [[0.0, 0.0], [1.0, 0.0]]]], [[0.1, [0, 0, 0], "ZAA4/w=="]])
    layers = re.findall(r'data-layer="([^"]*)"', page)
    assert {"truth", "ekf", "wheels", "gnss", "plan", "costmap", "scan"} <= set(layers)
    assert 'type="range"' in page and "wheels only</td>" in page
    assert "2 cells of 10 cm in which an obstacle was seen at some time; 50 % of them" in page


def test_a_run_without_a_record_of_its_drives_still_has_its_path(page: str, tmp_path: Path) -> None:
    for name in ("drive.jsonl", "standing.csv"):
        (tmp_path / name).unlink()
    write_report(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert drive_data(page)["estimates"] == {} and 'data-layer="ekf"' in page and 'data-layer="scan"' not in page
    assert "no obstacles were recorded" in page


def test_servo_runs_are_told_apart_by_their_end_and_by_pauses() -> None:
    def sample(t: float) -> dict[str, Any]:
        return {
            "t": t,
            "kind": "servo_sample",
            "action": "A",
            "error_px": 1.0,
            "corners": [[0, 0]],
            "desired": [[1, 1]],
        }

    events = [sample(0.0), sample(0.1), {"t": 0.2, "kind": "servo", "error_px": 1.0}, sample(0.3), sample(9.0)]
    assert [len(run.times) for run in servo_runs(events)] == [2, 1, 1]


def test_a_marker_that_comes_into_view_later_has_a_path_of_its_own() -> None:
    def sample(t: float, ids: list[int], corners: list[list[float]]) -> dict[str, Any]:
        return {"t": t, "kind": "servo_sample", "action": "A", "error_px": 1.0, "ids": ids, "corners": corners}

    events = [
        sample(0.0, [2], [[8, 8], [9, 9]]),
        sample(0.1, [1, 2], [[1, 1], [2, 2], [7, 7], [8, 8]]),
        sample(0.2, [], []),
        sample(0.3, [1], [[3, 3], [4, 4]]),
    ]
    (run,) = servo_runs(events)
    assert run.paths == {
        (2, 0): [[8, 8], [7, 7]], (2, 1): [[9, 9], [8, 8]], (1, 0): [[1, 1], [3, 3]], (1, 1): [[2, 2], [4, 4]],
    }  # fmt: skip


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-3.2, 9.7), (0.0, 1e-6), (5.0, 5.0), (0.0, 123456.0)])
def test_ticks_are_round_few_and_inside(low: float, high: float) -> None:
    values = ticks(low, high)
    assert len(values) <= 7
    assert all(low - 1e-9 <= value <= high + 1e-9 for value in values)


def test_a_chart_without_points_says_so() -> None:
    assert "no data" in line_chart([("a", [], "red")], x_title="x", y_title="y")


def test_the_page_counts_every_dispenser_that_the_referee_saw_on_a_plant(page: str, tmp_path: Path) -> None:
    result = json.loads((tmp_path / "result.json").read_text())
    result["truth"]["places"]["r0v1"] = 2
    for plant, cycle in zip(result["plants"], (10.0, 30.0), strict=False):
        plant["cycle_s"] = cycle
    (tmp_path / "result.json").write_text(json.dumps(result))
    write_report(tmp_path)
    page = (tmp_path / "report.html").read_text()
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", page[page.index("<td>referee</td>") :])[:6]
    assert cells == ["referee", "9", "2", "7", "0", "0"]
    assert "20 s" in page[: page.index("median cycle")], "between both"


def test_the_map_shows_where_the_feeder_is_refilled(page: str) -> None:
    assert "refill point refill" in page and ">refill</text>" in page
