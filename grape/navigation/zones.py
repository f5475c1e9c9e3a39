"""Areas that somebody drew: prohibited ones and slow ones, of a site or of any GeoJSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from grape.errors import InvalidInput
from grape.geodesy import Datum, enu_from_geodetic
from grape.messages import Array, frozen_array
from grape.navigation.costmap import PolygonLayer
from grape.navigation.polygon import in_polygon
from grape.navigation.route import RouteOptions, row_zones
from grape.site import Site


def prohibited(site: Site, options: RouteOptions | None = None) -> PolygonLayer:
    """A layer of the site's fences and of the strips along its rows."""
    return PolygonLayer([*(fence.polygon for fence in site.fences), *row_zones(site.rows, options)])


def polygons_from_geojson(document: Mapping[str, Any], datum: Datum, width: float | None = None) -> tuple[Array, ...]:
    """Polygons (n, 2) m in map of a GeoJSON object in WGS84 (RFC 7946): outer rings, and lines widened to strips.

    Args:
        document: a FeatureCollection, Feature or geometry, parsed.
        datum: origin of map.
        width: m of lines whose feature has no property `width_m`; None refuses them.

    Raises:
        InvalidInput: a polygon with holes, a line without width, or what is no polygon or line.
    """
    kind = document.get("type")
    if kind == "FeatureCollection":
        return tuple(p for feature in document["features"] for p in polygons_from_geojson(feature, datum, width))
    if kind == "Feature":
        own = (document.get("properties") or {}).get("width_m", width)
        return polygons_from_geojson(document["geometry"], datum, own)
    if kind == "GeometryCollection":
        return tuple(p for part in document["geometries"] for p in polygons_from_geojson(part, datum, width))
    places = document.get("coordinates")
    if kind == "Polygon":
        return (_ring(places, datum),)
    if kind == "MultiPolygon":
        return tuple(_ring(rings, datum) for rings in places or ())
    if kind in ("LineString", "MultiLineString"):
        if width is None or not width > 0:
            raise InvalidInput(f"a {kind} needs a width over 0 m: the property width_m, or the argument, got {width}")
        lines = [places] if kind == "LineString" else places
        return tuple(strip for line in lines or () for strip in _strips(_map_points(line, datum), width))
    raise InvalidInput(f"got GeoJSON of type {kind!r}; areas are Polygon, MultiPolygon, LineString, MultiLineString")


def _ring(rings: Any, datum: Datum) -> Array:
    if not rings or len(rings) != 1:
        raise InvalidInput(f"a prohibited polygon has one ring and no holes, got {len(rings or ())} rings")
    return _map_points(rings[0], datum)[:-1]


def _map_points(positions: Any, datum: Datum) -> Array:
    places = np.asarray([position[:2] for position in positions], dtype=float)
    return enu_from_geodetic(datum, places[:, 1], places[:, 0], np.full(len(places), datum.altitude_m))[:, :2]


def _strips(points: Array, width: float) -> list[Array]:
    """A rectangle for each leg of a line, longer by half the width at both ends, so that corners are closed."""
    strips = []
    for a, b in pairwise(points):
        length = float(np.hypot(*(b - a)))
        if not length > 0:
            continue
        along = 0.5 * width * (b - a) / length
        across = np.array([-along[1], along[0]])
        strips.append(np.array([a - along - across, b + along - across, b + along + across, a - along + across]))
    return strips


@dataclass(frozen=True, kw_only=True)
class SpeedZone:
    """Where not to drive faster than `limit` m/s: inside a polygon (n, 2) m in map."""

    polygon: Array
    limit: float

    def __post_init__(self) -> None:
        polygon = frozen_array(self.polygon, float)
        if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not np.isfinite(polygon).all():
            raise InvalidInput(f"a polygon needs at least 3 finite points (n, 2), got {polygon.shape}")
        if not self.limit >= 0:
            raise InvalidInput(f"a speed limit must not be negative, got {self.limit}")
        object.__setattr__(self, "polygon", polygon)


def speed_limit(zones: Sequence[SpeedZone], point: Array) -> float:
    """The least limit (m/s) of the zones that hold a point (2,) m in map; inf outside all of them."""
    points = np.asarray(point, dtype=float)[None]
    return min((zone.limit for zone in zones if in_polygon(points, zone.polygon)[0]), default=np.inf)
