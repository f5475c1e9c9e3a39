import numpy as np
import pytest

from grape.errors import ActionFailed, InvalidInput, Reason
from grape.planning import (
    CheckerOptions,
    JointPlanner,
    PlannerOptions,
    StateChecker,
    build_distance_field,
    build_sphere_model,
)

from .conftest import CAPSULES, LOWER, UPPER, VELOCITY, placements

BENT = np.array([0.0, 4.2, 1.9, 3.3, 0.9, 0.0])  # the hand is 0.87 m from the axis of joint 1, pointing outwards
TURNED = BENT + np.array([2.4, 0.0, 0.0, 0.0, 0.0, 0.0])


def joint_6(angle):
    return np.array([0.0, 0.0, 0.0, 0.0, 0.0, angle])


@pytest.fixture(scope="module")
def walled(fk):
    """A column that the straight turn of joint 1 would sweep into."""
    middle = 0.5 * (BENT + TURNED)
    T = fk(middle)[6]
    x, y, z = T[:3, 3] + T[:3, :3] @ [0.0, 0.0, -0.1]
    heights = np.arange(z - 0.25, z + 0.25, 0.005)
    column = np.column_stack([np.full_like(heights, x), np.full_like(heights, y), heights])
    bare = build_sphere_model(placements=placements(), capsules=CAPSULES)
    return StateChecker(bare, build_distance_field(column))


def test_a_free_straight_line_needs_no_search(planner):
    checker = StateChecker(build_sphere_model(placements=placements(), capsules=CAPSULES))
    path = planner.plan(BENT, [TURNED], checker, np.random.default_rng(0))
    assert path.straight
    assert np.array_equal(path.waypoints, [BENT, TURNED])
    assert path.length == pytest.approx(2.4)


def test_a_path_leads_around_an_obstacle(planner, walled):
    assert not walled.edge_valid(BENT, TURNED)
    path = planner.plan(BENT, [TURNED], walled, np.random.default_rng(0))
    assert not path.straight
    assert np.array_equal(path.waypoints[0], BENT)
    assert np.allclose(path.waypoints[-1], TURNED)
    assert walled.path_valid(path.waypoints)
    assert path.length < 12.0


def test_the_same_seed_gives_the_same_path_whatever_was_planned_before(planner, walled):
    paths = []
    for seed in (1, 2, 1):
        planner.plan(TURNED, [BENT], walled, np.random.default_rng(seed + 10))
        paths.append(planner.plan(BENT, [TURNED], walled, np.random.default_rng(seed)).waypoints)
    assert np.array_equal(paths[0], paths[2])
    assert not np.array_equal(paths[0], paths[1])


def test_the_quickest_of_several_goals_is_taken(planner, walled):
    near = BENT - np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    path = planner.plan(BENT, [TURNED, near], walled, np.random.default_rng(0))
    assert path.goal_index == 1
    assert path.straight


def test_goals_in_collision_are_left_out(planner, walled):
    blocked = 0.5 * (BENT + TURNED)
    path = planner.plan(BENT, [blocked, TURNED], walled, np.random.default_rng(0))
    assert path.goal_index == 1


def test_a_goal_in_collision_names_link_and_depth(planner, walled):
    with pytest.raises(ActionFailed) as failure:
        planner.plan(BENT, [0.5 * (BENT + TURNED)], walled, np.random.default_rng(0))
    assert failure.value.reason is Reason.IN_COLLISION
    assert "goal" in failure.value.detail
    assert "mm too near to cloud" in failure.value.detail


def test_a_start_in_collision_names_link_and_depth(planner, walled):
    with pytest.raises(ActionFailed) as failure:
        planner.plan(0.5 * (BENT + TURNED), [TURNED], walled, np.random.default_rng(0))
    assert failure.value.reason is Reason.IN_COLLISION
    assert "start" in failure.value.detail


def test_a_start_only_within_the_padding_is_left(planner, walled):
    q, step = BENT.copy(), np.array([0.005, 0, 0, 0, 0, 0])
    while walled.is_valid(q + step):
        q = q + step
    near = StateChecker(walled.model, walled.field, CheckerOptions(padding_m=0.02))
    assert not near.is_valid(q)
    path = planner.plan(q, [BENT], near, np.random.default_rng(0))
    assert np.array_equal(path.waypoints[0], q)
    assert near.path_valid(path.waypoints[1:])


