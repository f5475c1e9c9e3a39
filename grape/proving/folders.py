"""The folder that a command writes to."""

from __future__ import annotations

from pathlib import Path

from grape.errors import InvalidInput


def open_folder(out: Path | None, stem: str) -> Path:
    """`out`, or a new `runs/<stem>-<n>`; made when it is not there.

    Raises:
        InvalidInput: `out` is a file.
    """
    folder = out or _new(stem)
    if folder.exists() and not folder.is_dir():
        raise InvalidInput(f"--out {folder}: it exists and is no folder")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _new(stem: str) -> Path:
    number = 1
    while (folder := Path("runs") / f"{stem}-{number}").exists():
        number += 1
    return folder
