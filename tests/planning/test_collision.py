import pickle
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree

from grape.errors import InvalidInput
from grape.geometry import pose, rotation_from_rpy
from grape.planning import (
    CheckerOptions,
    DistanceFieldOptions,
    LinkCapsule,
    StateChecker,
    StaticBox,
    build_distance_field,
    build_sphere_model,
    carve_distance_field,
    cover_capsule,
    empty_field,
)

from .conftest import CAPSULES, LOWER, UPPER, placements


@pytest.fixture(scope="session")
def states():
    low, high = np.where(np.isinf(LOWER), -np.pi, LOWER), np.where(np.isinf(UPPER), np.pi, UPPER)
    return np.random.default_rng(3).uniform(low, high, (300, 6))


@pytest.fixture(scope="session")
def field(vine):
    return build_distance_field(vine)


def centers(model, fk, q):
    frames = fk(q)
    return np.array([frames[int(s[0])][:3, :3] @ s[1:4] + frames[int(s[0])][:3, 3] for s in model.spheres])


def clearances(model, c, cloud_distance):
    """Least gaps to cloud, boxes and itself by plain numpy."""
    radius = model.spheres[:, 4]
    cloud = (cloud_distance(c) - radius).min()
    boxes = np.inf
    for box in model.boxes:
        outside = np.maximum(np.abs(c - box.center) - box.half_size, 0.0)
        gaps = np.linalg.norm(outside, axis=1) - radius
        boxes = min(boxes, gaps[[link not in box.ignore_links for link in model.links]].min())
    own = np.inf
    for a, b in model.link_pairs:
        i, j = (np.flatnonzero(np.array(model.links) == name) for name in (a, b))
        gaps = np.linalg.norm(c[i][:, None] - c[j], axis=2) - radius[i][:, None] - radius[j]
        own = min(own, gaps.min())
    return cloud, boxes, own


def test_spheres_hold_the_whole_capsule():
    capsule = CAPSULES[2]
    rng = np.random.default_rng(1)
    along = rng.uniform(0, 1, 2000)[:, None] * (np.array(capsule.p1) - capsule.p0) + capsule.p0
    surface = rng.normal(size=(2000, 3))
    surface = along + capsule.radius * surface / np.linalg.norm(surface, axis=1)[:, None]
    spheres = cover_capsule(capsule)
    distance = np.linalg.norm(surface[:, None] - spheres[:, 1:4], axis=2) - spheres[:, 4]
    assert distance.min(axis=1).max() <= 1e-9
    assert spheres[0, 4] < 1.13 * capsule.radius


def test_kernel_kinematics_agree_with_matrix_products(model, fk, states):
    for q in states[:20]:
        assert np.allclose(StateChecker(model).sphere_centers(q), centers(model, fk, q), atol=1e-12)


def test_validity_agrees_with_brute_force(model, fk, states, vine, field):
    checker, tree = StateChecker(model, field, CheckerOptions(padding_m=0.01)), cKDTree(vine)
    voxel_error, kinds = 0.009, set()
    for q in states:
        cloud, boxes, own = clearances(model, centers(model, fk, q), lambda c: tree.query(c)[0])
        valid = checker.is_valid(q)
        if min(cloud - 0.01 + voxel_error, boxes - 0.01, own) < 0:
            assert not valid, (cloud, boxes, own)
        if min(cloud - 0.01 - voxel_error, boxes - 0.01, own) >= 0:
            assert valid, (cloud, boxes, own)
        kinds |= {k for k, gap in zip("cbs", (cloud - 0.02, boxes - 0.01, own), strict=True) if gap < 0}
    assert kinds == {"c", "b", "s"}


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_angles_that_are_no_numbers_are_refused_and_not_called_free(model, states, wrong):
    checker, q = StateChecker(model), states[0].copy()
    q[3] = wrong
    for ask in (checker.is_valid, checker.clearance, lambda q: checker.edge_valid(states[0], q)):
        with pytest.raises(InvalidInput):
            ask(q)


def test_a_state_is_valid_just_where_its_clearance_is_not_negative(model, field, states):
    checker = StateChecker(model, field)
    valid = np.array([checker.is_valid(q) for q in states])
    pairs = list(zip(states[valid], states[~valid], strict=False))
    assert len(pairs) > 20
    for free, hit in pairs:
        for _ in range(60):  # until the two are neighbours
            between = 0.5 * (free + hit)
            assert checker.is_valid(between) == (checker.clearance(between) >= 0.0)
            free, hit = (between, hit) if checker.is_valid(between) else (free, between)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 0.7, np.pi / 2, np.pi])
