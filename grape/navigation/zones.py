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
from grape.site_features import crosses_itself, is_number


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
        InvalidInput: a ring that is open or crosses itself, a hole, a line without width, or no polygon or line.
    """
    kind = document.get("type") if isinstance(document, Mapping) else document
    if kind == "FeatureCollection":
        return tuple(p for part in _parts(document, "features") for p in polygons_from_geojson(part, datum, width))
    if kind == "Feature":
        if document.get("geometry") is None:  # RFC 7946: a feature without a place
            return ()
        own = (document.get("properties") or {}).get("width_m", width)
        return polygons_from_geojson(document["geometry"], datum, own)
    if kind == "GeometryCollection":
        return tuple(p for part in _parts(document, "geometries") for p in polygons_from_geojson(part, datum, width))
    if kind == "Polygon":
        return (_ring(_parts(document, "coordinates"), datum),)
    if kind == "MultiPolygon":
        return tuple(_ring(rings, datum) for rings in _parts(document, "coordinates"))
    if kind in ("LineString", "MultiLineString"):
        if not (is_number(width) and width > 0):
            raise InvalidInput(f"a {kind} needs a width over 0 m: the property width_m, or the argument, got {width}")
        places = _parts(document, "coordinates")
        lines = [places] if kind == "LineString" else places
        return tuple(strip for line in lines for strip in _strips(_map_points(line, datum, least=2), width))
    raise InvalidInput(f"got GeoJSON of type {kind!r}; areas are Polygon, MultiPolygon, LineString, MultiLineString")


def _parts(document: Mapping[str, Any], key: str) -> list[Any]:
    parts = document.get(key)
    if not isinstance(parts, list):
        raise InvalidInput(f"a {document['type']} has a list of {key}, got {parts!r:.60}")
    return parts


def _ring(rings: Any, datum: Datum) -> Array:
    if not isinstance(rings, list) or len(rings) != 1:
        got = f"{len(rings)} rings" if isinstance(rings, list) else f"{rings!r:.60}"
        raise InvalidInput(f"a prohibited polygon has one ring and no holes, got {got}")
    points = _map_points(rings[0], datum, least=4)
    if (points[0] != points[-1]).any():
        raise InvalidInput(f"a ring ends at its first position, got {rings[0][0]} and {rings[0][-1]}")
    if crosses_itself(points):
        raise InvalidInput(f"a ring does not cross itself, the one from {rings[0][0]} does")
    return points[:-1]


def _map_points(positions: Any, datum: Datum, least: int) -> Array:
    try:
        places = np.array([[float(number) for number in position[:2]] for position in positions])
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"positions are [longitude, latitude], got {positions!r:.60}") from error
    if places.shape != (len(positions), 2) or len(places) < least or not (np.abs(places) <= [180.0, 90.0]).all():
        raise InvalidInput(f"at least {least} positions in -180 .. 180 and -90 .. 90, got {positions!r:.60}")
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
