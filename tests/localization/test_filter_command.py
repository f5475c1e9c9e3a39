from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from grape.errors import FileError, GrapeError
from grape.localization import components
from grape.localization.filter_command import filter_command
from grape.localization.filter_file import load_filter
from grape.localization.filter_log import FilterLog

CONFIG = """\
rate: 10
datum: {latitude: 43.5, longitude: 10.6}
sensors:
  wheels: {components: [vx, wz], std: {vx: 0.02, wz: 0.02}, effective_track: 1.0}
  compass: {components: [yaw], std: {yaw: 0.02}}
  gnss: {components: [x, y], std: {x: 0.02, y: 0.02}, pose_gate: 5}
"""
HEADER = "t,sensor,left,right,yaw,lat,lon,status\n"
STRAIGHT = HEADER + "".join(
    f"{0.1 * k:.1f},wheels,0.5,0.5,,,,\n"
    + f"{0.1 * k:.1f},compass,,,0.0,,,\n"
    + (f"{0.1 * k:.1f},gnss,,,,43.5,{10.6 + 0.05 * k / 80_870:.12f},fix\n" if k % 10 == 0 else "")
    for k in range(51)
)


@pytest.fixture
def files(tmp_path: Path):
    def write(log: str = STRAIGHT, config: str = CONFIG, name: str = "log.csv") -> tuple[Path, Path]:
        (tmp_path / name).write_text(log)
        (tmp_path / "filter.yaml").write_text(config)
        return tmp_path / name, tmp_path / "filter.yaml"

    return write


def problems(log: Path, **tracks: float | None) -> list[tuple[int, str]]:
    """Line and key of each problem of a log."""
    with pytest.raises(FileError) as refused:
        list(FilterLog(log, tracks or {"wheels": 1.0}).readings())
    return [(p.line, p.path) for p in refused.value.problems]


def test_recorded_data_give_the_estimate_on_a_grid_of_times(files, tmp_path):
    log, config = files()
    lines = filter_command(log, config, None)
    rows = list(csv.DictReader((tmp_path / "log.estimate.csv").open()))
    assert len(rows) == 51
    assert [float(r["t"]) for r in rows] == pytest.approx([0.1 * k for k in range(51)])
    assert float(rows[-1]["x"]) == pytest.approx(2.5, abs=0.05)
    assert float(rows[-1]["lat"]) == pytest.approx(43.5, abs=1e-6)
    assert any("51 accepted" in line and "wheels" in line for line in lines)


def test_json_lines_say_the_same_as_the_table(files, tmp_path):
    log, config = files()
    filter_command(log, config, tmp_path / "a.jsonl")
    names = HEADER.strip().split(",")
    rows = [dict(zip(names, line.split(","), strict=True)) for line in STRAIGHT.splitlines()[1:]]
    objects = [{k: v if k in ("sensor", "status") else float(v) for k, v in row.items() if v} for row in rows]
    other, _ = files("\n".join(json.dumps(o) for o in objects), name="log.jsonl")
    filter_command(other, config, tmp_path / "b.jsonl")
    assert (tmp_path / "a.jsonl").read_text() == (tmp_path / "b.jsonl").read_text()


def test_cascade_writes_map_odom_too(files, tmp_path):
    log, config = files(config=CONFIG + "cascade: {local: [wheels]}\n")
    filter_command(log, config, None)
    last = list(csv.DictReader((tmp_path / "log.estimate.csv").open()))[-1]
    assert abs(float(last["map_odom_x"])) < 0.1 and abs(float(last["map_odom_yaw"])) < 0.1


