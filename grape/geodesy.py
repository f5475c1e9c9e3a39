"""WGS84: latitude and longitude, Earth-centred (ECEF) and local east-north-up (ENU) coordinates, exact and vectorised.

Source: NIMA TR8350.2 (WGS84 constants); Bowring, "Transformation from spatial to geographical coordinates", 1976.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
SEMI_MINOR_M = SEMI_MAJOR_M * (1.0 - FLATTENING)
ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
_BOWRING_STEPS = 5  # each step squares the error; two reach 1e-9 m near the ground


@dataclass(frozen=True, kw_only=True)
class Datum:
    """The origin of a local ENU frame on WGS84.

    Raises:
        InvalidInput: latitude or longitude out of range, or something is not finite.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0  # above the ellipsoid

    def __post_init__(self) -> None:
        if not abs(self.latitude_deg) <= 90.0:
            raise InvalidInput(f"a latitude must lie in -90 .. 90 degrees, got {self.latitude_deg}")
        if not abs(self.longitude_deg) <= 180.0:
            raise InvalidInput(f"a longitude must lie in -180 .. 180 degrees, got {self.longitude_deg}")
        if not np.isfinite(self.altitude_m):
            raise InvalidInput(f"an altitude must be finite, got {self.altitude_m}")


def ecef_from_geodetic(latitude_deg: Array | float, longitude_deg: Array | float, altitude_m: Array | float) -> Array:
    """ECEF points (..., 3) in metres of WGS84 latitude, longitude (deg) and ellipsoidal altitude (m)."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    normal = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_2 * np.sin(lat) ** 2)
    x, y, z = np.broadcast_arrays(
        (normal + altitude_m) * np.cos(lat) * np.cos(lon),
        (normal + altitude_m) * np.cos(lat) * np.sin(lon),
        (normal * (1.0 - ECCENTRICITY_2) + altitude_m) * np.sin(lat),
    )
    return np.stack([x, y, z], axis=-1)


def geodetic_from_ecef(points: Array) -> Array:
    """Latitude (deg), longitude (deg), altitude (m) as (..., 3) of ECEF points (..., 3) up to 10 000 km high."""
    points = np.asarray(points, dtype=float)
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    p = np.hypot(x, y)
    second_2 = ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2)
    reduced = np.arctan2(z * SEMI_MAJOR_M, p * SEMI_MINOR_M)
    for _ in range(_BOWRING_STEPS):
        lat = np.arctan2(
            z + second_2 * SEMI_MINOR_M * np.sin(reduced) ** 3,
            p - ECCENTRICITY_2 * SEMI_MAJOR_M * np.cos(reduced) ** 3,
        )
        reduced = np.arctan2((1.0 - FLATTENING) * np.sin(lat), np.cos(lat))
    # This form of the altitude stays exact at the poles, where p / cos(lat) does not.
    altitude = p * np.cos(lat) + z * np.sin(lat) - SEMI_MAJOR_M * np.sqrt(1.0 - ECCENTRICITY_2 * np.sin(lat) ** 2)
    return np.stack([np.degrees(lat), np.degrees(np.arctan2(y, x)), altitude], axis=-1)


def rotation_enu_from_ecef(datum: Datum) -> Array:
    """R_enu_ecef (3, 3): rows are east, north and up at the datum."""
    lat, lon = np.radians(datum.latitude_deg), np.radians(datum.longitude_deg)
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    return np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )


def enu_from_geodetic(
    datum: Datum, latitude_deg: Array | float, longitude_deg: Array | float, altitude_m: Array | float | None = None
) -> Array:
    """East, north, up (..., 3) in metres from the datum; an altitude of None is the datum's own."""
    altitude = datum.altitude_m if altitude_m is None else altitude_m
    origin = ecef_from_geodetic(datum.latitude_deg, datum.longitude_deg, datum.altitude_m)
    return (ecef_from_geodetic(latitude_deg, longitude_deg, altitude) - origin) @ rotation_enu_from_ecef(datum).T


def geodetic_from_enu(datum: Datum, points: Array) -> Array:
    """Latitude (deg), longitude (deg), altitude (m) as (..., 3) of ENU points (..., 3) in metres from the datum."""
    origin = ecef_from_geodetic(datum.latitude_deg, datum.longitude_deg, datum.altitude_m)
    return geodetic_from_ecef(np.asarray(points, dtype=float) @ rotation_enu_from_ecef(datum) + origin)
