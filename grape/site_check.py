"""Reads a vineyard's GeoJSON and finds everything that is wrong with it, with the place in the file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grape.errors import FileError, Problem, did_you_mean

MAX_BYTES = 20_000_000
MAX_FROM_DATUM_DEG = 1.0  # about 100 km: a vineyard is smaller, a swapped pair lands farther off
GEOMETRIES = {
    "row": ("LineString",),
    "vine": ("Point",),
    "nail": ("Point",),
    "headland": ("Polygon",),
    "fence": ("Polygon", "LineString"),
    "start": ("Point",),
}
SIDES = ("left", "right")
_PLANTS = ("vine", "nail")
_MARKER_IDS = range(0, 50)  # DICT_4X4_50
Path_ = tuple[str | int, ...]


@dataclass
class Content:
    """The checked content: the datum (lon, lat, alt) and plain items by kind, each with `points` as lon, lat pairs."""

    datum: tuple[float, float, float]
    items: dict[str, list[dict[str, Any]]]
    plants: list[dict[str, Any]]  # vines and nails in the order of the file


@dataclass
class _Report:
    """Collects problems by their path in the document."""

    found: list[tuple[Path_, str, str, str]] = field(default_factory=list)

    def add(self, path: Path_, got: str, allowed: str = "", suggestion: str = "") -> None:
        self.found.append((path, got, allowed, suggestion))


def read_checked(path: Path) -> Content:
    """The content of a site file.

    Raises:
        FileError: with every problem of the file.
    """
    text = _read(path)
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
    except RecursionError:
        raise FileError([Problem(file=str(path), got="nested too deeply", allowed="a GeoJSON file")]) from None
    report = _Report()
    content = _document(document, report)
    if report.found or content is None:
        raise FileError(_located(str(path), text, report.found))
    return content


def _read(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise FileError([Problem(file=str(path), got=f"{size} bytes", allowed=f"at most {MAX_BYTES} bytes")])
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        got = f"cannot be read: {error.strerror or error}"
        raise FileError([Problem(file=str(path), got=got, allowed="a readable file")]) from None
    except UnicodeDecodeError as error:
        got = f"not UTF-8 text at byte {error.start}"
        raise FileError([Problem(file=str(path), got=got, allowed="GeoJSON in UTF-8")]) from None


def _located(file: str, text: str, found: Iterable[tuple[Path_, str, str, str]]) -> Iterator[Problem]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        tree = YAML(typ="rt").load(text)  # JSON is YAML, and this parser remembers lines and columns
    except (YAMLError, ValueError, RecursionError):
        tree = None
    for path, got, allowed, suggestion in found:
        line, column = _place(tree, path)
        name = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path).lstrip(".")
        yield Problem(file=file, line=line, column=column, path=name, got=got, allowed=allowed, suggestion=suggestion)


def _place(node: Any, path: Path_) -> tuple[int, int]:
    place = (0, 0)
    for key in path:
        if not hasattr(node, "lc"):
            break
        try:
            at = node.lc.item(key) if isinstance(key, int) else node.lc.value(key)
            node = node[key]
        except (KeyError, IndexError, TypeError, AttributeError):
            break
        place = (at[0] + 1, at[1] + 1)
    return place


def _document(document: Any, report: _Report) -> Content | None:
    if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
        got = document.get("type") if isinstance(document, dict) else type(document).__name__
        report.add((), f"got {_short(got)} at the top", "a GeoJSON FeatureCollection")
        return None
    features = document.get("features")
    if not isinstance(features, list):
        report.add(("features",), f"got {_short(features)}", "a list of features")
        return None
    datum = _datum(document.get("datum"), report)
    read = [(("features", k), _feature(f, ("features", k), report)) for k, f in enumerate(features)]
    good = [(path, item) for path, item in read if item is not None]
    items: dict[str, list[dict[str, Any]]] = {kind: [] for kind in GEOMETRIES}
    for _, item in good:
        items[item["kind"]].append(item)
    _relations(good, items, report)
    if datum is None:
        datum = _default_datum(items)
    if datum is not None:
        _near_datum(good, datum, report)
    plants = [item for _, item in good if item["kind"] in _PLANTS]
    return Content(datum or (0.0, 0.0, 0.0), items, plants)


def _datum(value: Any, report: _Report) -> tuple[float, float, float] | None:
    if value is None:
        return None
    if not isinstance(value, dict):
        report.add(("datum",), f"got {_short(value)}", "an object with lat, lon and alt")
        return None
    numbers = []
    for key, low, high, default in (("lon", -180, 180, None), ("lat", -90, 90, None), ("alt", -1000, 9000, 0.0)):
        number = value.get(key, default)
        if not _is_number(number) or not low <= number <= high:
            report.add(("datum", key), f"got {_short(number)}", f"a number in {low} .. {high}")
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


def _feature(feature: Any, path: Path_, report: _Report) -> dict[str, Any] | None:
    if not isinstance(feature, dict) or not isinstance(feature.get("properties"), dict):
        report.add(path, f"got {_short(feature)}", "a Feature with geometry and properties")
        return None
    properties = feature["properties"]
    kind = properties.get("kind")
    at = (*path, "properties")
    if not isinstance(kind, str) or kind not in GEOMETRIES:
        hint = did_you_mean(kind, GEOMETRIES) if isinstance(kind, str) else ""
        report.add((*at, "kind"), f"got kind {_short(kind)}", ", ".join(GEOMETRIES), hint)
        return None
    before = len(report.found)
    geometry = feature.get("geometry")
    points = _geometry(kind, geometry, (*path, "geometry"), report)
    item: dict[str, Any] = {"kind": kind, "points": points}
    item["type"] = geometry.get("type") if isinstance(geometry, dict) else None
    _properties(item, properties, at, report)
    return item if len(report.found) == before else None


def _properties(item: dict[str, Any], properties: dict[str, Any], at: Path_, report: _Report) -> None:
    kind = item["kind"]
    item["id"] = _text(properties, "id", at, report, default="start" if kind == "start" else None)
    if kind in ("row", *_PLANTS):
        side = properties.get("side")
        if side not in SIDES and not (side is None and kind != "row"):
            hint = did_you_mean(side, SIDES) if isinstance(side, str) else ""
            report.add((*at, "side"), f"got side {_short(side)}", "left or right of the row's direction", hint)
        item["side"] = side
    if kind in _PLANTS:
        item["row"] = _text(properties, "row", at, report)
    if kind == "nail":
        item["height_m"] = _number(properties, "height_m", 0.05, 3.0, at, report)
        item["yaw_rad"] = _number(properties, "yaw_rad", -2 * math.pi, 2 * math.pi, at, report)
        item["reach_m"] = _number(properties, "reach_m", 0.0, 0.5, at, report, default=0.0)
        item["markers"] = _markers(properties.get("markers"), (*at, "markers"), report)
    if kind == "start":
        item["yaw_rad"] = _number(properties, "yaw_rad", -2 * math.pi, 2 * math.pi, at, report, default=0.0)
    if kind == "fence" and item["type"] == "LineString":
        item["width_m"] = _number(properties, "width_m", 0.02, 20.0, at, report)


def _text(properties: dict[str, Any], key: str, at: Path_, report: _Report, default: str | None = None) -> str:
    value = properties.get(key, default)
    if not isinstance(value, str) or not value.strip() or len(value) > 80:
        hint = did_you_mean(key, properties) if key not in properties else ""
        report.add((*at, key), f"got {key} {_short(value)}", "a text of 1 to 80 characters", hint)
        return ""
    return value


def _number(
    properties: dict[str, Any],
    key: str,
    low: float,
    high: float,
    at: Path_,
    report: _Report,
    default: float | None = None,
) -> float:
    value = properties.get(key)
    value = default if value is None else value
    if not _is_number(value) or not low <= value <= high:
        hint = did_you_mean(key, properties) if key not in properties else ""
        report.add((*at, key), f"got {key} {_short(value)}", f"a number in {low:g} .. {high:g}", hint)
        return 0.0
    return float(value)


def _markers(value: Any, path: Path_, report: _Report) -> list[int]:
    good = isinstance(value, list) and len(value) in (1, 2) and len(set(map(str, value))) == len(value)
    if not good or not all(type(i) is int and i in _MARKER_IDS for i in value):
        report.add(path, f"got markers {_short(value)}", "one or two different ids in 0 .. 49 (DICT_4X4_50)")
        return []
    return value


def _geometry(kind: str, geometry: Any, path: Path_, report: _Report) -> list[tuple[float, float]]:
    allowed = GEOMETRIES[kind]
    if not isinstance(geometry, dict) or geometry.get("type") not in allowed:
        got = geometry.get("type") if isinstance(geometry, dict) else geometry
        report.add((*path, "type"), f"a {kind} has geometry {_short(got)}", " or ".join(allowed))
        return []
    at = (*path, "coordinates")
    coordinates = geometry.get("coordinates")
    if geometry["type"] == "Point":
        return _positions([coordinates], at, report, nested=False)
    if geometry["type"] == "Polygon":
        if not isinstance(coordinates, list) or len(coordinates) != 1:
            report.add(at, f"got {_short(coordinates)}", "a polygon of one ring without holes")
            return []
        coordinates, at = coordinates[0], (*at, 0)
    least = 4 if geometry["type"] == "Polygon" else 2
    if not isinstance(coordinates, list) or len(coordinates) < least:
        report.add(at, f"got {_short(coordinates)}", f"a list of at least {least} positions")
        return []
    points = _positions(coordinates, at, report)
    if len(points) == len(coordinates):
        _shape(geometry["type"], points, at, report)
    return points


def _shape(type_: str, points: list[tuple[float, float]], at: Path_, report: _Report) -> None:
    if type_ == "Polygon" and points[0] != points[-1]:
        report.add(at, f"the ring ends at {points[-1]}, not at its first position {points[0]}", "a closed ring")
    if type_ == "LineString" and any(a == b for a, b in zip(points[:-1], points[1:], strict=True)):
        report.add(at, "two neighbouring positions are equal", "a line whose positions differ")


def _positions(values: list[Any], at: Path_, report: _Report, nested: bool = True) -> list[tuple[float, float]]:
    points = []
    for k, value in enumerate(values):
        path = (*at, k) if nested else at
        if not isinstance(value, list) or len(value) not in (2, 3) or not all(_is_number(v) for v in value):
            report.add(path, f"got position {_short(value)}", "[longitude, latitude] as finite numbers")
            continue
        lon, lat = float(value[0]), float(value[1])
        if abs(lon) > 180 or abs(lat) > 90:
            swapped = "longitude and latitude look swapped" if abs(lon) <= 90 and abs(lat) <= 180 else ""
            report.add(path, f"got position {value}", "longitude in -180 .. 180, latitude in -90 .. 90", swapped)
            continue
        points.append((lon, lat))
    return points


def _near_datum(good: list[tuple[Path_, dict[str, Any]]], datum: tuple[float, float, float], report: _Report) -> None:
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


def _relations(
    good: list[tuple[Path_, dict[str, Any]]], items: dict[str, list[dict[str, Any]]], report: _Report
) -> None:
    rows = [item["id"] for item in items["row"]]
    ids: set[str] = set()
    markers: set[int] = set()
    for path, item in good:
        at = (*path, "properties")
        if item["id"] in ids:
            report.add((*at, "id"), f"id {item['id']!r} is used twice", "an id of its own for every feature")
        ids.add(item["id"])
        if item["kind"] in _PLANTS and item["row"] not in rows:
            hint = did_you_mean(item["row"], rows)
            report.add((*at, "row"), f"unknown row {item['row']!r}", ", ".join(rows) or "the id of a row", hint)
        for marker in item.get("markers", ()):
            if marker in markers:
                report.add((*at, "markers"), f"marker {marker} belongs to two nails", "each marker at one nail")
            markers.add(marker)
    if not rows and not report.found:
        report.add(("features",), "no row", "at least one feature of kind row")
    if len(items["start"]) != 1 and not report.found:
        report.add(("features",), f"{len(items['start'])} starts", "exactly one feature of kind start")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _short(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "…"
