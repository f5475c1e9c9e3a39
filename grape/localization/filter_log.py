"""Recorded readings: a table with a header (CSV) or an object a line (JSONL), each line one sensor at one time."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from grape.errors import FileError, InvalidInput, Problem, did_you_mean
from grape.geometry import quaternion_to_rotation, rotation_to_rpy
from grape.localization.readings import Reading
from grape.localization.sensors import skid_steer_rates
from grape.localization.state import STATE
from grape.messages import FIX_STATUS

QUATERNION = ("qw", "qx", "qy", "qz")
GEODETIC = ("lat", "lon", "alt")
WHEELS = ("left", "right")
STDS = tuple(f"std_{name}" for name in STATE)
NUMBERS = ("t", *STATE, *QUATERNION, *GEODETIC, *WHEELS, *STDS)
COLUMNS = (*NUMBERS, "sensor", "status")
MOST_PROBLEMS = 20
_INDEX = {name: i for i, name in enumerate(STATE)}


class FilterLog:
    """Reads a log line by line.

    Args:
        path: a `.csv` or `.jsonl` file.
        tracks: effective track (m) of the sensors whose lines give `left` and `right` wheel speeds (m/s), None of the
            others. Its names are the sensors that the log may hold.
        ignore: sensors whose lines are passed over.
    """

    def __init__(self, path: Path, tracks: dict[str, float | None], ignore: Iterable[str] = ()) -> None:
        self._path = path
        self._tracks = tracks
        self._ignore = frozenset(ignore)
        self._problems: list[Problem] = []
        if path.suffix not in (".csv", ".jsonl"):
            raise FileError([Problem(file=str(path), got=f"ends with {path.suffix!r}", allowed=".csv or .jsonl")])

    def readings(self) -> Iterator[Reading]:
        """The readings in the order of their lines, which is taken for the order in which they came.

        Raises:
            FileError: after the last line, or the twentieth problem, with every line that cannot be read.
        """
        with suppress(_TooMany):
            yield from self._all()
        if self._problems:
            raise FileError(self._problems)

    def _all(self) -> Iterator[Reading]:
        rows = self._csv_rows if self._path.suffix == ".csv" else self._json_rows
        wrong = ""
        try:
            with self._path.open(encoding="utf-8-sig", newline="") as stream:
                for line, row in rows(stream):
                    reading = self._reading(line, row)
                    if reading is not None:
                        yield reading
        except OSError as error:
            wrong = f"cannot be read: {error.strerror or error}"
        except UnicodeDecodeError as error:
            wrong = f"is no UTF-8 text: {error.reason}"
        if wrong:
            self._refuse(0, wrong)

    def _refuse(self, line: int, got: str, *, column: str = "", allowed: str = "", suggestion: str = "") -> None:
        self._problems.append(
            Problem(file=str(self._path), line=line, path=column, got=got, allowed=allowed, suggestion=suggestion)
        )
        if len(self._problems) >= MOST_PROBLEMS:
            raise _TooMany

    def _csv_rows(self, stream: Iterable[str]) -> Iterator[tuple[int, dict[str, Any]]]:
        table = csv.reader(stream)
        header = [name.strip() for name in next(table, [])]
        self._check_header(header)
        if self._problems:
            return
        while True:
            try:
                row = next(table, None)
            except csv.Error as error:
                self._refuse(table.line_num, str(error))
                continue
            if row is None:
                return
            if not row or row[0].startswith("#"):
                continue
            if len(row) != len(header):
                self._refuse(table.line_num, f"{len(row)} cells", allowed=f"{len(header)} as in the header")
                continue
            yield table.line_num, {name: cell.strip() for name, cell in zip(header, row, strict=True) if cell.strip()}

    def _check_header(self, header: list[str]) -> None:
        for name in dict.fromkeys(header):
            if name not in COLUMNS:
                self._refuse(1, "unknown column", column=name, suggestion=did_you_mean(name, COLUMNS))
            if header.count(name) > 1:
                self._refuse(1, "column is given twice", column=name)
        for name in ("t", "sensor"):
            if name not in header:
                self._refuse(1, "column is missing", column=name, allowed="t, sensor and any of " + ", ".join(COLUMNS))

    def _json_rows(self, stream: Iterable[str]) -> Iterator[tuple[int, dict[str, Any]]]:
        for line, text in enumerate(stream, 1):
            if not text.strip():
                continue
            try:
                row = json.loads(text)
            except (ValueError, RecursionError) as error:
                self._refuse(line, f"no JSON: {error}")
                continue
            if not isinstance(row, dict):
                self._refuse(line, f"got a {type(row).__name__}", allowed="an object, {…}")
                continue
            yield line, {name: value for name, value in row.items() if value is not None}

    def _reading(self, line: int, row: dict[str, Any]) -> Reading | None:
        sensor = row.get("sensor")
        if isinstance(sensor, str) and sensor in self._ignore:
            return None
        before = len(self._problems)
        if not isinstance(sensor, str) or sensor not in self._tracks:
            self._refuse(
                line,
                "is missing" if sensor is None else f"got {sensor!r}",
                column="sensor",
                allowed=", ".join(self._tracks),
                suggestion=did_you_mean(str(sensor), self._tracks),
            )
        if row.get("status", "fix") not in FIX_STATUS:
            self._refuse(line, f"got {row['status']!r}", column="status", allowed=", ".join(FIX_STATUS))
        numbers = self._numbers(line, row)
        if "t" not in numbers and len(self._problems) == before:
            self._refuse(line, "is missing", column="t", allowed="a time in seconds")
        if len(self._problems) > before:
            return None
        try:
            return reading_of_row(str(sensor), numbers, row.get("status", "fix"), self._tracks[str(sensor)])
        except InvalidInput as error:
            self._refuse(line, str(error))
            return None

    def _numbers(self, line: int, row: dict[str, Any]) -> dict[str, float]:
        numbers: dict[str, float] = {}
        for name, value in row.items():
            if name in ("sensor", "status"):
                continue
            if name not in COLUMNS:
                self._refuse(line, "unknown key", column=name, suggestion=did_you_mean(name, COLUMNS))
            elif isinstance(value, bool) or not isinstance(value, str | int | float):
                self._refuse(line, f"got {value!r}", column=name, allowed="a number")
            else:
                try:
                    numbers[name] = float(value)
                except (ValueError, OverflowError):
                    self._refuse(line, f"got {value!r}", column=name, allowed="a number")
        return numbers


class _TooMany(Exception):
    """Enough problems were found."""


def reading_of_row(sensor: str, row: dict[str, float], status: str = "fix", track: float | None = None) -> Reading:
    """A reading of the columns of a line.

    Raises:
        InvalidInput: half a quaternion, latitude or pair of wheels, or wheels of a sensor without a track.
    """
    values, given = np.zeros(15), np.zeros(15, bool)
    covariance: Any = None
    for name, value in row.items():
        if name in _INDEX:
            values[_INDEX[name]], given[_INDEX[name]] = value, True
        elif name.startswith("std_"):
            covariance = np.zeros((15, 15)) if covariance is None else covariance
            covariance[_INDEX[name[4:]], _INDEX[name[4:]]] = value * value
    if quaternion := _all_or_none(row, QUATERNION):
        try:
            values[3:6] = rotation_to_rpy(quaternion_to_rotation(np.array(quaternion)))
        except InvalidInput:
            values[3:6] = np.nan  # counted by the filter, like every number that is none
        given[3:6] = True
    if wheels := _all_or_none(row, WHEELS):
        if track is None:
            raise InvalidInput(f"left and right need `effective_track` of {sensor!r} in the configuration")
        values[6], values[11] = skid_steer_rates(wheels[0], wheels[1], track)
        values[7] = values[8] = 0.0
        given[6:9] = given[11] = True
    place = _all_or_none({"alt": np.nan, **row} if "lat" in row or "lon" in row else row, GEODETIC)
    if place:
        given[:2], given[2] = True, "alt" in row
    return Reading(
        stamp=row["t"],
        sensor=sensor,
        values=values,
        given=given,
        covariance=covariance,
        geodetic=np.array(place) if place else None,
        status=status,
    )


def _all_or_none(row: dict[str, float], names: tuple[str, ...]) -> list[float]:
    found = [row[name] for name in names if name in row]
    if found and len(found) < len(names):
        raise InvalidInput(f"{', '.join(names)} belong together, got only {', '.join(n for n in names if n in row)}")
    return found
