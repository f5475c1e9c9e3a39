"""How high a hand must go to pass what was seen."""

from __future__ import annotations

import numpy as np
import pytest

from grape.geometry import pose
from grape.planning import LinkCapsule, SphereModel, build_sphere_model
from grape.tasks.dispenser.sweep_guard import LEAST_POINTS, MOST_M, ROOM_M, SweepGuard

WAY = np.array([pose(None, (x, 0.0, 0.0)) for x in np.linspace(0.0, 0.2, 9)])


@pytest.fixture
def body() -> SphereModel:
    """One joint that carries a ball of 3 cm, on a column."""
    column = LinkCapsule(link="column", joint=0, p0=(0.1, 0.0, -0.5), p1=(0.1, 0.0, -0.2), radius=0.05)
    hand = LinkCapsule(link="hand", joint=1, p0=(0.0, 0.0, 0.0), p1=(0.0, 0.0, 0.0), radius=0.03)
    return build_sphere_model(placements=np.eye(4)[None], capsules=(column, hand))


AWAY = pose(None, (0.0, 0.5, 0.0))  # of the hand, when it looks


def ball(x: float, z: float) -> np.ndarray:
    """Points enough for one cell at a place in base_link, in the hand's frame there."""
    return np.tile([x, -0.5, z], (LEAST_POINTS, 1))


def test_nothing_seen_hinders_nothing(body: SphereModel) -> None:
    assert SweepGuard(body).clearance(WAY) == np.inf


def test_clearance_is_that_of_the_nearest_pose_of_what_the_last_joint_carries(body: SphereModel) -> None:
    guard = SweepGuard(body)
    guard.add(ball(0.2, 0.1), AWAY)
    assert guard.clearance(WAY) == pytest.approx(0.07, abs=1e-6)
    assert guard.clearance(WAY, 0.02) == pytest.approx(0.05, abs=1e-6)
    assert guard.clearance(WAY[:1]) > 0.15


def test_single_points_are_noise_and_looks_add_up(body: SphereModel) -> None:
    guard = SweepGuard(body)
    guard.add(ball(0.1, 0.0)[: LEAST_POINTS - 1], AWAY)
    guard.add(np.empty((0, 3)), AWAY)
    assert guard.clearance(WAY) == np.inf
    guard.add(ball(0.1, 0.1), AWAY)
    guard.add(ball(0.1, -0.08), AWAY)
    assert guard.clearance(WAY) == pytest.approx(0.05, abs=1e-6)


def test_it_goes_as_high_as_leaves_room_and_no_higher_than_the_arm_can(body: SphereModel) -> None:
    guard = SweepGuard(body)
    guard.add(ball(0.2, -0.02), AWAY)
    lift = guard.lift(WAY, 0.0)
    assert lift is not None and guard.clearance(WAY, lift) >= ROOM_M > guard.clearance(WAY, lift - 0.02)
    assert guard.lift(WAY, lift) == pytest.approx(lift + 0.02), "already there, and it was not enough"
    guard.add(ball(0.2, MOST_M), AWAY)
    assert guard.lift(WAY, 0.0) is None


def test_something_over_the_hand_is_in_the_way_up(body: SphereModel) -> None:
    guard = SweepGuard(body)
    guard.add(ball(0.2, -0.02), AWAY)
    guard.add(ball(0.0, 0.05), AWAY)
    assert guard.lift(WAY, 0.0) is None


def test_the_hand_sees_itself_and_a_held_dispenser_and_takes_neither_for_wood(body: SphereModel) -> None:
    beside, loop = np.tile([0.0, 0.05, 0.0], (9, 1)), np.tile([0.0, -0.1, -0.25], (9, 1))
    empty, holding = SweepGuard(body), SweepGuard(body, holding=True)
    for guard in (empty, holding):
        guard.add(np.vstack([beside, loop]), np.eye(4))
    assert holding.clearance(WAY) == np.inf
    assert empty.clearance(WAY[:1]) == pytest.approx(np.hypot(0.1, 0.25) - 0.03, abs=1e-6), "the loop alone"
