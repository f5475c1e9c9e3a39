"""The real thing for a few seconds: simulation, drivers, tree and run folder together."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from grape.mission.file import load_mission
from grape.mission.launch import MissionRun, run_mission
from grape.mission.ledger import SqliteLedger
from grape.mission.result import without_wall_clock

SECONDS = 3.0
SMALL = ["world.rows=1", "world.vines_per_row=5", "plants=[{plant: r0v1, mode: plant}]"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[MissionRun]:
    os.environ.setdefault("MUJOCO_GL", "egl")
    mission = load_mission("dispenser_deployment", [*SMALL, f"time_limit_s={SECONDS}", "seed=3"])
    folder = tmp_path_factory.mktemp("runs")
    return [run_mission(mission, folder / name) for name in ("one", "two")]


def test_a_mission_that_runs_out_of_time_ends_with_a_complete_folder(runs: list[MissionRun]) -> None:
    run = runs[0]
    names = {path.name for path in run.folder.iterdir()}
    assert names >= {
        "result.json", "report.html", "events.jsonl", "ledger.sqlite", "mission.yaml", "site.geojson", "tree.xml",
        "path.csv",
    }  # fmt: skip
    assert (run.result["status"], run.result["ended_by"]) == ("failed", "time_limit")
    assert run.result["sim_time_s"] == pytest.approx(SECONDS)
    assert SqliteLedger.open(run.folder / "ledger.sqlite").account() == run.result["dispensers"]


def test_the_robot_knows_where_it_is_and_harms_nothing(runs: list[MissionRun]) -> None:
    result = runs[0].result
    assert result["localization"]["position_rmse_m"] < 0.10
    assert result["truth"]["in_feeder"] == 8
    assert result["truth"]["fence_crossings"] == 0
    assert result["navigation"]["distance_m"] > 0.0, "it sets out"


def test_the_same_seed_twice_gives_the_same_run(runs: list[MissionRun]) -> None:
    first, second = runs
    assert without_wall_clock(first.result) == without_wall_clock(second.result)
    for name in ("events.jsonl", "path.csv", "mission.yaml", "site.geojson"):
        assert (first.folder / name).read_bytes() == (second.folder / name).read_bytes(), name


def test_ctrl_c_stops_the_robot_and_completes_the_folder(tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = [sys.executable, "-c", "from grape.cli import main; main()", "run", "--out", str(out)]
    for assignment in SMALL:
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
