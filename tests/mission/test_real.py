"""Missions on drivers that a robot brings: the package of examples/own_robot, run as a user would."""

from __future__ import annotations

import json
import sys
import time
import tomllib
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.clock import MonotonicClock
from grape.drivers import Drivers
from grape.errors import FileError, InvalidInput
from grape.mission.catalog import robot_description
from grape.mission.file import load_mission
from grape.mission.launch import resume_mission, run_mission
from grape.mission.real import connected
from grape.mission.record import read_events
from grape.plugins import PluginError

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_robot"


@pytest.fixture
def mission_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The example's mission, its package installed."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    info = tmp_path / "site" / "own_robot-0.1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-robot\nVersion: 0.1.0\n")
    groups = project["entry-points"].items()
    lines = [line for group, names in groups for line in (f"[{group}]", *(f"{k} = {v}" for k, v in names.items()))]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.syspath_prepend(str(EXAMPLE))
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    return str(EXAMPLE / "wave.yaml")


def after(beats: int) -> Callable[[], bool]:
    """Somebody who stops a mission after so many beats."""
    count = iter(range(beats))
    return lambda: next(count, None) is None


@pytest.mark.slow
def test_a_mission_runs_in_simulation_and_on_the_drivers_of_the_robot(mission_file: str, tmp_path: Path) -> None:
    simulated = run_mission(load_mission(mission_file, ["drivers=simulated"]), tmp_path / "simulated")
    assert (simulated.result["status"], simulated.result["drivers"]) == ("succeeded", "simulated")
    done = run_mission(load_mission(mission_file), tmp_path / "run")
    assert (done.result["status"], done.result["drivers"], done.result["plants"]) == ("succeeded", "machine", [])
    assert done.result["truth"] is None
    events = list(read_events(tmp_path / "run" / "events.jsonl"))
    ended = {event["name"]: event["status"] for event in events if event["kind"] == "action"}
    assert ended == dict.fromkeys(("WaitForLocalization", "DriveToPose", "Wave"), "succeeded")
    header, *rows = (tmp_path / "run" / "path.csv").read_text().splitlines()
    assert header == "t_s,x_m,y_m,yaw_rad"
    assert float(rows[0].split(",")[1]) == pytest.approx(-3.0, abs=0.05)
    assert float(rows[-1].split(",")[1]) == pytest.approx(-2.2, abs=0.05)
    assert "the true path is not known" in (tmp_path / "run" / "report.html").read_text()
    assert not (tmp_path / "run" / "world").exists()


def test_an_interrupted_mission_goes_on_on_the_same_drivers(mission_file: str, tmp_path: Path) -> None:
    first = run_mission(load_mission(mission_file), tmp_path / "run", cancelled=after(200))
    assert first.result["status"] == "aborted"
    again = resume_mission(tmp_path / "run", cancelled=after(50)).result
    assert (again["drivers"], again["sessions"]) == ("machine", 2)
    stamps = [event["t"] for event in read_events(tmp_path / "run" / "events.jsonl")]
    assert stamps == sorted(stamps)
    times = [float(line.split(",")[0]) for line in (tmp_path / "run" / "track.csv").read_text().splitlines()[1:]]
    assert times == sorted(times)


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        (
            "drivers=machines",
            "drivers: own_robot has no 'machines'; allowed: simulated, machine; did you mean 'machine'?",
        ),
        ("site=null", "drivers: there is no site"),
        ("faults=[{at_s: 1, for_s: 1, silent: imu}]", "faults: got it beside the drivers 'machine'"),
        ("arm_errors=1", "arm_errors: got it beside the drivers 'machine'"),
        ("select={vines: 1}", "select: the task 'waving' serves no plants"),
    ],
)
def test_what_only_a_simulation_has_is_refused(mission_file: str, override: str, expected: str) -> None:
    with pytest.raises(FileError) as caught:
        load_mission(mission_file, [override])
    assert expected in str(caught.value)


def test_no_pictures_are_taken_of_a_real_robot(mission_file: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="--render needs a simulation"):
        run_mission(load_mission(mission_file), tmp_path / "run", render=True)
    assert not (tmp_path / "run").exists()


def drivers_with(**scans: Any) -> Drivers:
    none: Any = None
    return Drivers(base=none, arm=none, gripper=none, camera=none, imu=none, gnss=none, scans=scans)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (drivers_with(front_lasr=None), "husky_jaco2 has no mount front_lasr; there are imu_link"),
        ({"base": None}, "must give grape.drivers.Drivers, got dict"),
    ],
)
def test_drivers_that_do_not_fit_the_robot_are_refused(
    monkeypatch: pytest.MonkeyPatch, given: Any, expected: str
) -> None:
    module = SimpleNamespace(connect=lambda robot, clock: nullcontext(given))
    monkeypatch.setitem(sys.modules, "adapters", module)
    robot = replace(robot_description("husky_jaco2"), drivers={"machine": "adapters:connect"})
    with pytest.raises(InvalidInput, match=expected), connected(robot, "machine"):
        raise AssertionError("it was connected")


def test_adapters_that_cannot_be_imported_are_named() -> None:
    robot = replace(robot_description("husky_jaco2"), drivers={"machine": "no_such_module:connect"})
    with (
        pytest.raises(PluginError, match=r"'machine' of husky_jaco2 \(no_such_module:connect\)"),
        connected(robot, "machine"),
    ):
        raise AssertionError("it was connected")


def test_the_machine_is_left_unattended_for_as_long_as_the_description_says(mission_file: str) -> None:
    from own_robot import DESCRIPTION, machine

    told = {"base": DESCRIPTION.base.command_timeout, "arm": DESCRIPTION.arm.command_timeout}
    assert told == machine.TIMEOUT_S


def test_set_points_that_are_no_numbers_do_not_reach_the_machine(mission_file: str) -> None:
    from own_robot import DESCRIPTION
    from own_robot.drivers import Arm, Gripper, Readings
    from own_robot.machine import Machine

    readings = Readings(DESCRIPTION, MonotonicClock())
    machine = Machine(readings.take)
    with pytest.raises(InvalidInput, match="finite joint velocities"):
        Arm(machine, readings, DESCRIPTION.arm).send(np.full(6, np.nan))
    with pytest.raises(InvalidInput, match="finite finger angles"):
        Gripper(machine, readings, DESCRIPTION.gripper).send(np.array([0.0, np.nan, 0.0]))
    assert np.isfinite(machine.joint_velocity).all() and np.isfinite(machine.fingers).all()


def test_a_beat_that_took_too_long_is_told(mission_file: str, tmp_path: Path) -> None:
    slow = iter([0.0, 0.0, 0.12])

    def cancelled() -> bool:
        pause = next(slow, None)
        time.sleep(pause or 0.0)
        return pause is None

    run_mission(load_mission(mission_file), tmp_path / "run", cancelled=cancelled)
    events = [json.loads(line) for line in (tmp_path / "run" / "events.jsonl").read_text().splitlines()]
    assert max(event["took_s"] for event in events if event["kind"] == "late_beat") >= 0.12
