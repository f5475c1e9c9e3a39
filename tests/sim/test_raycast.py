from dataclasses import replace

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.sim.raycast import NO_LABEL, Raycaster
from grape.sim.worlds import Capsule, Label, Terrain, VineyardOptions, World, generate_vineyard


@pytest.fixture(scope="module")
def vineyard() -> World:
    return generate_vineyard(VineyardOptions(seed=4))


def world_with(base: World, capsules: tuple[Capsule, ...], heights=None) -> World:
    heights = np.zeros((11, 11)) if heights is None else heights
    terrain = Terrain(heights=heights, x_range=(-5.0, 5.0), y_range=(-5.0, 5.0), slope=0.0)
    return replace(base, terrain=terrain, capsules=capsules, plates=(), spurs=(), nails=())


def rod(p0, p1, radius) -> Capsule:
    return Capsule(
        name="x/rod", p0=np.array(p0), p1=np.array(p1), radius=radius, label=Label.TRUNK, rgba=(1.0, 1.0, 1.0, 1.0)
    )


def test_rays_to_flat_ground_have_the_analytic_length(vineyard):
    rng = np.random.default_rng(0)
    origins = rng.uniform([-2, -2, 1], [2, 2, 2], (200, 3))
    directions = np.column_stack([rng.uniform(-0.5, 0.5, (200, 2)), -np.ones(200)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    expected = origins[:, 2] / -directions[:, 2]
    np.testing.assert_allclose(Raycaster(world_with(vineyard, ())).cast(origins, directions), expected, atol=1e-5)


def test_a_sloped_ground_is_met_on_its_plane(vineyard):
    x = np.linspace(-5, 5, 11)
    caster = Raycaster(world_with(vineyard, (), heights=np.tile(0.1 * x, (11, 1))))
    ranges = caster.cast([[2.0, 0.3, 1.0]], [[0.0, 0.0, -1.0]])
    assert ranges[0] == pytest.approx(0.8, abs=1e-5)


def test_rays_across_a_rod_meet_its_cylinder(vineyard):
    caster = Raycaster(world_with(vineyard, (rod([0, 0, 0.5], [0, 0, 1.5], 0.05),)))
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    outward = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(720)])
    ranges = caster.cast(2.0 * outward + [0, 0, 1.0], -outward)
    np.testing.assert_allclose(ranges, 1.95, atol=0.06 * 0.05)
    assert ranges.mean() == pytest.approx(1.95, abs=1e-4)


def test_a_ray_along_a_rod_meets_its_round_end(vineyard):
    caster = Raycaster(world_with(vineyard, (rod([0, 0, 0.5], [0, 0, 1.5], 0.05),)))
    assert caster.cast([[1e-4, 0, 3.0]], [[0, 0, -1.0]])[0] == pytest.approx(1.45, abs=1e-3)


def test_rays_that_meet_nothing_are_infinite(vineyard):
    ranges, labels, names = Raycaster(vineyard).cast_labelled([[0.0, -1.3, 1.0]], [[0.0, 0.0, 1.0]])
    assert np.isinf(ranges[0]) and labels[0] == NO_LABEL and names == [""]


def test_no_rays_give_no_ranges(vineyard):
    assert Raycaster(vineyard).cast(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


def test_labels_tell_what_was_hit(vineyard):
    caster = Raycaster(vineyard)
    marker = next(p for p in vineyard.plates if p.marker_id is not None)
    spur = next(s for s in vineyard.spurs if s.direction[2] > 0.95)
    out = marker.T_map_plate[:3, 2]
    above = np.array([0.0, 0.0, 1.0])
    origins = np.array([marker.T_map_plate[:3, 3] + 0.3 * out, spur.tip + 0.1 * above, [2.0, -1.3, 1.0]])
    ranges, labels, names = caster.cast_labelled(origins, np.array([-out, -above, -above]))
    assert [Label(k) for k in labels] == [Label.MARKER, Label.SPUR, Label.GROUND]
    assert names == [marker.name, spur.id, "ground"]
    np.testing.assert_allclose(ranges[:2], [0.299, 0.1], atol=2e-3)


def test_ray_lengths_agree_with_the_physics_engine(vineyard):
    mujoco = pytest.importorskip("mujoco")
    from grape.sim.worlds import world_spec

    model = world_spec(vineyard).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(1)
    origin = np.array([3.0, -1.3, 0.9])
    directions = rng.normal(size=(400, 3)) * [1.0, 1.0, 0.2]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ranges, labels, _ = Raycaster(vineyard).cast_labelled(np.tile(origin, (400, 1)), directions)
    geom = np.zeros(1, dtype=np.int32)
    theirs = np.array([mujoco.mj_ray(model, data, origin, d, None, 1, -1, geom) for d in directions])
    both = np.isfinite(ranges) & (theirs > 0) & (ranges < 8.0)
    assert both.sum() > 100 and (labels[both] != Label.GROUND).sum() > 20
    assert np.median(np.abs(ranges - theirs)[both]) < 1e-3
    assert np.mean(np.abs(ranges - theirs)[both] < 0.01) > 0.95


def test_wrong_shapes_are_refused(vineyard):
    with pytest.raises(InvalidInput, match=r"\(n, 3\)"):
        Raycaster(vineyard).cast(np.zeros((4, 3)), np.zeros((5, 3)))


def test_points_are_as_far_from_the_nearest_surface_as_they_are(vineyard):
    caster = Raycaster(world_with(vineyard, (rod([0, 0, 0.5], [0, 0, 1.5], 0.05),)))
    points = [[0.45, 0.0, 1.0], [2.0, 2.0, 0.1], [0.0, 0.0, 1.65]]
    np.testing.assert_allclose(caster.distance(points), [0.4, 0.1, 0.1], atol=0.06 * 0.05)