def test_no_path_within_the_budget_is_a_typed_failure(walled):
    planner = JointPlanner(LOWER, UPPER, VELOCITY, PlannerOptions(max_checks=30, attempts=1))
    with pytest.raises(ActionFailed) as failure:
        planner.plan(BENT, [TURNED], walled, np.random.default_rng(0))
    assert failure.value.reason is Reason.NO_PLAN
    assert "30 checks" in failure.value.detail


def test_goals_are_taken_at_the_nearest_turn_and_never_wrapped(planner):
    checker = StateChecker(build_sphere_model(placements=placements(), capsules=CAPSULES))
    start = BENT + joint_6(4.0)
    path = planner.plan(start, [BENT + joint_6(5.0 - 2 * np.pi)], checker, np.random.default_rng(0))
    assert path.waypoints[-1] == pytest.approx(BENT + joint_6(5.0))


def test_the_cable_budget_decides_the_turn(planner):
    checker = StateChecker(build_sphere_model(placements=placements(), capsules=CAPSULES))
    start = BENT + joint_6(6.0)
    goal = BENT + joint_6(0.5)  # 6.78 would be nearer, but the cables end at 6.28
    path = planner.plan(start, [goal], checker, np.random.default_rng(0))
    assert path.waypoints[-1][5] == pytest.approx(0.5)
    reference = np.array([0, 0, 0, 0, 0, 3.0])
    path = planner.plan(start, [goal], checker, np.random.default_rng(0), cable_reference=reference)
    assert path.waypoints[-1][5] == pytest.approx(0.5 + 2 * np.pi)


def test_a_start_beyond_the_cables_may_come_back(planner):
    checker = StateChecker(build_sphere_model(placements=placements(), capsules=CAPSULES))
    path = planner.plan(BENT + joint_6(7.0), [BENT], checker, np.random.default_rng(0))
    assert abs(path.waypoints[-1][5] - BENT[5]) < 2 * np.pi + 1e-9


def test_an_absolute_goal_is_taken_as_it_is(planner):
    checker = StateChecker(build_sphere_model(placements=placements(), capsules=CAPSULES))
    goal = BENT + joint_6(-2.0)
    path = planner.plan(BENT + joint_6(3.0), [goal], checker, np.random.default_rng(0), absolute=True)
    assert path.waypoints[-1] == pytest.approx(goal)
    with pytest.raises(ActionFailed) as failure:
        planner.plan(BENT, [BENT + joint_6(9.0)], checker, np.random.default_rng(0), absolute=True)
    assert failure.value.reason is Reason.CABLE_BUDGET


def test_a_goal_beyond_the_limits_is_a_typed_failure(planner):
    checker = StateChecker(build_sphere_model(placements=placements(), capsules=CAPSULES))
    with pytest.raises(ActionFailed) as failure:
        planner.plan(BENT, [BENT + np.array([0, 2.0, 0, 0, 0, 0])], checker, np.random.default_rng(0))
    assert failure.value.reason is Reason.CABLE_BUDGET


def test_wrong_input_is_refused(planner, walled):
    with pytest.raises(InvalidInput):
        planner.plan(np.full(6, np.nan), [BENT], walled, np.random.default_rng(0))
    with pytest.raises(InvalidInput):
        JointPlanner(UPPER, LOWER, VELOCITY)
    with pytest.raises(InvalidInput):
        PlannerOptions(attempts=0)


def test_plans_beside_a_vine_are_found(planner, model, vine):
    checker = StateChecker(model, build_distance_field(vine))
    rng = np.random.default_rng(4)
    low, high = planner.bounds()
    free = [q for q in rng.uniform(low, high, (60, 6)) if checker.is_valid(q)]
    assert len(free) >= 16
    for start, goal in zip(free[0:16:2], free[1:16:2], strict=True):
        path = planner.plan(start, [goal], checker, rng)
        assert checker.path_valid(path.waypoints)
