"""`grape map` and `grape localize`: a log goes in, a map, a way and its errors come out."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from building import building, carmen_text, drifting, laser_scans, way_round

from grape import cli
from grape.mapping import MapFormat, load_map, save_map

ROUND = 0.15  # of the way round the building: enough to drift, quick to match


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(5)
    true = way_round(ROUND, 0.3)
    path = tmp_path_factory.mktemp("logs") / "house.log"
    path.write_text(carmen_text(laser_scans(building(), true, rng), drifting(true, rng, bias=0.02), true))
    return path


def grape(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *arguments: str) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "argv", ["grape", *arguments])
    with pytest.raises(SystemExit) as end:
        cli.main()
    captured = capsys.readouterr()
    return int(end.value.code or 0), captured.out, captured.err


def test_a_log_becomes_a_map(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, err = grape(capsys, monkeypatch, "map", str(log), "--out", str(tmp_path / "m"))
    assert (code, err) == (0, "")
    result = json.loads((tmp_path / "m" / "map.json").read_text())
    assert result["schema"] == "grape.map/1" and result["errors"]["position_rmse"] < 0.1
    assert result["errors"]["position_rmse"] < result["odometry_errors"]["position_rmse"]
    assert "with corrected poses" in out and "root mean square" in out
    assert load_map(tmp_path / "m" / "map.yaml").occupied().sum() == result["occupied_cells"] > 100
    assert (tmp_path / "m" / "map.png").stat().st_size > 0
    lines = (tmp_path / "m" / "path.csv").read_text().splitlines()
    assert lines[0] == "t,x,y,yaw" and len(lines) == 1 + result["scans"]


def test_a_log_is_localised_on_the_building(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    save_map(building(), tmp_path / "house.yaml", MapFormat())
    where = ("--start", "1.3,1.1,0.05", "--seed", "3", "--out", str(tmp_path / "l"))
    code, out, err = grape(capsys, monkeypatch, "localize", str(log), "--map", str(tmp_path / "house.yaml"), *where)
    assert (code, err) == (0, "")
    result = json.loads((tmp_path / "l" / "localize.json").read_text())
    assert result["errors_in_the_map"]["position_rmse"] < 0.15
    assert "sure of its place" in out and (tmp_path / "l" / "localize.png").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["map", "gone.log"], "gone.log: cannot be read"),
        (["map", "bad.log"], "bad.log:1:8: FLASER: got 'x'"),
        (["map", "house.log", "--poses", "true"], "allowed: slam, odometry, corrected"),
        (["map", "plain.log", "--poses", "corrected"], "has no corrected poses"),
        (["map", "house.log", "--laser", "RLASER"], "no scans of RLASER"),
        (["map", "house.log", "--resolution", "0"], "--resolution from 0.005"),
        (["localize", "house.log"], "Missing option '--map'"),
        (["localize", "house.log", "--map", "gone.yaml"], "gone.yaml: cannot be read"),
        (["localize", "house.log", "--map", "gone.yaml", "--start", "1,2"], "allowed: X,Y,YAW"),
    ],
)
def test_wrong_input_exits_with_1(
    log: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "house.log").write_bytes(log.read_bytes())
    (tmp_path / "bad.log").write_text("FLASER x\n")
    (tmp_path / "plain.log").write_text("FLASER 1 1 0 0 0 0 0 0 1 host 1\n")
    code, out, err = grape(capsys, monkeypatch, *arguments)
    assert code == 1 and expected in err and "Traceback" not in out + err
    assert not (tmp_path / "runs").exists(), "nothing half-written"
