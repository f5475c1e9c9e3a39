"""Laser logs: both kinds of laser messages, three ways to say what is corrected, and malformed lines by their place."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from grape.errors import FileError, InvalidInput
from grape.mapping import between, chained, parse_carmen, read_carmen


def flaser(t: float, laser: tuple[float, ...], robot: tuple[float, ...], ranges: tuple[float, ...] = (1, 2, 9)) -> str:
    numbers = " ".join(str(value) for value in (*ranges, *laser, *robot))
    return f"FLASER {len(ranges)} {numbers} {t} host {t}"


def odom(t: float, pose: tuple[float, ...]) -> str:
    return f"ODOM {pose[0]} {pose[1]} {pose[2]} 0 0 0 {t} host {t}"


def test_an_old_scan_is_read() -> None:
    log = parse_carmen([flaser(1.5, (1, 2, 3), (1, 2, 3), (0, 2, 81.83))], "log")
    scan = log.scans[0]
    assert log.laser == "FLASER" and scan.stamp == 1.5
    assert scan.ranges.tolist() == [-np.inf, 2.0, np.inf]
    assert scan.angle_min == pytest.approx(-np.pi / 2)
    assert log.odometry.tolist() == [[1, 2, 3]] and log.corrected is None


@pytest.mark.parametrize(("beams", "start", "step"), [(180, -90, 1), (181, -90, 1), (360, -90, 0.5), (361, -90, 0.5)])
def test_old_messages_have_the_angles_of_a_sick(beams: int, start: float, step: float) -> None:
    scan = parse_carmen([flaser(0, (0, 0, 0), (0, 0, 0), (1.0,) * beams)], "log").scans[0]
    assert np.degrees([scan.angle_min, scan.angle_increment]) == pytest.approx([start, step])


def test_a_new_scan_is_read_with_its_own_angles_and_range() -> None:
    line = "ROBOTLASER1 0 -1.0 2.0 1.0 30 0.01 0 3 1 2 31 2 7 7 1.3 2 0 1 2 0 0 0 0 0 0 5.5 host 5.5"
    log = parse_carmen([line], "log")
    scan = log.scans[0]
    assert (scan.angle_min, scan.angle_increment, scan.range_max, scan.stamp) == (-1.0, 1.0, 30.0, 5.5)
    assert scan.ranges.tolist() == [1.0, 2.0, np.inf]
    assert log.mount == pytest.approx([0.3, 0, 0]) and log.odometry.tolist() == [[1, 2, 0]]


def test_raw_scans_take_odometry_between_odom_lines() -> None:
    raw = "RAWLASER1 0 -1.0 2.0 1.0 30 0.01 0 1 1 0 5 host 5"
    log = parse_carmen([odom(4, (0, 0, 3.1)), raw, odom(6, (2, 0, -3.1))], "log")
    assert log.odometry[0, 0] == pytest.approx(1.0)
    assert abs(log.odometry[0, 2]) == pytest.approx(np.pi, abs=1e-6), "the short way round"


def test_scans_whose_two_poses_part_are_corrected_by_the_first() -> None:
    lines = [flaser(0, (0, 0, 0), (0, 0, 0)), flaser(1, (1, 0, 0), (1.2, 0.1, 0.05))]
    log = parse_carmen(lines, "log")
    assert log.corrected is not None and log.corrected.tolist() == [[0, 0, 0], [1, 0, 0]]
    assert log.odometry[1] == pytest.approx([1.2, 0.1, 0.05])


def test_a_constant_offset_is_the_mount() -> None:
    poses = [(0.0, 0.0, 0.0), (1.0, 0.0, np.pi / 2)]
    lines = [flaser(0, (0.4, 0, 0), poses[0]), flaser(1, (1.0, 0.4, np.pi / 2), poses[1])]
    log = parse_carmen(lines, "log")
    assert log.mount == pytest.approx([0.4, 0, 0]) and log.corrected is None


def test_odometry_that_restarts_at_scans_is_chained() -> None:
    """As Gmapping writes logs: after each scan an ODOM line repeats its corrected pose."""
    steps = np.array([[1.0, 0.0, 0.3], [0.5, 0.1, -0.2], [0.7, 0.0, 0.0]])
    corrected = np.array([[0.0, 0.0, 0.0], [1.1, 0.05, 0.25], [1.5, 0.3, 0.1], [2.2, 0.4, 0.12]])
    lines = [odom(0, (0, 0, 0)), flaser(0, tuple(corrected[0]), tuple(corrected[0]))]
    for k, step in enumerate(steps):
        predicted = chained(step[None], corrected[k])[1]
        lines += [odom(0, tuple(corrected[k])), odom(k + 1, tuple(predicted))]
        lines += [flaser(k + 1, tuple(corrected[k + 1]), tuple(corrected[k + 1]))]
    log = parse_carmen(lines, "log")
    assert log.corrected is not None
    np.testing.assert_allclose(log.corrected, corrected)
    np.testing.assert_allclose(between(log.odometry[:-1], log.odometry[1:]), steps, atol=1e-9)


def test_scans_whose_odometry_is_not_in_the_log_have_their_own_poses_alone() -> None:
    """Each ODOM line repeats the pose of the scan before: nothing was driven between them."""
    poses = [(0.0, 0.0, 0.0), (1.1, 0.05, 0.25), (1.5, 0.3, 0.1), (2.2, 0.4, 0.12)]
    lines = [line for k, pose in enumerate(poses) for line in (flaser(k, pose, pose), odom(k, pose))]
    log = parse_carmen(lines, "log")
    assert log.corrected is None
    np.testing.assert_allclose(log.odometry, poses)


def test_running_odometry_is_not_taken_for_a_correction() -> None:
    lines = []
    for k in range(6):
        lines += [odom(k, (0.5 * k, 0, 0)), flaser(k, (0.5 * k, 0, 0), (0.5 * k, 0, 0)), odom(k, (0.5 * k, 0, 0))]
    log = parse_carmen(lines, "log")
    assert log.corrected is None and log.odometry[5, 0] == 2.5


def test_true_poses_of_the_simulator_are_corrected_poses() -> None:
    lines = [flaser(0, (0, 0, 0), (0, 0, 0)), "TRUEPOS 5 6 0.5 0 0 0 0 host 0"]
    log = parse_carmen(lines, "log")
    assert log.corrected is not None and log.corrected[0] == pytest.approx([5, 6, 0.5])


def test_other_messages_are_counted_and_comments_are_not() -> None:
    log = parse_carmen(["# text", "", "NEFF 3", "NEFF 4", flaser(0, (0, 0, 0), (0, 0, 0))], "log")
    assert log.ignored == {"NEFF": 2}


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("FLASER 3 1 2", "log:2:"),
        ("FLASER x 1 2", "log:2:8: FLASER: got 'x'"),
        ("FLASER 2.5 1 2", "num_readings is 2.5"),
        ("FLASER 2 1 -2 0 0 0 0 0 0 1 h 1", "log:2:12: FLASER: a reading of -2"),
        ("FLASER 1 1 0 0 nan 0 0 0 1 h 1", "got 'nan'"),
        ("FLASER 1 1 0 0 0 0 0 0 1 h", "2 words after the message's fields"),
        ("ODOM 1 2", "log:2:9: ODOM: the line ends after 3 words"),
        ("ROBOTLASER1 0 -1 2 1 30 0 0 99999999", "num_readings is 99999999"),
        ("ROBOTLASER1 0 -1 2 1 -30 0 0 0 0", "log:2:22: ROBOTLASER1: a maximum_range of -30"),
        ("RAWLASER1 0 -90 180 1 30 0 0 0 0", "log:2:13: RAWLASER1: an angle of -90; allowed: radians"),
        ("PARAM robot_frontlaser_offset nan", "log:2:31: PARAM: got 'nan'"),
        ("TRUEPOS a 0 0 0 0 0 1 h 1", "log:2:9: TRUEPOS: got 'a'"),
    ],
)
def test_a_malformed_line_is_named(line: str, expected: str) -> None:
    with pytest.raises(FileError) as error:
        parse_carmen(["# header", line], "log")
    assert expected in str(error.value)


def test_problems_end_at_twenty() -> None:
    with pytest.raises(FileError) as error:
        parse_carmen(["ODOM"] * 100, "log")
    assert len(error.value.problems) == 20


def test_what_a_log_lacks_is_said(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no scans of a laser"):
        parse_carmen([odom(0, (0, 0, 0))], "log")
    with pytest.raises(FileError, match=r"no scans of RLASER.*there are: FLASER"):
        parse_carmen([flaser(0, (0, 0, 0), (0, 0, 0))], "log", laser="RLASER")
    with pytest.raises(InvalidInput, match="did you mean 'FLASER'"):
        parse_carmen([], "log", laser="FLASERR")
    with pytest.raises(FileError, match="no ODOM lines"):
        parse_carmen(["RAWLASER1 0 -1.0 2.0 1.0 30 0.01 0 1 1 0 5 host 5"], "log")
    with pytest.raises(FileError, match="cannot be read"):
        read_carmen(tmp_path / "gone.log")


def test_packed_logs_are_read(tmp_path: Path) -> None:
    with gzip.open(tmp_path / "a.log.gz", "wt") as stream:
        stream.write(flaser(0, (0, 0, 0), (0, 0, 0)) + "\n")
    assert len(read_carmen(tmp_path / "a.log.gz").scans) == 1
    whole = (tmp_path / "a.log.gz").read_bytes()
    for content in (b"no gzip", whole[:-10], whole[:12] + b"\xff" * 40):
        (tmp_path / "b.log.gz").write_bytes(content)
        with pytest.raises(FileError, match="cannot be read"):
            read_carmen(tmp_path / "b.log.gz")


def test_a_line_without_end_is_not_read_to_its_end(tmp_path: Path) -> None:
    with gzip.open(tmp_path / "a.log.gz", "wb") as stream:
        stream.write(b"# a comment\n" + b"A" * 5_000_000)
    with pytest.raises(FileError, match=r"a\.log\.gz:2: the line is too long"):
        read_carmen(tmp_path / "a.log.gz")
