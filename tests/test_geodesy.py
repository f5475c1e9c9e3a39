import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geodesy import (
    Datum,
    ecef_from_geodetic,
    enu_from_geodetic,
    geodetic_from_ecef,
    geodetic_from_enu,
    rotation_enu_from_ecef,
)

GARRIGUELLA = Datum(latitude_deg=42.3415, longitude_deg=3.0632, altitude_m=60.0)


def test_the_axes_of_the_ellipsoid_are_those_of_wgs84():
    points = ecef_from_geodetic(np.array([0.0, 0.0, 90.0, -90.0]), np.array([0.0, 90.0, 0.0, 0.0]), 0.0)
    expected = [[6378137, 0, 0], [0, 6378137, 0], [0, 0, 6356752.314245], [0, 0, -6356752.314245]]
    np.testing.assert_allclose(points, expected, atol=1e-6)


def test_a_published_point_converts_to_ecef():
    # Worked example of GPS textbooks: 45 N, 45 E, height 0.
    x = 6378137.0 / np.sqrt(1 - 0.00669437999014 * 0.5) * 0.5
    np.testing.assert_allclose(
        ecef_from_geodetic(45.0, 45.0, 0.0), [x, x, x * np.sqrt(2) * (1 - 0.00669437999014)], atol=1e-5
    )
    np.testing.assert_allclose(x, 3194419.145, atol=1e-3)


def test_ecef_round_trip_is_exact_everywhere():
    lat, lon, alt = (
        a.ravel()
        for a in np.meshgrid(np.linspace(-90, 90, 19), np.linspace(-179, 180, 13), [-5000.0, 0.0, 60.0, 9000.0, 1e7])
    )
    points = ecef_from_geodetic(lat, lon, alt)
    back = geodetic_from_ecef(points)
    np.testing.assert_allclose(ecef_from_geodetic(back[:, 0], back[:, 1], back[:, 2]), points, atol=1e-7)
    np.testing.assert_allclose(back[:, 0], lat, atol=1e-12)
    np.testing.assert_allclose(back[:, 2], alt, atol=1e-7)


def test_enu_axes_point_east_north_and_up():
    R = rotation_enu_from_ecef(GARRIGUELLA)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    lat, lon, alt = GARRIGUELLA.latitude_deg, GARRIGUELLA.longitude_deg, GARRIGUELLA.altitude_m
    enu = enu_from_geodetic(GARRIGUELLA, [lat, lat + 1e-5, lat], [lon + 1e-5, lon, lon], [alt, alt, alt + 1.0])
    assert enu[0, 0] > 0.8 and abs(enu[0, 1]) < 1e-5
    assert enu[1, 1] > 1.1 and abs(enu[1, 0]) < 1e-9
    np.testing.assert_allclose(enu[2], [0, 0, 1], atol=1e-8)


def test_metres_per_degree_match_the_radii_of_curvature():
    lat = np.radians(GARRIGUELLA.latitude_deg)
    e2 = 0.00669437999014
    w = 1 - e2 * np.sin(lat) ** 2
    meridian = 6378137 * (1 - e2) / w**1.5 + 60.0
    normal = 6378137 / np.sqrt(w) + 60.0
    step = 1e-6
    enu = enu_from_geodetic(
        GARRIGUELLA,
        [GARRIGUELLA.latitude_deg + step, GARRIGUELLA.latitude_deg],
        [GARRIGUELLA.longitude_deg, GARRIGUELLA.longitude_deg + step],
    )
    np.testing.assert_allclose(enu[0, 1], np.radians(step) * meridian, rtol=1e-6)
    np.testing.assert_allclose(enu[1, 0], np.radians(step) * normal * np.cos(lat), rtol=1e-6)


@pytest.mark.parametrize("datum", [GARRIGUELLA, Datum(latitude_deg=-84.9, longitude_deg=180.0, altitude_m=3000.0)])
def test_enu_round_trip_stays_below_a_micrometre(datum):
    points = np.random.default_rng(3).uniform(-2000, 2000, (200, 3))
    g = geodetic_from_enu(datum, points)
    np.testing.assert_allclose(enu_from_geodetic(datum, g[:, 0], g[:, 1], g[:, 2]), points, atol=1e-6)


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"latitude_deg": 91.0, "longitude_deg": 0.0}, "latitude"),
        ({"latitude_deg": float("nan"), "longitude_deg": 0.0}, "latitude"),
        ({"latitude_deg": 0.0, "longitude_deg": 181.0}, "longitude"),
        ({"latitude_deg": 0.0, "longitude_deg": 0.0, "altitude_m": float("inf")}, "altitude"),
    ],
)
def test_a_datum_off_the_globe_is_refused(values, word):
    with pytest.raises(InvalidInput, match=word):
        Datum(**values)