@pytest.mark.parametrize("length", [0.0, 0.25])
def test_the_gap_between_links_is_that_of_their_nearest_spheres(angle, length):
    turned = pose(rotation_from_rpy(0.0, 0.0, angle))
    valid = set()
    for shift in np.random.default_rng(1).uniform(-0.2, 0.2, (40, 3)):
        below = LinkCapsule(link="below", joint=0, p0=(0, 0, 0), p1=(0.3, 0, 0), radius=0.04)
        above = LinkCapsule(link="above", joint=1, p0=tuple(shift), p1=(shift[0] + length, *shift[1:]), radius=0.03)
        model = build_sphere_model(
            placements=np.eye(4)[None], capsules=(below, above), link_pairs=(("below", "above"),)
        )
        _, _, own = clearances(model, centers(model, lambda _: [np.eye(4), turned], None), lambda c: np.ones(len(c)))
        checker = StateChecker(model)
        if own < 0.06:
            assert checker.clearance(np.array([angle])) == pytest.approx(own, abs=1e-12)
        assert checker.is_valid(np.array([angle])) == (own >= 0.0)
        valid.add(bool(own >= 0.0))
    assert valid == {True, False}


def test_clearance_names_the_link_and_what_it_is_near_to(model, field):
    checker = StateChecker(model, field)
    found = {}
    rng = np.random.default_rng(5)
    for q in rng.uniform([-np.pi, 0, 0, -np.pi, -np.pi, -np.pi], [np.pi, 6.2, 6.2, np.pi, np.pi, np.pi], (3000, 6)):
        nearest = checker.nearest(q)
        assert (nearest.clearance_m >= 0) == checker.is_valid(q)
        if nearest.clearance_m < 0:
            found.setdefault(nearest.other, str(nearest))
    assert {"cloud", "deck", "mast", "riser", "hand"} <= set(found)
    assert "mm too near to deck" in found["deck"]


def test_free_space_is_far_from_everything():
    nearest = StateChecker(build_sphere_model(placements=placements(), capsules=CAPSULES)).nearest(np.full(6, np.pi))
    assert nearest.link == ""
    assert "nothing within" in str(nearest)
    assert empty_field(0.2).query(np.zeros((1, 3)))[0] == pytest.approx(0.2)


def test_distances_are_right_within_a_voxel_and_cut_at_the_reach(vine, field):
    points = np.random.default_rng(2).uniform([-0.5, 0.4, 0.0], [1.1, 1.2, 1.0], (3000, 3))
    true = np.minimum(cKDTree(vine).query(points)[0], field.reach_m)
    assert np.abs(field.query(points) - true).max() < 0.012
    assert np.abs(field.query(points) - true).mean() < 0.004
    assert field.query(np.array([[5.0, 5.0, 5.0]]))[0] == pytest.approx(field.reach_m)


