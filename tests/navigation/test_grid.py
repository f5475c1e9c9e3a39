from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.navigation.costmap import Beams, InflationOptions, ObstacleLayer, PolygonLayer, inflate, layered_costmap
from grape.navigation.grid import FREE, INSCRIBED, LETHAL, UNKNOWN, Costmap, Footprint, GridSpec

SPEC = GridSpec(x_min=-5.0, y_min=-5.0, columns=200, rows=200)
SQUARE = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]])


def beam(end, hit=True, sensor=(0.0, 0.0)) -> Beams:
    return Beams(sensor=np.array(sensor), ends=np.array([end]), hit=np.array([hit]))


def marked(layer: ObstacleLayer) -> np.ndarray:
    """Centres (n, 2) of the obstacle cells of a layer."""
    cost = np.zeros((layer.spec.rows, layer.spec.columns), dtype=np.uint8)
    layer.paint(cost, layer.spec)
    return layer.spec.centres(np.argwhere(cost == LETHAL))


def test_cells_and_centres_are_inverse():
    cells = np.array([[0, 0], [17, 42], [199, 199]])
    assert np.array_equal(SPEC.cells(SPEC.centres(cells)), cells)


@pytest.mark.parametrize("columns, rows, resolution", [(0, 5, 0.1), (5, 5, 0.0), (100_000, 100_000, 0.1)])
def test_grid_of_impossible_size_is_refused(columns, rows, resolution):
    with pytest.raises(InvalidInput):
        GridSpec(x_min=0.0, y_min=0.0, columns=columns, rows=rows, resolution=resolution)


def test_costs_outside_the_grid_are_unknown():
    costmap = layered_costmap(SPEC, [])
    assert costmap.cost_at([99.0, 0.0]) == UNKNOWN
    assert costmap.cost_at([0.0, 0.0]) == FREE


def test_costs_of_wrong_shape_are_refused():
    with pytest.raises(InvalidInput):
        Costmap(spec=SPEC, cost=np.zeros((3, 3), dtype=np.uint8))


def test_inflation_is_inscribed_near_and_fades_with_distance():
    cost = np.zeros((200, 200), dtype=np.uint8)
    cost[100, 100] = LETHAL
    raised = inflate(cost, 0.05, InflationOptions(inscribed=0.335, radius=0.8))
    line = raised[100, 100:].astype(int)
    assert line[0] == LETHAL and (line[1:7] == INSCRIBED).all()
    assert (np.diff(line[7:17]) < 0).all() and (line[17:] == FREE).all()


def test_unknown_cells_stay_unknown_away_from_obstacles():
    cost = np.full((200, 200), UNKNOWN, dtype=np.uint8)
    cost[100, 100] = LETHAL
    raised = inflate(cost, 0.05, InflationOptions())
    assert raised[0, 0] == UNKNOWN and raised[100, 103] == INSCRIBED


def test_polygon_is_lethal_inside_and_nowhere_else():
    cost = np.zeros((200, 200), dtype=np.uint8)
    PolygonLayer([SQUARE]).paint(cost, SPEC)
    costmap = Costmap(spec=SPEC, cost=cost)
    assert costmap.cost_at([1.5, 1.5]) == LETHAL
    assert costmap.cost_at([1.02, 1.98]) == LETHAL
    assert costmap.cost_at([0.9, 1.5]) == FREE and costmap.cost_at([2.1, 1.5]) == FREE


def test_polygon_partly_outside_the_window_is_cut():
    cost = np.zeros((200, 200), dtype=np.uint8)
    PolygonLayer([np.array([[-90.0, 0.0], [90.0, 0.0], [90.0, 0.5], [-90.0, 0.5]])]).paint(cost, SPEC)
    assert (cost[101:109] == LETHAL).all() and (cost[:99] == FREE).all()


def test_polygon_of_two_points_is_refused():
    with pytest.raises(InvalidInput):
        PolygonLayer([SQUARE[:2]])


def test_one_echo_is_not_yet_an_obstacle_and_two_are():
    layer = ObstacleLayer(SPEC)
    layer.integrate(beam((2.02, 0.02)))
    assert len(marked(layer)) == 0
    layer.integrate(beam((2.02, 0.02)))
    assert np.allclose(marked(layer), [[2.025, 0.025]])


def test_beams_that_pass_clear_what_left():
    layer = ObstacleLayer(SPEC)
    for _ in range(5):
        layer.integrate(beam((2.02, 0.02)))
    for _ in range(12):
        layer.integrate(beam((4.0, 0.02), hit=False))
    assert len(marked(layer)) == 0


def test_beams_do_not_clear_behind_a_hit():
    layer = ObstacleLayer(SPEC)
    for _ in range(5):
        layer.integrate(beam((3.02, 0.02)))
    for _ in range(12):
        layer.integrate(beam((1.02, 0.02)))
    assert len(marked(layer)) == 2


def test_rolling_window_keeps_obstacles_where_they_are_in_the_map():
    layer = ObstacleLayer(GridSpec.window((0.0, 0.0), 10.0))
    for _ in range(3):
        layer.integrate(beam((2.02, 1.02)))
    for centre in ((1.3, -0.4), (2.0, 0.7), (0.3, 0.1)):
        layer.move_to(np.array(centre))
        assert np.allclose(marked(layer), [[2.025, 1.025]], atol=1e-6)
    layer.move_to(np.array([30.0, 0.0]))
    assert len(marked(layer)) == 0


def test_layer_paints_onto_a_grid_with_another_origin():
    layer = ObstacleLayer(GridSpec.window((0.0, 0.0), 10.0))
    for _ in range(3):
        layer.integrate(beam((2.02, 1.02)))
    costmap = layered_costmap(GridSpec.window((3.0, 2.0), 6.0), [layer])
    assert costmap.cost_at([2.02, 1.02]) == LETHAL


def test_forgetting_clears_a_circle():
    layer = ObstacleLayer(SPEC)
    for end in ((2.02, 0.02), (-3.02, 0.02)):
        for _ in range(3):
            layer.integrate(beam(end))
    layer.forget(np.array([2.0, 0.0]), 1.0)
    assert np.allclose(marked(layer), [[-3.025, 0.025]])


def test_beams_that_are_not_finite_are_refused():
    with pytest.raises(InvalidInput):
        ObstacleLayer(SPEC).integrate(beam((np.inf, 0.0)))


def test_footprint_is_checked_with_its_heading():
    cost = np.zeros((200, 200), dtype=np.uint8)
    PolygonLayer([SQUARE]).paint(cost, SPEC)
    costmap = Costmap(spec=SPEC, cost=cost)
    poses = np.array([[0.6, 1.5, np.pi / 2], [0.6, 1.5, 0.0], [1.5, 1.5, 0.3], [-40.0, 0.0, 0.0]])
    assert costmap.blocked(poses, Footprint()).tolist() == [False, True, True, False]


def test_footprint_radii():
    footprint = Footprint(front=0.5, rear=0.4, half_width=0.3)
    assert footprint.inscribed == 0.3
    assert footprint.circumscribed == pytest.approx(np.hypot(0.5, 0.3))
    assert footprint.grown(0.1).rear == pytest.approx(0.5)
