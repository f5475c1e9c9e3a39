"""Folders of commands: each its own, also at the same time, and what cannot be written is told before the work."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from grape.errors import InvalidInput
from grape.folders import new_folder, open_folder, refuse_unwritable_file, refuse_unwritable_folder


def test_who_asks_at_the_same_time_gets_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with ThreadPoolExecutor(8) as pool:
        folders = list(pool.map(new_folder, ["mission-seed0"] * 40))
    assert sorted(folder.name for folder in folders) == sorted(f"mission-seed0-{n}" for n in range(1, 41))


def test_a_folder_that_is_there_is_opened_and_one_that_is_not_is_made(tmp_path: Path) -> None:
    assert open_folder(tmp_path / "a" / "b", "x") == open_folder(tmp_path / "a" / "b", "x") == tmp_path / "a" / "b"
    assert (tmp_path / "a" / "b").is_dir()


def test_a_folder_behind_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InvalidInput, match=r"file/a/b: \S*/file is no folder"):
        refuse_unwritable_folder(tmp_path / "file" / "a" / "b")
    with pytest.raises(InvalidInput, match="it exists and is no folder; name a new folder"):
        refuse_unwritable_folder(tmp_path / "file")


def test_runs_that_is_a_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").touch()
    with pytest.raises(InvalidInput, match="--out runs: it exists and is no folder"):
        refuse_unwritable_folder(None)


def test_a_foreign_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path)  # root may write everywhere
    with pytest.raises(InvalidInput, match=f"no right to write in {tmp_path}"):
        refuse_unwritable_folder(tmp_path / "new" / "folder")
    with pytest.raises(InvalidInput, match=f"--json .*: no right to write in {tmp_path}"):
        refuse_unwritable_file("--json", tmp_path / "file.json")


def test_a_file_in_the_place_of_a_folder_or_in_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="it is a folder; name a file"):
        refuse_unwritable_file("--json", tmp_path)
    with pytest.raises(InvalidInput, match="its folder does not exist"):
        refuse_unwritable_file("--json", tmp_path / "gone" / "file.json")
    refuse_unwritable_file("--json", tmp_path / "file.json")
    assert list(tmp_path.iterdir()) == []
