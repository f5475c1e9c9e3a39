"""What happened in a mission, as files: one JSON line an event, one PNG a picture."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from grape.clock import Clock
from grape.config import Document, validate
from grape.errors import FileError, InvalidInput, Problem
from grape.messages import Array
from grape.mission.record_lines import EVENTS, Line

DECIMALS = 6


class RunRecorder:
    """The `Recorder` of a run folder: `events.jsonl` and `pictures/`. Stamps are the mission's time, never the wall's.

    Args:
        folder: exists.
        max_pictures: pictures beyond that are counted, not kept.
        observer: is shown every event as it is written.
        resume: go on after the events and pictures that are there, shown to `observer` first; else there must be none.
    """

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        max_pictures: int = 200,
        observer: Callable[[dict[str, Any]], None] = lambda event: None,
        resume: bool = False,
    ) -> None:
        self._observer = observer
        self._folder = folder
        self._clock = clock
        self._max_pictures = max_pictures
        self._pictures = 0
        path = folder / "events.jsonl"
        if resume and path.exists():
            cut_torn_line(path)
            for event in read_events(path):
                observer(event)
            numbers = [int(picture.name[:3]) for picture in (folder / "pictures").glob("[0-9][0-9][0-9]_*.png")]
            self._pictures = max(numbers, default=0)
        self._file: TextIO = path.open("a" if resume else "x", encoding="utf-8", buffering=1)

    def event(self, kind: str, /, **fields: Any) -> None:
        """One line: time, kind and the fields; arrays become rounded lists, NaN and infinity null."""
        line = {"t": round(self._clock.now(), DECIMALS), "kind": kind, **{k: plain(v) for k, v in fields.items()}}
        self._file.write(json.dumps(line, allow_nan=False, separators=(", ", ": "), ensure_ascii=False) + "\n")
        self._observer(line)

    def picture(self, name: str, bgr: Array) -> None:
        """A camera picture as `pictures/NNN_name.png`, and an event that names it."""
        import cv2

        if bgr.ndim != 3 or bgr.shape[2] != 3 or bgr.dtype != np.uint8:
            raise InvalidInput(f"picture {name!r} must be (h, w, 3) uint8, got {bgr.shape} {bgr.dtype}")
        self._pictures += 1
        if self._pictures > self._max_pictures:
            return
        safe = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)[:60]
        path = Path("pictures") / f"{self._pictures:03d}_{safe}.png"
        (self._folder / "pictures").mkdir(exist_ok=True)
        _, encoded = cv2.imencode(".png", np.ascontiguousarray(bgr))
        (self._folder / path).write_bytes(encoded.tobytes())
        self.event("picture", name=name, file=path.as_posix())

    def close(self) -> None:
        """No more events."""
        self._file.close()


def plain(value: Any) -> Any:
    """A value as JSON has it, numbers rounded to `DECIMALS`."""
    if isinstance(value, bool | None | str) and not isinstance(value, Enum):
        return value
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return round(value, DECIMALS) + 0.0 if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, set | frozenset):
        return sorted(plain(v) for v in value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    return str(value)


def read_events(path: Path, kinds: Mapping[str, type[Line]] = EVENTS) -> Iterator[dict[str, Any]]:
    """The events of a run, oldest first; a last line cut off by a kill is left out.

    Args:
        kinds: what lines of some kinds must have.

    Raises:
        FileError: a line is damaged, or lacks something that lines of its kind have.
    """
    with path.open("rb") as file:
        for number, line in enumerate(file, 1):
            if line.endswith(b"\n"):
                found = _object(line, path, (), number)
                kind = found.get("kind")
                model = kinds.get(kind, Line) if isinstance(kind, str) else Line
                validate(model, Document(file=str(path), data=found, places={(): (number, 0)}))
                yield found


def read_json(path: Path, keys: Iterable[str] = ()) -> dict[str, Any]:
    """A JSON file with these keys at its top.

    Raises:
        FileError: it cannot be read, is no JSON object or lacks a key.
    """
    try:
        return _object(path.read_bytes(), path, keys)
    except OSError as error:
        raise FileError([Problem(file=str(path), got=f"cannot be read: {error.strerror or error}")]) from error


def _object(text: bytes, path: Path, keys: Iterable[str], line: int = 0) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        got = f"damaged, no JSON: {error}"
    else:
        missing = [key for key in keys if key not in found] if isinstance(found, dict) else []
        if isinstance(found, dict) and not missing:
            return found
        got = f"{', '.join(missing)} is missing" if missing else f"got a {type(found).__name__}"
    raise FileError([Problem(file=str(path), line=line, got=got, allowed="what `grape` wrote")])


def cut_torn_line(path: Path) -> None:
    """Take a last line without an end, which a kill has cut off, out of a text file."""
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        with path.open("r+b") as file:
            file.truncate(whole)


def write_atomic(path: Path, content: str | bytes) -> None:
    """Write a file, text as UTF-8, that appears whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
    part.replace(path)
