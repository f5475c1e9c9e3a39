"""One process at a time in the folder of a run or a campaign."""

from __future__ import annotations

import fcntl
from pathlib import Path
from types import TracebackType

from grape.errors import InvalidInput

LOCK_FILE = "run.lock"


class FolderBusy(InvalidInput):
    """Another process works in a folder."""


class RunLock:
    """Held while a mission or a campaign runs in a folder; the system lets go of it when the process dies.

    Raises:
        FolderBusy: another process holds it.
    """

    def __init__(self, folder: Path) -> None:
        self._file = (folder / LOCK_FILE).open("a")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._file.close()
            raise FolderBusy(f"{folder}: another process runs this mission; wait for it, or end it first") from error

    def __enter__(self) -> RunLock:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._file.close()
