"""The vineyard as a user surveys it: rows, plants, headlands, fences and the start, from GeoJSON in WGS84.

On disk everything is longitude and latitude, so GIS programs open it; in memory everything is 2-D metres in the local
ENU `map` frame of the datum. The format is described in `save_site` and checked by `load_site`.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, fields
from itertools import count, islice, pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from grape.errors import InvalidInput, with_suggestion
from grape.geodesy import Datum, enu_from_geodetic, geodetic_from_enu
from grape.messages import Array, frozen_array
from grape.site_check import read_checked

Side = Literal["left", "right"]
PlantKind = Literal["vine", "nail"]
_DECIMALS = 10  # of a degree: 0.01 mm


class _Frozen:
    """Copies the arrays of a frozen dataclass and makes them read-only."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, field.name, frozen_array(value, float))


@dataclass(frozen=True, kw_only=True)
class Row(_Frozen):
    """A row of vines. `side` is the side of the line, seen from its first to its last point, that is worked from."""

    id: str
    side: Side
    line: Array  # (n, 2) m, map frame

    @property
    def direction(self) -> Array:
        """(2,) unit vector from the first to the last point."""
        d = self.line[-1] - self.line[0]
        return d / np.linalg.norm(d)

    @property
    def aisle_normal(self) -> Array:
        """(2,) unit vector from the row into the aisle it is worked from."""
        d = self.direction
        return np.array([-d[1], d[0]]) if self.side == "left" else np.array([d[1], -d[0]])

    @property
    def work_direction(self) -> Array:
        """(2,) unit vector in which a robot drives that has this row on its left."""
        return self.direction if self.side == "right" else -self.direction


@dataclass(frozen=True, kw_only=True)
class Plant(_Frozen):
    """A place that gets a dispenser: a vine, or a nail in a post.

    `position` is where trunk or post stands. For a nail, `height_m` is its tip above the ground, `yaw_rad` the
    direction it points to (0 east, pi/2 north), `reach_m` how far the tip stands out from `position`, and `markers`
    the ids left and right of it as the robot sees them.
    """

    id: str
    row: str
    kind: PlantKind
    side: Side
    position: Array  # (2,) m, map frame
    markers: tuple[int, ...] = ()
    height_m: float = 0.0
    yaw_rad: float = 0.0
    reach_m: float = 0.0

    @property
    def target(self) -> Array:
        """(2,) where the dispenser goes as far as the survey tells: the nail's tip, or the trunk."""
        return self.position + self.reach_m * np.array([math.cos(self.yaw_rad), math.sin(self.yaw_rad)])


@dataclass(frozen=True, kw_only=True)
class Area(_Frozen):
    """A polygon on the ground: a headland, or a fence that no part of the path may enter."""

    id: str
    polygon: Array  # (n, 2) m, map frame, not closed


@dataclass(frozen=True, kw_only=True)
class RefillPoint(_Frozen):
    """Where the robot stands to have its feeder refilled."""

    id: str
    position: Array  # (2,) m of base_link, map frame
    yaw_rad: float  # 0 east, pi/2 north


@dataclass(frozen=True, kw_only=True)
class Site(_Frozen):
    """A vineyard in the local ENU frame of its datum."""

    datum: Datum
    rows: tuple[Row, ...]
    plants: tuple[Plant, ...]
    headlands: tuple[Area, ...]
    fences: tuple[Area, ...]
    start: Array  # (2,) m, map frame
    start_heading_rad: float  # 0 east, pi/2 north
    refills: tuple[RefillPoint, ...] = ()

    def row(self, id: str) -> Row:
        """The row with this id.

        Raises:
            InvalidInput: there is no such row.
        """
        return _find(self.rows, id, "row")

    def plant(self, id: str) -> Plant:
        """The plant with this id.

        Raises:
            InvalidInput: there is no such plant.
        """
        return _find(self.plants, id, "plant")


def _find(things: Iterable[Any], id: str, what: str) -> Any:
    by_id = {thing.id: thing for thing in things}
    if id not in by_id:
        raise InvalidInput(with_suggestion(f"the site has no {what} {id!r}; it has {', '.join(by_id)}", id, by_id))
    return by_id[id]