def test_wrong_lines_are_all_named_and_nothing_is_written(files, tmp_path):
    text = HEADER + "0.0,wheels,a,0.5,,,,\n0.1,weels,0.5,0.5,,,,\n0.2,wheels,0.5\n0.3,gnss,,,,43.5,10.6,fixed\n"
    log, config = files(text + "0.4,wheels,0.5,,,,,\n,wheels,0.5,0.5,,,,\n0.5,gnss,,,,43.5,,\n")
    with pytest.raises(FileError) as refused:
        filter_command(log, config, None)
    found = [(p.line, p.path) for p in refused.value.problems]
    assert found == [(2, "left"), (3, "sensor"), (4, ""), (5, "status"), (6, ""), (7, "t"), (8, "")]
    assert "did you mean 'wheels'?" in str(refused.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["filter.yaml", "log.csv"]


def test_wrong_headers_objects_and_files(files, tmp_path):
    assert problems(files("t,sensor,vxx\n")[0]) == [(1, "vxx")]
    assert problems(files("sensor,vx,vx\n")[0]) == [(1, "t"), (1, "vx")]
    assert problems(
        files('{"t": 0, "sensor": "wheels"\n[1]\n{"t": 0, "sensor": "wheels", "vx": true}\n', name="a.jsonl")[0]
    ) == [
        (1, ""),
        (2, ""),
        (3, "vx"),
    ]
    names = [f'{{"t": 0, "sensor": {name}}}' for name in ('["wheels"]', "{}", "3")]
    hostile = "\n".join([*names, "[" * 100_000]) + "\n"
    assert problems(files(hostile, name="b.jsonl")[0]) == [(1, "sensor"), (2, "sensor"), (3, "sensor"), (4, "")]
    assert problems(tmp_path / "none.csv") == [(0, "")]
    (tmp_path / "bytes.csv").write_bytes(b"t,sensor\n0,\xff\n")
    assert problems(tmp_path / "bytes.csv") == [(0, "")]
    with pytest.raises(FileError, match=r"allowed: \.csv"):
        FilterLog(tmp_path / "log.bag", {})


def test_reading_stops_after_twenty_problems(files):
    log, _ = files("t,sensor\n" + "x,wheels\n" * 100)
    assert len(problems(log)) == 20


def test_numbers_that_are_none_are_counted_not_errors(files):
    log, config = files(STRAIGHT + "5.0,wheels,nan,0.5,,,,\n5.0,compass,,,inf,,,\n5.0,gnss,,,,43.5,10.6,none\n")
    lines = "\n".join(filter_command(log, config, None))
    assert "1 not_finite" in lines and "1 invalid" in lines


def test_a_filter_that_never_begins_says_what_it_waits_for(files):
    log, config = files(HEADER + "0.0,wheels,0.5,0.5,,,,\n")
    with pytest.raises(GrapeError, match="waits for x, y, yaw"):
        filter_command(log, config, None)


def test_sensors_can_be_ignored(files):
    log, config = files(
        STRAIGHT.replace("compass", "camera"), CONFIG.replace("  compass", "  spare") + "ignore: [camera]\n"
    )
    with pytest.raises(GrapeError, match="waits for yaw"):
        filter_command(log, config, None)


@pytest.mark.parametrize(
    ("change", "place", "text"),
    [
        (("[yaw]", "[yow]"), 5, "did you mean 'yaw'"),
        (("pose_gate: 5", "pose_gate: -5"), 6, "pose_gate"),
        (("rate: 10", "rat: 10"), 1, "did you mean 'rate'"),
        (("rate: 10", "cascade: {local: [nothing]}"), 0, "unknown sensors"),
        (("rate: 10", "cascade: {local: [wheels], chain_every_s: 0.1}"), 0, "local"),
        (("[yaw]", "[yaw], differential: true, relative: true"), 0, "exclude"),
    ],
)
def test_wrong_configurations_are_refused(files, change, place, text):
    _, config = files(config=CONFIG.replace(*change))
    with pytest.raises(FileError, match=text) as refused:
        load_filter(config)
    assert refused.value.problems[0].line == place


def test_biases_that_are_learnt_are_named_in_the_configuration(files):
    text = CONFIG.replace(
        "effective_track: 1.0", "effective_track: 1.0, still_below: 0.01, still_bias: [wz], still_bias_s: 9"
    )
    wheels = load_filter(files(config=text)[1]).file.sensors["wheels"].options()
    assert (wheels.still_bias, wheels.still_bias_s) == (components("wz"), 9.0)
    with pytest.raises(FileError, match="still_bias"):
        load_filter(files(config=text.replace("[wz]", "[vx]"))[1])


def test_chained_cascade_is_built_of_the_local_estimate(files):
    chained = CONFIG + "  local: {components: [vx, wz, yaw]}\ncascade: {local: [wheels], chain_every_s: 0.1}\n"
    log, config = files(config=chained)
    configured = load_filter(config)
    assert configured.cascade is not None
    for reading in FilterLog(log, configured.tracks).readings():
        configured.cascade.take(reading)
    assert configured.fusion.verdicts["local", "accepted"] > 10
    assert np.isclose(configured.fusion.belief().mean[0], 2.5, atol=0.1)
