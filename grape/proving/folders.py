"""The folder that a command writes to."""

from __future__ import annotations

from pathlib import Path

from grape.errors import InvalidInput


def open_folder(out: Path | None, stem: str) -> Path:
    """`out`, or a new `runs/<stem>-<n>`; made when it is not there.

    Raises:
        InvalidInput: `out` is a file.
    """
    if out is None:
        number = 1
        while (out := Path("runs") / f"{stem}-{number}").exists():
            number += 1
    if out.exists() and not out.is_dir():
        raise InvalidInput(f"--out {out}: it exists and is no folder")
    out.mkdir(parents=True, exist_ok=True)
    return out