def load_site(path: str | os.PathLike[str]) -> Site:
    """Reads and checks a vineyard's GeoJSON.

    Raises:
        FileError: with every problem of the file, each with its line and column.
    """
    content = read_checked(Path(path))
    datum = Datum(
        latitude_deg=content.datum[1],
        longitude_deg=content.datum[0],
        altitude_m=content.datum[2],
    )

    def local(lon_lat: list[list[float]]) -> Array:
        points = np.array(lon_lat)
        return enu_from_geodetic(datum, points[:, 1], points[:, 0])[:, :2]

    sides = {item["id"]: item["side"] for item in content.items["row"]}
    ids = {item["id"] for items in content.items.values() for item in items}
    fences: list[Area] = []
    for item in content.items["fence"]:
        points = local(item["points"])
        rings = [points[:-1]] if item["type"] == "Polygon" else list(_strips(points, item["width_m"]))
        names = [item["id"], *islice(_free_ids(item["id"], ids), len(rings) - 1)]
        ids.update(names)
        fences += [Area(id=name, polygon=ring) for name, ring in zip(names, rings, strict=True)]
    start = content.items["start"][0]
    return Site(
        datum=datum,
        rows=tuple(Row(id=i["id"], side=i["side"], line=local(i["points"])) for i in content.items["row"]),
        plants=tuple(_plant(i, local(i["points"])[0], sides) for i in content.plants),
        headlands=tuple(Area(id=i["id"], polygon=local(i["points"])[:-1]) for i in content.items["headland"]),
        fences=tuple(fences),
        start=local(start["points"])[0],
        start_heading_rad=start["yaw_rad"],
        refills=tuple(
            RefillPoint(id=i["id"], position=local(i["points"])[0], yaw_rad=i["yaw_rad"])
            for i in content.items["refill"]
        ),
    )


def _plant(item: dict[str, Any], position: Array, sides: dict[str, Side]) -> Plant:
    known = {key: item[key] for key in ("height_m", "yaw_rad", "reach_m") if item.get(key) is not None}
    return Plant(
        id=item["id"],
        row=item["row"],
        kind=item["kind"],
        side=item["side"] or sides[item["row"]],
        position=position,
        markers=tuple(item.get("markers") or ()),
        **known,
    )


def _free_ids(id: str, taken: Container[str]) -> Iterator[str]:
    """`id#1`, `id#2`, … as far as nothing has them, cut so that a site file may have them."""
    return (free for k in count(1) if (free := f"{id[:70]}#{k}") not in taken)


def _strips(line: Array, width: float) -> Iterable[Array]:
    """A rectangle (4, 2) around each segment of a line, half a width longer at both ends so that corners close."""
    for a, b in pairwise(line):
        along = (b - a) / np.linalg.norm(b - a) * width / 2
        across = np.array([-along[1], along[0]])
        yield np.array([a - along - across, b + along - across, b + along + across, a - along + across])


def save_site(site: Site, path: str | os.PathLike[str]) -> None:
    """Writes a site as GeoJSON that `load_site` reads back within 0.1 mm; the file appears whole or not at all."""
    path = Path(path)
    part = path.with_name(path.name + ".part")
    part.write_text(site_to_geojson(site), encoding="utf-8")
    part.replace(path)


def site_to_geojson(site: Site) -> str:
    """The text of a site's GeoJSON: one feature a line, `properties.kind` says what it is.

    row LineString (id, side) · vine and nail Point (id, row, side; nails also markers, height_m, yaw_rad, reach_m) ·
    headland and fence Polygon (id; a fence may also be a LineString with width_m) · start Point (yaw_rad) ·
    refill Point (id, yaw_rad). The foreign member `datum` (lat, lon, alt) is the origin of the map frame.
    """

    def lon_lat(points: Array) -> list[list[float]]:
        flat = np.column_stack([np.atleast_2d(points), np.zeros(len(np.atleast_2d(points)))])
        return [[round(lon, _DECIMALS), round(lat, _DECIMALS)] for lat, lon, _ in geodetic_from_enu(site.datum, flat)]

    def ring(area: Area) -> list[list[list[float]]]:
        points = lon_lat(area.polygon)
        return [[*points, points[0]]]

    features = [_feature("LineString", lon_lat(row.line), kind="row", id=row.id, side=row.side) for row in site.rows]
    for plant in site.plants:
        more: dict[str, Any] = {}
        if plant.kind == "nail":
            more = {"markers": list(plant.markers), "height_m": round(plant.height_m, 4)}
            more |= {"yaw_rad": round(plant.yaw_rad, 6), "reach_m": round(plant.reach_m, 4)}
        place = lon_lat(plant.position)[0]
        features.append(_feature("Point", place, kind=plant.kind, id=plant.id, row=plant.row, side=plant.side, **more))
    features += [_feature("Polygon", ring(area), kind="headland", id=area.id) for area in site.headlands]
    features += [_feature("Polygon", ring(area), kind="fence", id=area.id) for area in site.fences]
    heading = round(site.start_heading_rad, 6)
    taken = {feature["properties"]["id"] for feature in features} | {refill.id for refill in site.refills}
    start = "start" if "start" not in taken else next(_free_ids("start", taken))
    features.append(_feature("Point", lon_lat(site.start)[0], kind="start", id=start, yaw_rad=heading))
    for refill in site.refills:
        yaw = round(refill.yaw_rad, 6)
        features.append(_feature("Point", lon_lat(refill.position)[0], kind="refill", id=refill.id, yaw_rad=yaw))
    datum = {"lat": site.datum.latitude_deg, "lon": site.datum.longitude_deg, "alt": site.datum.altitude_m}
    lines = ",\n".join("    " + json.dumps(feature) for feature in features)
    head = f'{{\n  "type": "FeatureCollection",\n  "datum": {json.dumps(datum)},\n  "features": [\n'
    return head + lines + "\n  ]\n}\n"


def _feature(geometry: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": geometry, "coordinates": coordinates}}
