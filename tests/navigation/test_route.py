from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.navigation.grid import Footprint
from grape.navigation.path import in_frame_of
from grape.navigation.route import RouteOptions, parking_pose, row_zones, waypoints

OPTIONS = RouteOptions()
LANE = OPTIONS.lateral


@pytest.mark.parametrize("direction", [(1.0, 0.0), (-1.0, 0.0), (0.6, 0.8)])
@pytest.mark.parametrize("place, offset", [("fore", 0.22), ("aft", -0.22)])
def test_parked_robot_has_the_plant_on_its_left_beside_the_arm(direction, place, offset):
    plant = np.array([3.0, 2.6])
    pose = parking_pose(plant, np.array(direction), place)
    along, across, _ = in_frame_of(np.array([*plant, 0.0]), pose)
    assert along == pytest.approx(0.25 + offset)
    assert across == pytest.approx(0.835)
    assert np.allclose([np.cos(pose[2]), np.sin(pose[2])], direction)


def test_unknown_place_is_refused():
    with pytest.raises(InvalidInput, match="fore"):
        parking_pose(np.zeros(2), np.array([1.0, 0.0]), "left")  # type: ignore[arg-type]


def test_direction_of_no_length_is_refused():
    with pytest.raises(InvalidInput, match="direction"):
        parking_pose(np.zeros(2), np.zeros(2), "fore")


def test_parked_footprint_stays_out_of_the_zone_of_its_row(vineyard):
    yard = vineyard(1)
    zone = row_zones(yard.rows)[0]
    pose = parking_pose(yard.plants[0, 3], np.array([1.0, 0.0]), "fore")
    assert Footprint().corners(pose)[:, 1].max() < zone[:, 1].min() - 0.15


def test_zone_is_longer_than_the_row(vineyard):
    yard = vineyard(1)
    zone = row_zones(yard.rows)[1]
    assert zone[:, 0].min() == pytest.approx(-0.3) and np.ptp(zone[:, 1]) == pytest.approx(0.56)


def test_next_plant_of_the_same_lane_needs_no_waypoint(vineyard):
    yard = vineyard(1)
    start, goal = np.array([1.0, -LANE, 0.0]), np.array([4.0, -LANE, 0.0])
    assert np.allclose(waypoints(yard.rows, start, goal), goal)


def test_from_the_headland_in_line_with_the_lane_it_goes_straight(vineyard):
    goal = np.array([4.0, -LANE, 0.0])
    assert len(waypoints(vineyard(1).rows, np.array([-3.0, -0.8, 0.0]), goal)) == 1


@pytest.mark.parametrize("beyond", [0.3, 0.49, 0.51, 0.9])
def test_parked_at_the_end_of_a_row_and_facing_the_lane_it_goes_straight_in(vineyard, beyond):
    start = np.array([-beyond, -LANE, 0.02])
    goal = np.array([4.0, -LANE, 0.0])
    assert np.allclose(waypoints(vineyard(1).rows, start, goal), goal)


def test_row_change_leads_through_the_headland_ahead(vineyard):
    yard = vineyard(1)
    route = waypoints(yard.rows, np.array([5.0, -LANE, 0.0]), np.array([6.0, 2.6 + LANE, np.pi]))
    end = yard.rows[0].line[-1, 0] + OPTIONS.headland
    assert np.allclose(route[:-1, :2], [[end, -LANE], [end, 2.6 + LANE]])
    assert np.allclose(route[-1], [6.0, 2.6 + LANE, np.pi])


def test_lane_that_begins_at_the_other_end_is_reached_outside_the_rows(vineyard):
    yard = vineyard(1)
    route = waypoints(yard.rows, np.array([5.0, -LANE, 0.0]), np.array([2.0, 2.6 - LANE, 0.0]))
    inside = (route[:-1, 0] > 0.0) & (route[:-1, 0] < 8.0)
    assert not inside.any()
    assert route[-2, 0] < -1.0
    crossing = route[:-1][np.abs(np.diff(route[:, 0])) > 5.0]
    assert (crossing[:, 1] < -LANE).all() or (crossing[:, 1] > 5.2 + LANE).all()


def test_site_without_rows_needs_no_waypoints():
    goal = np.array([1.0, 2.0, 0.0])
    assert np.allclose(waypoints([], np.zeros(3), goal), goal)
