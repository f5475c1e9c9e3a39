"""Reads a vineyard's GeoJSON and finds everything that is wrong with it, with the place in the file."""

from __future__ import annotations

import json
import math
import re
from bisect import bisect_right
from collections.abc import Iterator, Set
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grape.config import Document, read_text
from grape.errors import FileError, Problem, did_you_mean
from grape.site_features import GEOMETRIES, PLANTS, Key, Report, TooMany, check_feature, is_number, short

MAX_BYTES = 20_000_000
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],:]|[^\s{}\[\],:"]+')
MAX_FROM_DATUM_DEG = 1.0  # about 100 km: a vineyard is smaller, a swapped pair lands farther off


@dataclass
class Content:
    """The checked content: the datum (lon, lat, alt) and plain items by kind, each with `points` as lon, lat pairs."""

    datum: tuple[float, float, float]
    items: dict[str, list[dict[str, Any]]]
    plants: list[dict[str, Any]]  # vines and nails in the order of the file


def read_checked(path: Path) -> Content:
    """The content of a site file.

    Raises:
        FileError: with every problem of the file.
    """
    text = read_text(path, MAX_BYTES)
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        problem = Problem(
            file=str(path),
            line=error.lineno,
            column=error.colno,
            got=f"not JSON: {error.msg}",
            allowed="a GeoJSON file",
        )
        raise FileError([problem]) from None
    except (ValueError, RecursionError) as error:
        got = "nested too deeply" if isinstance(error, RecursionError) else f"not JSON: {str(error)[:80]}"
        raise FileError([Problem(file=str(path), got=got, allowed="a GeoJSON file")]) from None
    report, content = Report(), None
    with suppress(TooMany):
        content = _document(document, report)
    if report.found or content is None:
        raise FileError(_located(str(path), text, report.found))
    return content


def _located(file: str, text: str, found: list[tuple[Key, str, str, str]]) -> Iterator[Problem]:
    wanted = {path[:length] for path, *_ in found for length in range(len(path) + 1)}
    document = Document(file=file, data={}, places=_places(text, wanted))
    for path, got, allowed, suggestion in found:
        yield document.problem(path, got, allowed, suggestion)


def _places(text: str, wanted: Set[Key]) -> dict[Key, tuple[int, int]]:
    """Line and column of the wanted members (at their names) and list items of a valid JSON text.

    The YAML parser knows places too, but takes 10 s for a vineyard of 3 000 plants.
    """
    newlines = [-1, *(k for k, letter in enumerate(text) if letter == "\n")]
    places: dict[Key, tuple[int, int]] = {}
    open_: list[tuple[Key, bool]] = []  # the containers around the token: path, and whether it is an object
    key: str | int | None = None  # of the value that comes next in the innermost container; None before a name
    for match in _TOKEN.finditer(text):
        token = match[0]
        path, in_object = open_[-1] if open_ else ((), False)
        if token in "}]":
            open_.pop()
            key = path[-1] if path else None
        elif token == ",":
            key = None if in_object else int(key or 0) + 1
        elif token != ":":
            names = in_object and key is None
            if names:
                key = json.loads(token)
            here = (*path, key) if open_ and key is not None else path
            if (names or not in_object) and here in wanted:
                line = bisect_right(newlines, match.start()) - 1
                places[here] = (line + 1, match.start() - newlines[line])
            if not names and token in "{[":
                open_.append((here, token == "{"))
                key = None if token == "{" else 0
    return places


def _document(document: Any, report: Report) -> Content | None:
    if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
        got = document.get("type") if isinstance(document, dict) else type(document).__name__
        report.add((), f"got {short(got)} at the top", "a GeoJSON FeatureCollection")
        return None
    features = document.get("features")
    if not isinstance(features, list):
        report.add(("features",), f"got {short(features)}", "a list of features")
        return None
    datum = _datum(document.get("datum"), report)
    read: list[tuple[Key, dict[str, Any] | None]] = [
        (("features", k), check_feature(f, ("features", k), report)) for k, f in enumerate(features)
    ]
    good = [(path, item) for path, item in read if item is not None]
    items: dict[str, list[dict[str, Any]]] = {kind: [] for kind in GEOMETRIES}
    for _, item in good:
        items[item["kind"]].append(item)
    _relations(good, _row_ids(features), len(items["start"]), report)
    if datum is None:
        datum = _default_datum(items)
    if datum is not None:
        _near_datum(good, datum, report)
    plants = [item for _, item in good if item["kind"] in PLANTS]
    return Content(datum or (0.0, 0.0, 0.0), items, plants)


def _datum(value: Any, report: Report) -> tuple[float, float, float] | None:
    if value is None:
        return None
    if not isinstance(value, dict):
        report.add(("datum",), f"got {short(value)}", "an object with lat, lon and alt")
        return None
    numbers = []
    for key, low, high, default in (("lon", -180, 180, None), ("lat", -90, 90, None), ("alt", -1000, 9000, 0.0)):
        number = value.get(key, default)
        if not is_number(number) or not low <= number <= high:
            report.add(("datum", key), f"got {short(number)}", f"a number in {low} .. {high}")
            return None
        numbers.append(float(number))
    return numbers[0], numbers[1], numbers[2]


def _default_datum(items: dict[str, list[dict[str, Any]]]) -> tuple[float, float, float] | None:
    """GIS programs drop foreign members on saving: the map frame then starts at the robot's start."""
    for kind in ("start", "row"):
        for item in items[kind]:
            lon, lat = item["points"][0]
            return lon, lat, 0.0
    return None


def _near_datum(good: list[tuple[Key, dict[str, Any]]], datum: tuple[float, float, float], report: Report) -> None:
    def far(lon: float, lat: float) -> bool:
        turn = abs(lon - datum[0]) % 360.0
        return max(min(turn, 360.0 - turn) * math.cos(math.radians(datum[1])), abs(lat - datum[1])) > MAX_FROM_DATUM_DEG

    for path, item in good:
        for lon, lat in item["points"]:
            if far(lon, lat):
                swapped = "" if far(lat, lon) else "longitude and latitude look swapped"
                got = f"position [{lon}, {lat}] is more than 100 km from the datum"
                report.add((*path, "geometry", "coordinates"), got, f"positions near {datum[:2]}", swapped)
                break


def _row_ids(features: list[Any]) -> list[str]:
    """Ids of all rows, also of those with other problems, so that their plants are not blamed."""
    properties = [f["properties"] for f in features if isinstance(f, dict) and isinstance(f.get("properties"), dict)]
    return [str(p["id"]) for p in properties if p.get("kind") == "row" and "id" in p]


def _relations(good: list[tuple[Key, dict[str, Any]]], rows: list[str], starts: int, report: Report) -> None:
    ids: set[str] = set()
    markers: set[int] = set()
    for path, item in good:
        at = (*path, "properties")
        if item["id"] in ids:
            report.add((*at, "id"), f"id {item['id']!r} is used twice", "an id of its own for every feature")
        ids.add(item["id"])
        if item["kind"] in PLANTS and item["row"] not in rows:
            hint = did_you_mean(item["row"], rows)
            report.add((*at, "row"), f"unknown row {item['row']!r}", ", ".join(rows) or "the id of a row", hint)
        for marker in item.get("markers", ()):
            if marker in markers:
                report.add((*at, "markers"), f"marker {marker} belongs to two nails", "each marker at one nail")
            markers.add(marker)
    if not rows and not report.found:
        report.add(("features",), "no row", "at least one feature of kind row")
    if starts != 1 and not report.found:
        report.add(("features",), f"{starts} starts", "exactly one feature of kind start")
