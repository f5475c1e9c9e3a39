"""Where commands write: each to a folder of its own, and what cannot be written is told before the work."""

from __future__ import annotations

import os
from pathlib import Path

from grape.errors import InvalidInput

RUNS = Path("runs")


def open_folder(out: Path | None, stem: str) -> Path:
    """`out`, or a new `runs/<stem>-<n>`; made when it is not there.

    Raises:
        InvalidInput: `out` is a file, or cannot be written.
    """
    if out is None:
        return new_folder(stem)
    refuse_unwritable_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    return out


def new_folder(stem: str) -> Path:
    """A new `runs/<stem>-<n>`: of processes that ask at the same time, each gets another."""
    RUNS.mkdir(exist_ok=True)
    number = 1
    while True:
        folder = RUNS / f"{stem}-{number}"
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
        else:
            return folder


def refuse_unwritable_folder(out: Path | None) -> None:
    """Refuse an `--out`, by default below `runs`, that cannot be made or written into.

    Raises:
        InvalidInput: it, or a folder above it, is a file or not ours to write.
    """
    path = out or RUNS
    there = next(place for place in (path, *path.absolute().parents) if place.exists())
    if not there.is_dir():
        what = "it exists and is no folder" if there == path else f"{there} is no folder"
        raise InvalidInput(f"--out {path}: {what}; name a new folder")
    _refuse_foreign(f"--out {path}", there)


def refuse_unwritable_file(option: str, path: Path) -> None:
    """Refuse a file that cannot be written.

    Args:
        option: that names it.

    Raises:
        InvalidInput: it is a folder, or the folder that it shall be in is missing or not ours to write.
    """
    if not path.absolute().parent.is_dir():
        raise InvalidInput(f"{option} {path}: its folder does not exist")
    if path.is_dir():
        raise InvalidInput(f"{option} {path}: it is a folder; name a file")
    _refuse_foreign(f"{option} {path}", path.absolute().parent)


def _refuse_foreign(what: str, folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InvalidInput(f"{what}: no right to write in {folder}")
