"""Growers' names of plants, from the site file to the report."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from paper_names import NAMES, with_names
from rich.console import Console

from grape.actions.core import Context, Outcome, Status
from grape.errors import FileError
from grape.mission.display import ProgressDisplay, summary
from grape.mission.file import Mission, load_mission
from grape.mission.launch import finish
from grape.mission.ledger import SqliteLedger
from grape.mission.progress import Progress
from grape.site import save_site, site_to_geojson


@pytest.fixture
def site_file(tmp_path: Path) -> Path:
    """The default site with growers' names."""
    path = tmp_path / "names.geojson"
    save_site(with_names(load_mission("dispenser_deployment").site), path)
    return path


@pytest.fixture
def mission(site_file: Path) -> Mission:
    """A mission that serves every plant with such a name."""
    plants = json.dumps([{"plant": name} for name in NAMES], ensure_ascii=False)
    return load_mission("dispenser_deployment", [f"plants={plants}"], site_file)


@pytest.fixture
def folder(make_runner: Callable[..., Any], backend: Any, mission: Mission, tmp_path: Path, serve: Any) -> Path:
    """The folder of a run that has served the first three plants and keeps a picture called as each of them."""

    def script(context: Context, ticks: int) -> Status | None:
        for name in NAMES[:3]:
            serve(context, name, Outcome.DEPLOYED)
            context.log.picture(name, np.full((48, 64, 3), 90, np.uint8))
            corners = [[100, 100], [200, 100]]
            context.log.event("servo_sample", action="ServoToSpur", error_px=3.0, corners=corners, desired=[[130, 100]])
        return Status.SUCCEEDED

    path = tmp_path / "run"
    path.mkdir()
    runner, _ = make_runner(script, folder=path)
    finish(mission, runner, backend, path)
    return path


def shown(renderable: Any) -> str:
    console = Console(file=io.StringIO(), width=400)
    console.print(renderable)
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_plants_are_selected_whatever_they_are_called(site_file: Path) -> None:
    mission = load_mission("dispenser_deployment", ["plants=null", "select={vines: 16}"], site_file)
    assert set(NAMES) & {plant.plant for plant in mission.plants}


def test_plants_are_named_as_in_the_site(mission: Mission, site_file: Path) -> None:
    assert [plant.plant for plant in mission.plants] == [*NAMES]
    for wrong in ("Muller 12", "", "feeder", "x" * 81):
        with pytest.raises(FileError, match="the site has no"):
            load_mission("dispenser_deployment", [f"plants=[{{plant: '{wrong}'}}]"], site_file)


def test_a_mission_that_is_kept_has_the_same_names(mission: Mission, folder: Path) -> None:
    kept = load_mission(str(folder / "mission.yaml"))
    assert kept.plants == mission.plants
    assert site_to_geojson(kept.site) == site_to_geojson(mission.site)


def test_result_ledger_and_events_have_the_names(folder: Path) -> None:
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    assert [plant["id"] for plant in result["plants"]] == [*NAMES]
    assert [plant["outcome"] for plant in result["plants"]][:4] == ["deployed", "deployed", "deployed", "skipped"]
    ledger = SqliteLedger.open(folder / "ledger.sqlite")
    assert [plant.plant for plant in ledger.plants()] == [*NAMES]
    assert ledger.account()["deployed"] == 3
    ledger.close()


def test_pictures_stay_in_their_folder(folder: Path) -> None:
    names = [path.name for path in sorted((folder / "pictures").iterdir())]
    assert names == ["001_Müller_12.png", "002__b_x.png", "003__red_y.png"]


def test_the_report_shows_the_names_and_takes_none_for_html(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert all(escape(name) in page for name in NAMES)
    assert "<b>x" not in page
    for drawing in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        ElementTree.fromstring(drawing)


def test_the_summary_prints_names_and_sentences_as_they_are(folder: Path) -> None:
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    text = shown(summary(result | {"detail": "NextTarget: every deployment pose of [/b] was tried"}))
    assert all(name in text for name in NAMES)
    assert "every deployment pose of [/b] was tried" in text


@pytest.mark.parametrize("terminal", [True, False])
def test_progress_shows_names_as_they_are(terminal: bool) -> None:
    for name in NAMES:
        console = Console(file=io.StringIO(), width=250, force_terminal=terminal)
        with ProgressDisplay(console) as display:
            display.show(Progress(phase="Retract", plant=name, done=1, plants=4, sim_time_s=5.0, wall_time_s=9.0))
        assert name in console.file.getvalue()  # type: ignore[attr-defined]
