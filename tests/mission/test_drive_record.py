"""What a run keeps of its drives: enough to show them, no more, and the same after an interruption."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.actions.core import Status
from grape.errors import FileError
from grape.geodesy import geodetic_from_enu
from grape.geometry import pose, rotation_z
from grape.messages import JointState, NavSatFix
from grape.mission.drive_record import DriveRecord, changed, packed, read_drive, simplified
from grape.mission.report_drive import load_drive
from grape.navigation.path import Path as Way
from grape.world import Driving

WHEELS = ("wheel_front_left", "wheel_front_right", "wheel_rear_left", "wheel_rear_right")
BASE = SimpleNamespace(wheel_radius=0.2, effective_track=1.0, footprint=np.array([[0.5, 0.3], [-0.5, -0.3]]))
ANTENNA = np.array([-0.35, 0.0, 0.75])


class Driver:
    """A driver with the messages of a test."""

    def __init__(self) -> None:
        self.messages: list[Any] = []

    def since(self, stamp: float) -> tuple[Any, ...]:
        return tuple(message for message in self.messages if message.stamp > stamp)


@pytest.fixture
def drivers() -> Any:
    return SimpleNamespace(base=Driver(), gnss=Driver())


@pytest.fixture
def world(mission: Any) -> Any:
    odometry = SimpleNamespace(pose=pose(rotation_z(0.5), (1.0, 2.0, 0.13)))
    return SimpleNamespace(odometry=odometry, driving=None, site=mission.site, estimates={})


def turned(stamp: float, left: float, right: float) -> JointState:
    """Wheels at angles in rad."""
    position = np.array([left, right, left, right])
    return JointState(stamp=stamp, name=WHEELS, position=position, velocity=np.zeros(4), effort=np.zeros(4))


def view(*cells: tuple[float, float]) -> Any:
    """Surroundings with obstacles at places in m."""
    return SimpleNamespace(obstacles=lambda: np.array(cells, float).reshape(-1, 2))


def drives(points: Any, surroundings: Any) -> Driving:
    poses = np.column_stack([points, np.zeros(len(points))])
    return Driving(path=Way(poses=poses), surroundings=surroundings, scan=np.array([[1.0, -2.0], [30.0, 0.0]]),
                   scan_pose=np.array([1.0, 2.0, 0.5]))  # fmt: skip


def test_the_wheels_lead_along_an_arc_from_the_first_estimate(tmp_path: Path, drivers: Any, world: Any) -> None:
    record = DriveRecord(tmp_path / "drive.jsonl", BASE, ANTENNA)
    for k in range(101):  # a quarter of a circle of 2 m: the inner wheel 1.5 m, the outer one 2.5 m from its middle
        angle = 0.5 * np.pi * k / 100
        drivers.base.messages.append(turned(0.2 * k, 1.5 * angle / 0.2, 2.5 * angle / 0.2))
        record.observe(0.2 * k, world, drivers)
    record.close()
    *_, last = (line for line in read_drive(tmp_path / "drive.jsonl") if line["kind"] == "estimate")
    start = np.array([1.0, 2.0])
    left = np.array([-np.sin(0.5), np.cos(0.5)])
    end = start + 2.0 * left - 2.0 * np.array([-np.sin(0.5 + 0.5 * np.pi), np.cos(0.5 + 0.5 * np.pi)])
    np.testing.assert_allclose(last["pose"], [*end, 0.5 + 0.5 * np.pi], atol=0.02)
    assert last["source"] == "wheels"


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ('{"t": 1, "kind": "estimate", "source": "ekf"}', "pose: is missing"),
        ('{"t": 1, "kind": "gnss", "status": "fix", "place": [0, null]}', "place.1: got None"),
        ('{"t": 1, "kind": "plan"}', "points: is missing"),
        ('{"t": 1, "kind": "obstacles", "added": [[1]], "gone": []}', "added.0.1: is missing"),
    ],
)
def test_a_line_that_lacks_something_is_named(tmp_path: Path, line: str, wrong: str) -> None:
    path = tmp_path / "drive.jsonl"
    path.write_text(f'{{"t": 0, "kind": "plan", "points": []}}\n{line}\n')
    with pytest.raises(FileError) as caught:
        load_drive(tmp_path)
    assert str(caught.value).startswith(f"{path}:2: {wrong}")


def test_a_record_whose_first_line_is_gone_is_read(tmp_path: Path) -> None:
    (tmp_path / "drive.jsonl").write_text('{"t": 1, "kind": "plan", "points": [[0, 1]]}\n')
    assert load_drive(tmp_path).plans == [(1, [[0, 1]])]


def test_a_robot_that_stands_adds_nothing(tmp_path: Path, drivers: Any, world: Any) -> None:
    record = DriveRecord(tmp_path / "drive.jsonl", BASE, ANTENNA)
    for k in range(100):
        drivers.base.messages.append(turned(0.2 * k, 3.0, 3.0))
        record.observe(0.2 * k, world, drivers)
    record.close()
    assert [line["kind"] for line in read_drive(tmp_path / "drive.jsonl")] == ["robot", "estimate"]


def test_other_estimates_are_told_when_they_have_changed(tmp_path: Path, drivers: Any, world: Any) -> None:
    record = DriveRecord(tmp_path / "drive.jsonl", BASE, ANTENNA)
    for k, x in enumerate((1.0, 1.001, 1.5)):
        world.estimates["amcl"] = np.array([x, 2.0, 0.5])
        record.observe(0.2 * k, world, drivers)
    record.close()
    again = DriveRecord(tmp_path / "drive.jsonl", BASE, ANTENNA)
    again.observe(0.8, world, drivers)
    again.close()
    told = [line for line in read_drive(tmp_path / "drive.jsonl") if line["kind"] == "estimate"]
    assert [(line["t"], line["source"], line["pose"][0]) for line in told] == [(0.0, "amcl", 1.0), (0.4, "amcl", 1.5)]


def test_a_fix_is_told_once_and_of_the_base_not_the_antenna(tmp_path: Path, drivers: Any, world: Any) -> None:
    record = DriveRecord(tmp_path / "drive.jsonl", BASE, ANTENNA)
    antenna = world.odometry.pose[:3, 3] + rotation_z(0.5) @ ANTENNA
    latitude, longitude, altitude = geodetic_from_enu(world.site.datum, antenna[None])[0]
    fix = NavSatFix(
        stamp=0.4, latitude=latitude, longitude=longitude, altitude=altitude, covariance=np.eye(3), status="float"
    )
    lost = NavSatFix(stamp=0.5, latitude=np.nan, longitude=0.0, altitude=0.0, covariance=np.eye(3), status="none")
    drivers.gnss.messages = [fix, lost]
    for now in (0.5, 1.0, 1.5):
        record.observe(now, world, drivers)
    record.close()
    (line,) = (line for line in read_drive(tmp_path / "drive.jsonl") if line["kind"] == "gnss")
    assert (line["t"], line["status"]) == (0.4, "float")
    np.testing.assert_allclose(line["place"], [1.0, 2.0], atol=0.002)


def test_a_drive_is_told_by_plan_changed_cells_and_near_hits(tmp_path: Path, drivers: Any, world: Any) -> None:
    record = DriveRecord(tmp_path / "drive.jsonl", BASE, ANTENNA)
    straight = [[0.0, 0.0], [1.0, 0.001], [2.0, 0.0], [2.0, 1.0]]
    world.driving = drives(straight, view((0.05, 0.05), (0.07, 0.01), (-0.05, 0.05)))
    record.observe(10.0, world, drivers)
    world.driving = Driving(path=world.driving.path, surroundings=view((0.05, 0.05)), scan=np.zeros((0, 2)),
                            scan_pose=np.zeros(3))  # fmt: skip
    record.observe(10.4, world, drivers)
    record.observe(11.0, world, drivers)
    world.driving = None
    record.observe(11.4, world, drivers)
    record.close()
    lines = [line for line in read_drive(tmp_path / "drive.jsonl") if line["kind"] != "robot"]
    assert [(line["t"], line["kind"]) for line in lines] == [
        (10.0, "plan"), (10.0, "obstacles"), (10.0, "scan"), (11.0, "obstacles"), (11.0, "scan"), (11.4, "plan"),
    ]  # fmt: skip
    assert lines[0]["points"] == [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]] and lines[-1]["points"] == []
    assert (lines[1]["added"], lines[1]["gone"]) == ([[-1, 0], [0, 0]], [])
    assert (lines[3]["added"], lines[3]["gone"]) == ([], [[-1, 0]])
    assert np.frombuffer(base64.b64decode(lines[2]["points_cm"]), "<i2").tolist() == [100, -200]


def test_an_interrupted_record_goes_on(tmp_path: Path, drivers: Any, world: Any) -> None:
    path = tmp_path / "drive.jsonl"
    record = DriveRecord(path, BASE, ANTENNA)
    world.driving = drives([[0.0, 0.0], [2.0, 0.0]], view((0.05, 0.05)))
    for now, angle in ((0.0, 0.0), (0.2, 5.0)):
        drivers.base.messages.append(turned(now, angle, angle))
        record.observe(now, world, drivers)
    record.close()
    with path.open("a") as file:
        file.write('{"t":0.3,"ki')
    there = [line["pose"] for line in read_drive(path) if line["kind"] == "estimate"][-1]
    again = DriveRecord(path, BASE, ANTENNA)
    world.driving = None
    drivers.base.messages = []
    for now, angle in ((5.0, 0.0), (5.2, 1.0)):
        drivers.base.messages.append(turned(now, angle, angle))
        again.observe(now, world, drivers)
    again.close()
    lines = list(read_drive(path))
    assert sum(line["kind"] == "robot" for line in lines) == 1
    assert [line["points"] for line in lines if line["kind"] == "plan"][-1] == [], (
        "the drive that was cut off has ended"
    )
    moved = np.array(lines[-1]["pose"]) - there
    np.testing.assert_allclose(np.hypot(*moved[:2]), 0.2, atol=0.002)


def test_a_simplified_line_keeps_its_bends_and_its_distance() -> None:
    angles = np.linspace(0.0, np.pi, 200)
    arc = 2.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    few = simplified(arc)
    assert len(few) < 20
    np.testing.assert_array_equal(few[[0, -1]], arc[[0, -1]])
    middles = 0.5 * (few[1:] + few[:-1])
    assert np.abs(np.hypot(*middles.T) - 2.0).max() <= 0.02 + 1e-9
    there_and_back = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    np.testing.assert_array_equal(simplified(there_and_back), there_and_back)


def test_packed_points_and_changed_cells_can_be_read_again() -> None:
    assert np.frombuffer(base64.b64decode(packed(np.array([[-1.234, 9.996]]))), "<i2").tolist() == [-123, 1000]
    assert changed({(1, 2), (3, 4)}, {"added": [[5, 6]], "gone": [[1, 2]]}) == {(3, 4), (5, 6)}


def test_a_mission_writes_the_record(make_runner: Callable[..., Any], tmp_path: Path) -> None:
    runner, _ = make_runner(lambda context, ticks: Status.SUCCEEDED if ticks == 120 else None)
    runner.run()
    runner.close()
    assert [line["kind"] for line in read_drive(tmp_path / "drive.jsonl")] == ["robot", "estimate", "gnss", "gnss"]
