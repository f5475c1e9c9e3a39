"""The real thing: simulation, drivers, tree and run folder together, for a few seconds and for one whole plant."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grape.mission.file import load_mission
from grape.mission.launch import MissionRun, resume_mission, run_mission
from grape.mission.ledger import SqliteLedger
from grape.mission.record import read_events
from grape.mission.result import without_wall_clock
from grape.navigation.route import park_beside
from grape.sim.worlds import VineyardOptions, vineyard_site
from grape.site import save_site

SECONDS = 9.0
ROW = ["world.rows=1", "world.vines_per_row=2"]
NAIL = "plants=[{plant: r0n0, mode: nail}]"


@pytest.fixture(scope="module")
def short_way(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Settings of a mission on one nail that starts 0.75 m before the stop beside it."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    site = vineyard_site(VineyardOptions(rows=1, vines_per_row=2))
    x, y, yaw = park_beside(site, "r0n0", "fore")
    path = tmp_path_factory.mktemp("site") / "site.geojson"
    save_site(replace(site, start=np.array([x - 0.75, y - 0.1]), start_heading_rad=yaw), path)
    return [*ROW, NAIL, f"site={path}", "seed=3", "actions={CalibrateArm: {skip: true}}"]


@pytest.fixture(scope="module")
def runs(short_way: list[str], tmp_path_factory: pytest.TempPathFactory) -> list[MissionRun]:
    """The first seconds twice: driving, then servoing over the feeder."""
    mission = load_mission("dispenser_deployment", [*short_way, f"time_limit_s={SECONDS}"])
    folder = tmp_path_factory.mktemp("runs")
    return [run_mission(mission, folder / name) for name in ("one", "two")]


def kinds(run: MissionRun) -> Counter[str]:
    return Counter(event["kind"] for event in read_events(run.folder / "events.jsonl"))


def test_a_mission_that_runs_out_of_time_ends_with_a_complete_folder(runs: list[MissionRun]) -> None:
    run = runs[0]
    names = {path.name for path in run.folder.iterdir()}
    assert names >= {
        "result.json", "report.html", "events.jsonl", "ledger.sqlite", "mission.yaml", "site.geojson", "tree.xml",
        "path.csv", "drive.jsonl", "standing.csv",
    }  # fmt: skip
    assert (run.result["status"], run.result["ended_by"]) == ("failed", "time_limit")
    assert run.result["sim_time_s"] == pytest.approx(SECONDS)
    assert SqliteLedger.open(run.folder / "ledger.sqlite").account() == run.result["dispensers"]


def test_the_robot_knows_where_it_is_and_harms_nothing(runs: list[MissionRun]) -> None:
    result = runs[0].result
    assert result["localization"]["position_rmse_m"] < 0.10
    assert result["truth"]["in_feeder"] + result["truth"]["on_hand"] == 8
    assert result["truth"]["fence_crossings"] == 0
    assert result["navigation"]["distance_m"] > 0.3, "it drove"
    assert kinds(runs[0])["servo_sample"] > 5, "it looked at the feeder's markers"


def test_the_same_seed_twice_gives_the_same_run(runs: list[MissionRun]) -> None:
    first, second = runs
    assert without_wall_clock(first.result) == without_wall_clock(second.result)
    for name in ("events.jsonl", "drive.jsonl", "path.csv", "standing.csv", "mission.yaml", "site.geojson"):
        assert (first.folder / name).read_bytes() == (second.folder / name).read_bytes(), name


def test_ctrl_c_stops_the_robot_and_completes_the_folder(tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = [sys.executable, "-c", "from grape.cli import main; main()", "run", "--out", str(out)]
    for assignment in (*ROW, NAIL):
        command += ["--set", assignment]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    deadline = time.monotonic() + 90
    while not (out / "events.jsonl").exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    text, _ = process.communicate(timeout=90)
    assert process.returncode == 130, text
    result = json.loads((out / "result.json").read_text())
    assert result["status"] == "aborted"
    assert (out / "report.html").exists() and "Traceback" not in text


def test_an_aborted_mission_goes_on_where_it_was(short_way: list[str], tmp_path: Path) -> None:
    def after(beats: int) -> Callable[[], bool]:
        left = iter(range(beats))
        return lambda: next(left, None) is None

    mission = load_mission("dispenser_deployment", short_way)
    first = run_mission(mission, tmp_path / "run", cancelled=after(250)).result
    assert (first["status"], first["sessions"]) == ("aborted", 1)
    done = resume_mission(tmp_path / "run", cancelled=after(150))
    result = done.result
    assert (result["status"], result["sessions"]) == ("aborted", 2)
    assert result["sim_time_s"] == pytest.approx(2.5 + 1.0 + 1.0 + 1.5), "stopping, and a second unattended, count"
    assert result["navigation"]["distance_m"] >= first["navigation"]["distance_m"] > 0.1
    assert result["wall_time_s"] > first["wall_time_s"]
    events = list(read_events(done.folder / "events.jsonl"))
    settled = next(event for event in events if event["kind"] == "settled")
    assert (settled["step"], settled["hangs"], settled["holds"]) == ("drive", False, False)
    assert result["localization"]["max_error_m"] < 0.2 and result["truth"]["in_feeder"] == 8


@pytest.mark.slow
def test_a_dispenser_is_hung_on_a_nail_and_the_robot_knows(short_way: list[str], tmp_path: Path) -> None:
    run = run_mission(load_mission("dispenser_deployment", short_way), tmp_path / "run")
    result, truth = run.result, run.result["truth"]
    (plant,) = result["plants"]
    assert (result["status"], plant["outcome"], plant["reason"]) == ("succeeded", "deployed", "")
    assert truth["hanging"] == ["r0n0"] and truth["plants"]["r0n0"]["hanging"]
    assert result["dispensers"] == {"loaded": 8, "deployed": 1, "left": 7, "lost": 0, "on_hand": 0}
    assert (truth["in_feeder"], truth["on_hand"], truth["dropped"]) == (7, 0, 0), "the account agrees with the referee"
    assert truth["collisions"] == [] and truth["fence_crossings"] == 0
    assert plant["attempts"] == 1 and 10.0 < plant["cycle_s"] < 150.0
    assert plant["servo"]["error_px"] < 1.0
    assert result["localization"]["position_rmse_m"] < 0.10
    pictures = {path.stem for path in (run.folder / "pictures").iterdir()}
    assert any("grasp" in name for name in pictures) and any("deployment" in name for name in pictures)
