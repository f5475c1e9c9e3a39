"""What each layer does to the costs below it, and how layers are put together."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geodesy import Datum, geodetic_from_enu
from grape.navigation.costmap import ObstacleLayer, PolygonLayer, layered_costmap
from grape.navigation.grid import FREE, INSCRIBED, LETHAL, UNKNOWN, Costmap, Footprint, GridSpec
from grape.navigation.layers import (
    DenoiseLayer,
    FootprintLayer,
    InflationLayer,
    StaticLayer,
    StaticOptions,
    beams_from_range,
)
from grape.navigation.rolling import LayeredCostmap, layers_of
from grape.navigation.zones import SpeedZone, polygons_from_geojson, speed_limit
from grape.plugins import PluginError

SPEC = GridSpec(x_min=0.0, y_min=0.0, columns=40, rows=20)
DATUM = Datum(latitude_deg=43.5, longitude_deg=10.5)


def painted(*layers, spec: GridSpec = SPEC, background: int = FREE) -> np.ndarray:
    cost = np.full((spec.rows, spec.columns), background, dtype=np.uint8)
    for layer in layers:
        layer.paint(cost, spec)
    return cost


def square(x: float, y: float, size: float) -> np.ndarray:
    return np.array([[x, y], [x + size, y], [x + size, y + size], [x, y + size]])


def test_static_map_of_another_resolution_lands_where_it_is():
    coarse = GridSpec(x_min=0.5, y_min=0.2, columns=4, rows=3, resolution=0.1)
    occupancy = np.zeros((3, 4))
    occupancy[1, 2], occupancy[0, 0] = 100, -1
    cost = painted(StaticLayer(occupancy, coarse))
    assert (cost[6:8, 14:16] == LETHAL).all() and (cost == LETHAL).sum() == 4
    assert (cost[4:6, 10:12] == UNKNOWN).all() and (cost == UNKNOWN).sum() == 4


@pytest.mark.parametrize(
    "options, cost",
    [(StaticOptions(), UNKNOWN), (StaticOptions(between="scale"), 126), (StaticOptions(unknown=False), FREE)],
)
def test_occupancy_between_the_thresholds(options, cost):
    one = GridSpec(x_min=0.0, y_min=0.0, columns=1, rows=1)
    assert abs(int(painted(StaticLayer(np.array([[45]]), one, options), spec=one)[0, 0]) - cost) <= 1


def test_map_never_frees_what_was_seen_unless_it_may_overwrite():
    one = GridSpec(x_min=0.0, y_min=0.0, columns=2, rows=1)
    seen = PolygonLayer([square(0.0, 0.0, 0.2)])
    free = np.zeros((1, 2))
    assert (painted(seen, StaticLayer(free, one), spec=one) == LETHAL).all()
    assert (painted(seen, StaticLayer(free, one, StaticOptions(overwrite=True)), spec=one) == FREE).all()
    nobody = StaticLayer(np.full((1, 2), -1), one)
    assert (painted(seen, nobody, spec=one) == LETHAL).all()


def test_map_far_away_changes_nothing():
    far = GridSpec(x_min=50.0, y_min=0.0, columns=2, rows=2)
    assert (painted(StaticLayer(np.full((2, 2), 100), far), background=7) == 7).all()


@pytest.mark.parametrize("occupancy", [np.zeros((2, 2)), np.full((1, 1), 101), np.full((1, 1), -2)])
def test_map_of_the_wrong_shape_or_range_is_refused(occupancy):
    with pytest.raises(InvalidInput):
        StaticLayer(occupancy, GridSpec(x_min=0.0, y_min=0.0, columns=1, rows=1))


def test_lone_cells_vanish_and_groups_stay():
    cost = np.zeros((20, 40), dtype=np.uint8)
    cost[3, 3] = cost[10, 10] = cost[11, 11] = LETHAL
    DenoiseLayer(2).paint(cost, SPEC)
    assert cost[3, 3] == FREE and cost[10, 10] == LETHAL and cost[11, 11] == LETHAL


def test_ground_under_the_robot_is_free():
    layer = FootprintLayer(Footprint(front=0.2, rear=0.2, half_width=0.1))
    everywhere = PolygonLayer([square(-1.0, -1.0, 5.0)])
    assert (painted(everywhere, layer) == LETHAL).all()  # nobody knows yet where the robot is
    layer.stand_at(np.array([1.0, 0.5, np.pi / 2]))
    cost = painted(everywhere, layer)
    rows, columns = np.nonzero(cost == FREE)
    points = SPEC.centres(np.column_stack([rows, columns]))
    assert np.abs(points - [1.0, 0.5]).max(axis=0) == pytest.approx([0.075, 0.175])
    assert len(points) == 4 * 8


def test_what_comes_after_the_inflation_is_not_inflated():
    fence = PolygonLayer([square(0.5, 0.5, 0.1)])
    exact, inflated = painted(InflationLayer(), fence), painted(fence, InflationLayer())
    assert set(np.unique(exact)) == {FREE, LETHAL}
    assert (inflated == INSCRIBED).any()


def test_echo_marks_its_arc_and_clears_its_cone():
    beams = beams_from_range(1.0, np.array([0.0, 0.5, 0.0]), np.radians(20.0), 2.5)
    assert beams.hit.all() and np.hypot(*(beams.ends - [0.0, 0.5]).T) == pytest.approx(1.0)
    assert not beams_from_range(np.inf, np.zeros(3), 0.3, 2.5).hit.any()
    with pytest.raises(InvalidInput):
        beams_from_range(np.nan, np.zeros(3), 0.3, 2.5)


def test_footprint_cost_tells_lethal_from_unknown_from_free():
    cost = np.zeros((20, 40), dtype=np.uint8)
    cost[:, 20:] = UNKNOWN
    cost[10, 30] = LETHAL
    costmap = Costmap(spec=SPEC, cost=cost)
    poses = np.array([[0.4, 0.5, 0.3], [1.0, 0.5, 0.3], [1.5, 0.5, 0.3], [-5.0, 0.5, 0.0]])
    found = costmap.footprint_cost(poses, Footprint(front=0.2, rear=0.2, half_width=0.1))
    assert found.tolist() == [FREE, UNKNOWN, LETHAL, UNKNOWN]


def test_distance_is_to_the_nearest_lethal_cell():
    cost = np.zeros((20, 40), dtype=np.uint8)
    assert (Costmap(spec=SPEC, cost=cost).distance > 100.0).all()
    cost[4, 4] = LETHAL
    distance = Costmap(spec=SPEC, cost=cost).distance
    assert distance[4, 4] == 0.0 and distance[7, 8] == pytest.approx(0.25, abs=1e-6)


def test_discs_cover_the_footprint():
    footprint = Footprint()
    centres, radius = footprint.discs(4)
    x, y = np.meshgrid(np.linspace(-0.495, 0.495, 50), np.linspace(-0.335, 0.335, 50))
    nearest = np.hypot(x[..., None] - centres, y[..., None]).min(axis=-1)
    assert nearest.max() <= radius + 1e-9 and radius < footprint.half_width + 0.03


def test_local_costmap_rolls_with_the_robot_and_keeps_what_it_saw():
    window = GridSpec.window(np.zeros(2), 4.0)
    layers = layers_of(
        {
            "scan": {"plugin": "obstacles", "spec": window},
            "fence": {"plugin": "polygons", "polygons": [square(2.2, -1.0, 0.5)]},
            "near": {"plugin": "inflation"},
        }
    )
    local = LayeredCostmap(layers, size=4.0)
    for _ in range(2):
        local.layer("scan").integrate(beams_from_range(1.02, np.zeros(3), 0.05, 3.0))
    before, after = local.update(np.zeros(3)), local.update(np.array([1.0, 0.0, 0.0]))
    seen, fence = np.array([1.02, 0.0]), np.array([2.4, -0.8])
    assert before.cost_at(seen) == LETHAL == after.cost_at(seen)
    assert before.cost_at(fence) == UNKNOWN and after.cost_at(fence) == LETHAL  # outside the window at first
    local.forget(seen, 0.5)
    assert local.update(np.array([1.0, 0.0, 0.0])).cost_at(seen) != LETHAL


def test_layers_together_are_what_layered_costmap_makes():
    polygons = PolygonLayer([square(0.5, 0.5, 0.2)])
    together = LayeredCostmap({"a": polygons, "b": InflationLayer()}, spec=SPEC).update(np.zeros(3))
    assert np.array_equal(together.cost, layered_costmap(SPEC, [polygons]).cost)


def test_costmap_says_what_it_lacks():
    with pytest.raises(InvalidInput, match="rolls"):
        LayeredCostmap({})
    with pytest.raises(InvalidInput, match="scan"):
        LayeredCostmap({"scan": ObstacleLayer(SPEC)}, spec=SPEC).layer("scann")
    with pytest.raises(PluginError):
        layers_of({"a": {"plugin": "nothing"}})
    with pytest.raises(InvalidInput, match="plugin"):
        layers_of({"a": {}})
    with pytest.raises(InvalidInput, match="argument"):
        layers_of({"a": {"plugin": "denoise", "most": 3}})


def lon_lat(points: np.ndarray) -> list[list[float]]:
    flat = np.column_stack([points, np.zeros(len(points))])
    return [[lon, lat] for lat, lon, _ in geodetic_from_enu(DATUM, flat)]


def test_geojson_gives_polygons_and_strips_in_map():
    ring = square(3.0, 4.0, 2.0)
    document = {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [lon_lat(np.vstack([ring, ring[:1]]))]}},
            {
                "type": "Feature",
                "properties": {"width_m": 0.4},
                "geometry": {"type": "LineString", "coordinates": lon_lat(np.array([[0.0, 0.0], [5.0, 0.0]]))},
            },
        ],
    }
    polygon, strip = polygons_from_geojson(document, DATUM)
    assert polygon == pytest.approx(ring, abs=1e-3)
    assert strip == pytest.approx(np.array([[-0.2, -0.2], [5.2, -0.2], [5.2, 0.2], [-0.2, 0.2]]), abs=1e-3)


CORNERS = [[10.5, 43.5], [10.6, 43.5], [10.6, 43.6], [10.5, 43.6]]


@pytest.mark.parametrize(
    ("geometry", "told"),
    [
        ({"type": "LineString", "coordinates": CORNERS[:2]}, "needs a width"),
        ({"type": "Feature", "properties": {"width_m": "2"}, "geometry": {"type": "LineString"}}, "needs a width"),
        ({"type": "Polygon", "coordinates": [[[0, 0]], [[0, 0]]]}, "one ring and no holes, got 2 rings"),
        ({"type": "Polygon", "coordinates": [CORNERS]}, "ends at its first position"),
        ({"type": "Polygon", "coordinates": [[CORNERS[k] for k in (0, 2, 1, 3, 0)]]}, "does not cross itself"),
        ({"type": "Polygon", "coordinates": [[]]}, "at least 4 positions"),
        ({"type": "Polygon", "coordinates": [[[np.nan, 1], *CORNERS]]}, "at least 4 positions in -180"),
        ({"type": "Polygon", "coordinates": [[["a", 1], *CORNERS]]}, "positions are"),
        ({"type": "Polygon", "coordinates": [[[1], *CORNERS]]}, "positions are"),
        ({"type": "MultiPolygon", "coordinates": CORNERS}, "one ring and no holes"),
        ({"type": "Polygon"}, "has a list of coordinates, got None"),
        ({"type": "FeatureCollection", "features": None}, "has a list of features, got None"),
        ({"type": "Point", "coordinates": [10.5, 43.5]}, "got GeoJSON of type 'Point'"),
        ([], "got GeoJSON of type"),
    ],
)
def test_geometry_that_is_no_area_is_refused(geometry, told):
    with pytest.raises(InvalidInput, match=told):
        polygons_from_geojson(geometry, DATUM)


def test_a_feature_without_a_place_has_no_area():
    assert polygons_from_geojson({"type": "Feature", "geometry": None}, DATUM) == ()


def test_slowest_of_the_zones_around_a_point_counts():
    zones = [SpeedZone(polygon=square(0, 0, 4), limit=0.5), SpeedZone(polygon=square(1, 1, 1), limit=0.2)]
    limits = [speed_limit(zones, np.array(p)) for p in ([1.5, 1.5], [3.0, 3.0], [9.0, 1.0])]
    assert limits == [0.2, 0.5, np.inf]
