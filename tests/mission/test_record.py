"""The recorder: deterministic JSON lines and pictures that can be read back."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from grape.actions.core import Outcome
from grape.errors import FileError, InvalidInput
from grape.mission.record import RunRecorder, plain, read_events, write_atomic


def recorder(folder: Path, **options: int) -> RunRecorder:
    return RunRecorder(folder, SimpleNamespace(now=lambda: 1.23456789), **options)


def test_events_are_lines_of_rounded_json(tmp_path: Path) -> None:
    seen: list[dict[str, object]] = []
    log = RunRecorder(tmp_path, SimpleNamespace(now=lambda: 1.23456789), observer=seen.append)
    log.event("servo", error_px=np.float64(1 / 3), corners=np.eye(2), outcome=Outcome.DEPLOYED, bad=float("nan"))
    line = (tmp_path / "events.jsonl").read_text()
    assert line == (
        '{"t": 1.234568, "kind": "servo", "error_px": 0.333333, "corners": [[1.0, 0.0], [0.0, 1.0]],'
        ' "outcome": "deployed", "bad": null}\n'
    )
    assert seen == [json.loads(line)]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (-0.0, 0.0), (True, True), (np.bool_(True), True), (np.int64(3), 3), ({1: (2, 3)}, {"1": [2, 3]}),
        ({3, 1}, [1, 3]), (Path("a"), "a"), (float("inf"), None), (None, None),
    ],
)  # fmt: skip
def test_values_become_plain_json(value: object, expected: object) -> None:
    assert plain(value) == expected
    assert json.dumps(plain(value), allow_nan=False) == json.dumps(expected)


def test_pictures_are_numbered_png_files_named_by_an_event(tmp_path: Path) -> None:
    import cv2

    log = recorder(tmp_path)
    picture = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    log.picture("after grasp/1", picture)
    (event,) = read_events(tmp_path / "events.jsonl")
    assert event["file"] == "pictures/001_after_grasp_1.png"
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / event["file"])), picture)


def test_pictures_beyond_the_limit_are_not_kept(tmp_path: Path) -> None:
    log = recorder(tmp_path, max_pictures=1)
    for _ in range(3):
        log.picture("p", np.zeros((2, 2, 3), np.uint8))
    assert len(list((tmp_path / "pictures").iterdir())) == 1


@pytest.mark.parametrize("picture", [np.zeros((2, 2), np.uint8), np.zeros((2, 2, 3)), np.zeros((2, 2, 4), np.uint8)])
def test_what_is_no_bgr_picture_is_refused(tmp_path: Path, picture: np.ndarray) -> None:
    with pytest.raises(InvalidInput, match="uint8"):
        recorder(tmp_path).picture("p", picture)


def test_a_line_cut_off_by_a_kill_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text('{"t": 0.0, "kind": "a"}\n{"t": 1.0, "ki')
    assert [event["kind"] for event in read_events(path)] == ["a"]


def test_two_recorders_never_share_a_folder(tmp_path: Path) -> None:
    recorder(tmp_path)
    with pytest.raises(FileExistsError):
        recorder(tmp_path)


def test_an_atomic_write_leaves_no_part_behind(tmp_path: Path) -> None:
    write_atomic(tmp_path / "a.txt", "one")
    write_atomic(tmp_path / "a.txt", "two")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.txt", "two")]


@pytest.mark.parametrize("line", ["{", "[]", "{}", '{"t": 1}', "\xff", "null"])
def test_a_damaged_line_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "events.jsonl"
    path.write_bytes(b'{"t": 0, "kind": "a"}\n' + line.encode("latin-1") + b"\n")
    with pytest.raises(FileError, match=r"events\.jsonl:2: "):
        list(read_events(path))
