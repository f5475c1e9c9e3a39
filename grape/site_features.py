"""Checks one feature of a vineyard's GeoJSON at a time: its geometry, and the properties that its kind asks for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, TypeGuard

import numpy as np

from grape.errors import MOST_PROBLEMS, did_you_mean
from grape.messages import Array

GEOMETRIES = {
    "row": ("LineString",),
    "vine": ("Point",),
    "nail": ("Point",),
    "headland": ("Polygon",),
    "fence": ("Polygon", "LineString"),
    "start": ("Point",),
    "refill": ("Point",),
}
PLANTS = ("vine", "nail")
FEEDER, HAND, LOST, STOCK, DROPPED = "feeder", "hand", "lost", "stock", "dropped"
PLACES = (FEEDER, HAND, LOST, STOCK, DROPPED)  # of dispensers, in accounts where ids of plants are places too
SIDES = ("left", "right")
MOST_CORNERS = 10_000  # of a ring, whose every side is held against every other
_MARKER_IDS = range(0, 50)  # DICT_4X4_50
Key = tuple[str | int, ...]


class TooMany(Exception):
    """Enough problems were found."""


@dataclass
class Report:
    """Collects what is wrong as (key path in the document, what was got, what is allowed, suggestion)."""

    found: list[tuple[Key, str, str, str]] = field(default_factory=list)

    def add(self, path: Key, got: str, allowed: str = "", suggestion: str = "") -> None:
        """Notes one problem.

        Raises:
            TooMany: it was the last that is wanted.
        """
        self.found.append((path, got, allowed, suggestion))
        if len(self.found) == MOST_PROBLEMS:
            raise TooMany


def check_feature(feature: Any, path: Key, report: Report) -> dict[str, Any] | None:
    """The feature as a plain item (kind, type, points as lon, lat pairs, its properties), or None when it is wrong."""
    if not isinstance(feature, dict) or not isinstance(feature.get("properties"), dict):
        report.add(path, f"got {short(feature)}", "a Feature with geometry and properties")
        return None
    properties = feature["properties"]
    kind = properties.get("kind")
    at = (*path, "properties")
    if not isinstance(kind, str) or kind not in GEOMETRIES:
        hint = did_you_mean(kind, GEOMETRIES) if isinstance(kind, str) else ""
        report.add((*at, "kind"), f"got kind {short(kind)}", ", ".join(GEOMETRIES), hint)
        return None
    before = len(report.found)
    geometry = feature.get("geometry")
    points = _geometry(kind, geometry, (*path, "geometry"), report)
    item: dict[str, Any] = {"kind": kind, "points": points}
    item["type"] = geometry.get("type") if isinstance(geometry, dict) else None
    _properties(item, properties, at, report)
    return item if len(report.found) == before else None


def _properties(item: dict[str, Any], properties: dict[str, Any], at: Key, report: Report) -> None:
    kind = item["kind"]
    item["id"] = _text(properties, "id", at, report, default="start" if kind == "start" else None)
    if kind in ("row", *PLANTS):
        side = properties.get("side")
        if side not in SIDES and not (side is None and kind != "row"):
            hint = did_you_mean(side, SIDES) if isinstance(side, str) else ""
            report.add((*at, "side"), f"got side {short(side)}", "left or right of the row's direction", hint)
        item["side"] = side
    if kind in PLANTS:
        if item["id"] in PLACES:
            allowed = f"any id but {', '.join(PLACES)}, which the account has for places of dispensers"
            report.add((*at, "id"), f"got id {item['id']!r}", allowed)
        item["row"] = _text(properties, "row", at, report)
    if kind == "nail":
        item["height_m"] = _number(properties, "height_m", 0.05, 3.0, at, report)
        item["yaw_rad"] = _number(properties, "yaw_rad", -2 * math.pi, 2 * math.pi, at, report)
        item["reach_m"] = _number(properties, "reach_m", 0.0, 0.5, at, report, default=0.0)
        item["markers"] = _markers(properties.get("markers"), (*at, "markers"), report)
    if kind in ("start", "refill"):
        default = 0.0 if kind == "start" else None
        item["yaw_rad"] = _number(properties, "yaw_rad", -2 * math.pi, 2 * math.pi, at, report, default=default)
    if kind == "fence" and item["type"] == "LineString":
        item["width_m"] = _number(properties, "width_m", 0.02, 20.0, at, report)


def _text(properties: dict[str, Any], key: str, at: Key, report: Report, default: str | None = None) -> str:
    value = properties.get(key, default)
    if not isinstance(value, str) or not value.strip() or len(value) > 80 or not value.isprintable():
        hint = did_you_mean(key, properties) if key not in properties else ""
        report.add((*at, key), f"got {key} {short(value)}", "a text of 1 to 80 printable characters", hint)
        return ""
    return value


def _number(
    properties: dict[str, Any],
    key: str,
    low: float,
    high: float,
    at: Key,
    report: Report,
    default: float | None = None,
) -> float:
    value = properties.get(key)
    value = default if value is None else value
    if not is_number(value) or not low <= value <= high:
        hint = did_you_mean(key, properties) if key not in properties else ""
        report.add((*at, key), f"got {key} {short(value)}", f"a number in {low:g} .. {high:g}", hint)
        return 0.0
    return float(value)


def _markers(value: Any, path: Key, report: Report) -> list[int]:
    good = isinstance(value, list) and len(value) in (1, 2) and len(set(map(str, value))) == len(value)
    if not good or not all(type(i) is int and i in _MARKER_IDS for i in value):
        report.add(path, f"got markers {short(value)}", "one or two different ids in 0 .. 49 (DICT_4X4_50)")
        return []
    return value


def _geometry(kind: str, geometry: Any, path: Key, report: Report) -> list[tuple[float, float]]:
    allowed = GEOMETRIES[kind]
    if not isinstance(geometry, dict) or geometry.get("type") not in allowed:
        got = geometry.get("type") if isinstance(geometry, dict) else geometry
        report.add((*path, "type"), f"a {kind} has geometry {short(got)}", " or ".join(allowed))
        return []
    at = (*path, "coordinates")
    coordinates = geometry.get("coordinates")
    if geometry["type"] == "Point":
        return _positions([coordinates], at, report, nested=False)
    if geometry["type"] == "Polygon":
        if not isinstance(coordinates, list) or len(coordinates) != 1:
            report.add(at, f"got {short(coordinates)}", "a polygon of one ring without holes")
            return []
        coordinates, at = coordinates[0], (*at, 0)
    least = 4 if geometry["type"] == "Polygon" else 2
    if not isinstance(coordinates, list) or len(coordinates) < least:
        report.add(at, f"got {short(coordinates)}", f"a list of at least {least} positions")
        return []
    points = _positions(coordinates, at, report)
    if len(points) == len(coordinates):
        _shape(geometry["type"], points, at, report)
    return points


def _shape(type_: str, points: list[tuple[float, float]], at: Key, report: Report) -> None:
    if type_ == "Polygon" and points[0] != points[-1]:
        report.add(at, f"the ring ends at {points[-1]}, not at its first position {points[0]}", "a closed ring")
    elif type_ == "Polygon" and len(set(points)) < 3:
        report.add(at, f"the ring has {len(set(points))} different positions", "at least 3 different ones")
    elif type_ == "Polygon" and len(points) > MOST_CORNERS:
        report.add(at, f"a ring of {len(points)} positions", f"at most {MOST_CORNERS}")
    elif type_ == "Polygon" and crosses_itself(points):
        report.add(at, "the ring crosses itself, so what is inside is not known", "a ring whose sides do not cross")
    if type_ == "LineString" and any(a == b for a, b in pairwise(points)):
        report.add(at, "two neighbouring positions are equal", "a line whose positions differ")


def crosses_itself(ring: Sequence[Sequence[float]] | Array) -> bool:
    """Whether two sides of a closed ring cross; sides that only touch do not."""
    corners = np.array(ring) - ring[0]  # near zero: differences of degrees are small
    starts, ends = corners[:-1], corners[1:]
    for k in range(len(starts) - 2):
        a, b, c, d = starts[k], ends[k], starts[k + 2 :], ends[k + 2 :]
        apart = (_side(a, b, c) * _side(a, b, d) < 0) & (_side(c, d, a) * _side(c, d, b) < 0)
        if apart.any():
            return True
    return False


def _side(a: Array, b: Array, p: Array) -> Array:
    """On which side of the line a → b a position lies: positive on the left, 0 on it."""
    ab, ap = b - a, p - a
    side: Array = np.sign(ab[..., 0] * ap[..., 1] - ab[..., 1] * ap[..., 0])
    return side


def _positions(values: list[Any], at: Key, report: Report, nested: bool = True) -> list[tuple[float, float]]:
    points = []
    for k, value in enumerate(values):
        path = (*at, k) if nested else at
        if not isinstance(value, list) or len(value) not in (2, 3) or not all(is_number(v) for v in value):
            report.add(path, f"got position {short(value)}", "[longitude, latitude] as finite numbers")
            continue
        lon, lat = float(value[0]), float(value[1])
        if abs(lon) > 180 or abs(lat) > 90:
            swapped = "longitude and latitude look swapped" if abs(lon) <= 90 and abs(lat) <= 180 else ""
            report.add(path, f"got position {value}", "longitude in -180 .. 180, latitude in -90 .. 90", swapped)
            continue
        points.append((lon, lat))
    return points


def is_number(value: Any) -> TypeGuard[float]:
    """Whether it is a finite number of sensible size, and no bool."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e15


def short(value: Any) -> str:
    """What was got, cut to fit on a line."""
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "…"