def test_remote_and_broken_points_do_not_count():
    cloud = np.array([[0.5, 0.8, 0.6], [0.5, 0.9, 0.6], [9.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    assert build_distance_field(cloud).point_count == 2
    assert build_distance_field(np.empty((0, 3))).point_count == 0


def test_a_carved_field_is_that_of_the_points_left():
    rng = np.random.default_rng(7)
    cloud = rng.uniform((0.2, 0.5, 0.3), (0.7, 1.0, 0.9), (300, 3))
    balls = ((cloud[0], 0.08), (np.array([0.2, 0.5, 0.3]), 0.12), (np.array([5.0, 0.0, 0.0]), 0.1))
    left = cloud[[all(np.linalg.norm(p - c) > r for c, r in balls) for p in cloud]]
    carved = carve_distance_field(build_distance_field(cloud), cloud, balls)
    assert carved.point_count == len(left) < 300
    places = rng.uniform((0.0, 0.3, 0.1), (0.9, 1.2, 1.1), (5000, 3))
    np.testing.assert_allclose(carved.query(places), build_distance_field(left).query(places), atol=1e-6)
    assert carve_distance_field(build_distance_field(cloud[:0]), cloud[:0], balls).query(places).min() > 0.14


def test_an_edge_through_a_thin_branch_is_refused(fk):
    middle_state = np.array([0.0, 4.2, 1.9, 3.3, 0.9, 0.0])  # the hand points outwards, 0.87 m from the axis
    q0, q1 = middle_state.copy(), middle_state.copy()
    q0[0] -= 0.5
    q1[0] += 0.5
    middle = fk(middle_state)[6][:3, 3] + fk(middle_state)[6][:3, :3] @ [0.03, -0.01, -0.26]
    bare = build_sphere_model(placements=placements(), capsules=CAPSULES)
    checker = StateChecker(bare, build_distance_field(middle[None, :]))
    assert checker.is_valid(q0)
    assert checker.is_valid(q1)
    assert not checker.edge_valid(q0, q1)
    assert StateChecker(bare).edge_valid(q0, q1)


def test_a_valid_edge_has_only_valid_states(model, field, states):
    checker = StateChecker(model, field)
    real = StateChecker(model, field, CheckerOptions(padding_m=0.004))
    good = [q for q in states if checker.is_valid(q)]
    passed = [(a, b) for a, b in pairwise(good) if checker.edge_valid(a, b)]
    assert 5 < len(passed) < len(good) - 5
    for a, b in passed[:20]:
        assert all(real.is_valid(a + s * (b - a)) for s in np.linspace(0, 1, 400))


def test_a_valid_edge_is_nowhere_deeper_than_a_step(model, field, states):
    checker = StateChecker(model, field)
    deeper = StateChecker(model, field, CheckerOptions(padding_m=0.0, self_padding_m=-0.01))
    good = [q for q in states if checker.is_valid(q)]
    edges = [(a, a + 0.3 * (b - a)) for a, b in pairwise(good)]
    found = [checker.edge_valid(a, b) for a, b in edges]
    assert 5 < sum(found) < len(found) - 5
    for (a, b), valid in zip(edges, found, strict=True):
        deep = any(not deeper.is_valid(a + t * (b - a)) for t in np.linspace(0.0, 1.0, 41))
        assert not (valid and deep)


def test_a_checker_survives_the_way_to_another_process(model, field, states):
    checker = StateChecker(model, field)
    copy = pickle.loads(pickle.dumps(checker))
    assert [copy.clearance(q) for q in states[:20]] == [checker.clearance(q) for q in states[:20]]


def test_a_held_thing_is_checked_too(model, states):
    held = LinkCapsule(link="dispenser", joint=6, p0=(0, -0.08, -0.26), p1=(0, 0.06, -0.26), radius=0.03)
    loaded = model.holding([held], ("upper_arm", "forearm"))
    free = [q for q in states if StateChecker(model).is_valid(q)]
    hits = [n for n in map(StateChecker(loaded).nearest, free) if n.clearance_m < 0]
    assert hits
    assert {nearest.link for nearest in hits} <= {"dispenser", "upper_arm", "forearm"}
    assert any("dispenser" in (nearest.link, nearest.other) for nearest in hits)


def test_leaving_a_place_nearer_than_the_padding_is_possible_unpadded(fk, states):
    q = states[0]
    tip = fk(q)[6][:3, 3] + fk(q)[6][:3, :3] @ [0.0, -0.12, -0.015]
    direction = fk(q)[6][:3, :3] @ [0.0, -1.0, 0.0]
    bare = build_sphere_model(placements=placements(), capsules=CAPSULES)
    checker = StateChecker(
        bare, build_distance_field((tip + 0.018 * direction)[None, :]), CheckerOptions(padding_m=0.03)
    )
    assert not checker.is_valid(q)
    assert checker.edge_valid_unpadded(q, q)


@pytest.mark.parametrize(
    "change",
    [
        {"placements": np.zeros((6, 3))},
        {"capsules": ()},
        {"capsules": (LinkCapsule(link="a", joint=7, p0=(0, 0, 0), p1=(0, 0, 1), radius=0.1),)},
        {"capsules": (LinkCapsule(link="a", joint=1, p0=(0, 0, 0), p1=(0, 0, 1), radius=0.0),)},
        {"link_pairs": (("hand", "forarm"),)},
        {"boxes": (StaticBox(name="b", center=(0, 0, 0), half_size=(1, 1, 1), ignore_links=("x",)),)},
    ],
)
def test_a_wrong_model_is_refused(change):
    with pytest.raises(InvalidInput):
        build_sphere_model(**{"placements": placements(), "capsules": CAPSULES, **change})


def test_wrong_shapes_and_options_are_refused(model):
    with pytest.raises(InvalidInput):
        StateChecker(model).is_valid(np.zeros(5))
    with pytest.raises(InvalidInput):
        build_distance_field(np.zeros((4, 2)))
    with pytest.raises(InvalidInput):
        DistanceFieldOptions(voxel_m=0.0)
    with pytest.raises(InvalidInput):
        CheckerOptions(least_step_m=0.0)
