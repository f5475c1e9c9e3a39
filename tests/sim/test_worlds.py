import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from paper_names import NAMES, with_names

from grape.config import Document, validate_options
from grape.errors import FileError, InvalidInput
from grape.geometry import inverse, pose, transform
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.compose import compose
from grape.sim.parts import PartTable
from grape.sim.worlds import (
    Label,
    VineyardOptions,
    World,
    export,
    generate_vineyard,
    grow_world,
    vineyard_site,
    world_spec,
)
from grape.site import load_site, save_site, site_to_geojson

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(scope="module", params=["cordon", "gobelet"])
def world(request) -> World:
    return generate_vineyard(VineyardOptions(style=request.param, seed=3))


def fingerprint(world: World) -> list:
    rods = [(c.name, *c.p0, *c.p1, c.radius) for c in world.capsules]
    return [rods, world.terrain.heights.tobytes(), site_to_geojson(world.site)]


def test_the_same_seed_gives_the_same_world():
    assert fingerprint(generate_vineyard(VineyardOptions(seed=5))) == fingerprint(
        generate_vineyard(VineyardOptions(seed=5))
    )


def test_another_seed_gives_another_world_on_the_same_site():
    one, two = (fingerprint(generate_vineyard(VineyardOptions(seed=s))) for s in (5, 6))
    assert one[0] != two[0] and one[1] != two[1] and one[2] == two[2]


def test_the_style_does_not_change_the_ground():
    one, two = (generate_vineyard(VineyardOptions(style=s)) for s in ("cordon", "gobelet"))
    np.testing.assert_array_equal(one.terrain.heights, two.terrain.heights)


def test_the_default_vineyard_has_the_agreed_layout():
    site = vineyard_site(VineyardOptions())
    assert [row.id for row in site.rows] == ["r0", "r1", "r2"]
    assert Counter(p.kind for p in site.plants) == {"vine": 24, "nail": 6}
    np.testing.assert_allclose([row.line[0, 1] for row in site.rows], [0.0, 2.6, 5.2])
    np.testing.assert_allclose(site.plant("r0v0").position, [0.0, 0.0])
    np.testing.assert_allclose(site.plant("r1v3").position, [3.45, 2.6])
    assert site.start[0] == pytest.approx(-3.0)
    assert [site.row(r).aisle_normal[1] for r in ("r0", "r1", "r2")] == [-1.0, 1.0, -1.0]
    assert sorted(i for p in site.plants for i in p.markers) == list(range(10, 22))


def test_names_are_unique_and_vines_stay_in_their_budget(world):
    names = Counter(c.name for c in world.capsules) + Counter(p.name for p in world.plates)
    assert max(names.values()) == 1
    assert max(Counter(c.plant for c in world.capsules if c.plant).values()) <= 45
    assert all(c.radius > 0 and np.isfinite([c.p0, c.p1]).all() for c in world.capsules)


def test_spurs_have_the_measured_sizes(world):
    spurs = Counter(s.plant for s in world.spurs)
    assert len(spurs) == 24 and min(spurs.values()) >= 2 and max(spurs.values()) <= 8
    for spur in world.spurs:
        length = np.linalg.norm(spur.tip - spur.base)
        assert 0.06 <= length <= 0.15 and 0.007 <= spur.diameter <= 0.011
        np.testing.assert_allclose(spur.base + length * spur.direction, spur.tip, atol=1e-12)


def test_a_spur_of_the_truth_is_the_rod_of_its_name(world):
    rods = {c.name: c for c in world.capsules}
    for spur in world.spurs:
        rod = rods[spur.id]
        assert rod.plant == spur.plant and rod.label is Label.SPUR
        np.testing.assert_allclose(rod.p1 + rod.radius * spur.direction, spur.tip, atol=1e-12)


@pytest.mark.parametrize(("style", "limit", "share"), [("cordon", 40.0, 0.5), ("gobelet", 30.0, 1.0)])
def test_enough_spurs_stand_upright_on_every_vine(style, limit, share):
    world = generate_vineyard(VineyardOptions(style=style, seed=1))
    tilts: dict[str, list[float]] = {}
    for spur in world.spurs:
        tilts.setdefault(spur.plant, []).append(math.degrees(math.acos(spur.direction[2])))
    assert all(np.mean(np.array(t) <= limit) >= share for t in tilts.values())
    if style == "cordon":
        assert max(max(t) for t in tilts.values()) > 60.0


def test_cordons_run_at_wire_height_and_gobelets_stay_low(world):
    ground = world.terrain.height
    trunks = {c.plant: c for c in world.capsules if c.label is Label.TRUNK}  # the last piece of each
    heads = np.array([c.p1[2] - ground(c.p1[:2]) for c in trunks.values()])
    cordon = any(c.label is Label.WIRE for c in world.capsules)
    low, high = (0.65, 0.83) if cordon else (0.27, 0.53)
    assert low < heads.min() and heads.max() < high


def test_wood_keeps_clear_of_the_posts(world):
    posts = [c for c in world.capsules if c.label is Label.POST]
    wood = [c for c in world.capsules if c.label in (Label.ARM, Label.SPUR, Label.TRUNK)]
    for post in posts:
        near = [c for c in wood if np.linalg.norm(c.p0[:2] - post.p0[:2]) < 1.0]
        points = np.concatenate([np.linspace(c.p0, c.p1, 8)[:, :2] for c in near])
        assert np.linalg.norm(points - post.p0[:2], axis=1).min() > post.radius + 0.01


def test_every_nail_stands_out_into_its_aisle(world):
    assert len(world.nails) == 6
    for nail in world.nails:
        plant = world.site.plant(nail.id)
        normal = world.site.row(plant.row).aisle_normal
        assert (nail.tip[:2] - plant.position) @ normal > 0.09
        assert 10 < math.degrees(math.asin(nail.direction[2])) < 25
        assert np.linalg.norm(nail.tip - nail.base) == pytest.approx(0.05)
        assert 0.005 <= nail.diameter <= 0.008
        np.testing.assert_allclose(nail.tip[:2], plant.target, atol=1e-9)
        assert nail.tip[2] - world.terrain.height(plant.position) == pytest.approx(plant.height_m)


def test_markers_face_the_aisle_beside_their_nail(world):
    plates = {p.marker_id: p for p in world.plates if p.marker_id is not None}
    for nail in world.nails:
        normal = np.append(world.site.row(world.site.plant(nail.id).row).aisle_normal, 0.0)
        right = np.cross([0, 0, 1], normal)  # of the robot that looks at the board
        for id, side in zip(nail.markers, (-1.0, 1.0), strict=True):
            T = plates[id].T_map_plate
            np.testing.assert_allclose(T[:3, 2], normal, atol=1e-12)
            np.testing.assert_allclose(T[:3, 1], [0, 0, 1], atol=1e-12)
            assert (T[:3, 3] - nail.tip) @ right == pytest.approx(side * 0.085)
            assert T[2, 3] - nail.tip[2] == pytest.approx(-0.03)


def test_the_wrist_camera_would_detect_the_markers():
    import cv2

    world = generate_vineyard(VineyardOptions(sun="low"))
    spec = world_spec(world)
    spec.worldbody.add_camera(name="eye", fovy=math.degrees(2 * math.atan(240 / 466)))
    model = spec.compile()
    data = mujoco.MjData(model)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    plates = {p.marker_id: p for p in world.plates if p.marker_id is not None}
    with mujoco.Renderer(model, 480, 640) as renderer:
        for nail in (world.nails[0], world.nails[2]):  # one of each side
            right, up, out = plates[nail.markers[0]].T_map_plate[:3, :3].T
            T_map_camera = pose(np.column_stack([right, -up, -out]), nail.tip + 0.4 * out)
            model.cam_pos[0] = T_map_camera[:3, 3]
            mujoco.mju_mat2Quat(model.cam_quat[0], np.column_stack([right, up, out]).ravel())
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "eye")
            corners, ids, _ = detector.detectMarkers(renderer.render()[:, :, ::-1].copy())
            assert sorted(ids.ravel()) == list(nail.markers)
            for id, found in zip(ids.ravel(), corners, strict=True):
                square = np.array(
                    [[-0.02, 0.02, 0.001], [0.02, 0.02, 0.001], [0.02, -0.02, 0.001], [-0.02, -0.02, 0.001]]
                )
                seen = transform(inverse(T_map_camera), transform(plates[id].T_map_plate, square))
                np.testing.assert_allclose(found[0], seen[:, :2] / seen[:, 2:] * 466 + [319.5, 239.5], atol=2.0)


@pytest.mark.parametrize(("slope", "rms"), [(0.0, 0.03), (0.15, 0.015), (-0.05, 0.0)])
def test_the_ground_has_the_slope_and_roughness_asked_for(slope, rms):
    terrain = generate_vineyard(
        VineyardOptions(slope=slope, roughness_rms=rms, vines_per_row=2, nails_per_row=0)
    ).terrain
    X, Y = np.meshgrid(terrain.xs, terrain.ys)
    far = np.hypot(X + 3.0, Y + 1.3) > 2.5
    fit = np.polyfit(X[far], terrain.heights[far], 1)
    assert fit[0] == pytest.approx(slope, abs=0.003)
    assert np.std((terrain.heights - slope * X)[far]) == pytest.approx(rms, rel=0.1, abs=1e-9)
    near = np.hypot(X + 3.0, Y + 1.3) < 1.0
    np.testing.assert_allclose(terrain.heights[near], (slope * X)[near], atol=1e-12)


@pytest.mark.parametrize("length", [0.3, 0.8])
def test_roughness_is_correlated_over_the_length_asked_for(length):
    options = VineyardOptions(slope=0.0, roughness_correlation=length, rows=6, nails_per_row=0, seed=2)
    h = generate_vineyard(options).terrain.heights
    lag = round(length / 0.1)
    correlation = np.mean(h[:, :-lag] * h[:, lag:]) / np.mean(h * h)
    assert correlation == pytest.approx(math.exp(-1), abs=0.1)


def test_height_interpolates_the_grid(world):
    terrain = world.terrain
    i, j = 40, 70
    assert terrain.height([terrain.xs[j], terrain.ys[i]]) == pytest.approx(terrain.heights[i, j])
    middle = [(terrain.xs[j] + terrain.xs[j + 1]) / 2, (terrain.ys[i] + terrain.ys[i + 1]) / 2]
    assert terrain.height(middle) == pytest.approx(terrain.heights[i : i + 2, j : j + 2].mean())
    assert terrain.height([1e3, 1e3]) == pytest.approx(terrain.heights[-1, -1])


def test_the_site_file_round_trips_within_a_millimetre(world, tmp_path):
    save_site(world.site, tmp_path / "v.geojson")
    back = load_site(tmp_path / "v.geojson")
    for mine, yours in zip(world.site.plants, back.plants, strict=True):
        assert np.linalg.norm(mine.position - yours.position) < 1e-3 and mine.id == yours.id
    for mine, yours in zip(world.site.fences, back.fences, strict=True):
        assert np.abs(mine.polygon - yours.polygon).max() < 1e-3


def test_a_world_grows_on_a_surveyed_site(tmp_path):
    save_site(vineyard_site(VineyardOptions(rows=2, vines_per_row=4, nails_per_row=1)), tmp_path / "v.geojson")
    site = load_site(tmp_path / "v.geojson")
    world = grow_world(site, VineyardOptions(style="gobelet"))
    assert len(world.nails) == 2 and len({s.plant for s in world.spurs}) == 8


def test_vines_of_a_turned_row_spread_along_it():
    site = vineyard_site(VineyardOptions(rows=1, vines_per_row=4, nails_per_row=0))
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    rows = tuple(replace(r, line=r.line @ turn.T) for r in site.rows)
    plants = tuple(replace(p, position=turn @ p.position) for p in site.plants)
    world = grow_world(replace(site, rows=rows, plants=plants), VineyardOptions(weeds=0.0))
    arms = np.array([c.p1 for c in world.capsules if c.label is Label.ARM])
    assert np.ptp(arms[:, 0]) < 0.3 and np.ptp(arms[:, 1]) > 3.0


def test_the_physics_model_attributes_its_geoms_to_plants(world):
    model = world_spec(world).compile()
    for spur in world.spurs:
        assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, spur.id) >= 0
    ground = model.geom("ground")
    assert (ground.contype[0], ground.conaffinity[0]) == (1, 4)
    assert model.geom("r0v0/bud0_0").contype[0] == 0
    assert model.nv == 0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_the_physics_model_takes_every_name_that_a_plant_may_have():
    options = VineyardOptions(rows=2, vines_per_row=6, nails_per_row=1)
    world = grow_world(with_names(vineyard_site(options)), options)
    ids = {plant.id for plant in world.site.plants}
    assert ids > {*NAMES}
    world_spec(world).compile()
    model = compose(world, DESCRIPTION, 1)
    plants = PartTable.of(model, world, DESCRIPTION).plants
    bodies = {(plant, int(body)) for plant, body in zip(plants, model.geom_bodyid, strict=True) if plant}
    assert {plant for plant, _ in bodies} == ids
    assert len(bodies) == len({body for _, body in bodies}) == len(ids), "each plant is a body of its own"


def test_the_physics_ground_is_the_worlds_ground(world):
    model = world_spec(world).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = np.zeros(1, dtype=np.int32)
    for xy in np.random.default_rng(0).uniform([-4, -3], [12, -0.8], (20, 2)):
        distance = mujoco.mj_ray(model, data, np.array([*xy, 3.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, geom)
        assert model.geom(int(geom[0])).name == "ground"
        assert 3.0 - distance == pytest.approx(float(world.terrain.height(xy)), abs=0.01)


def places(model) -> dict:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {model.geom(k).name: tuple(data.geom_xpos[k]) for k in range(model.ngeom)}


def test_all_but_the_ground_of_a_large_vineyard_is_of_the_worlds_own_body_at_the_same_places(world, monkeypatch):
    usual = world_spec(world).compile()
    monkeypatch.setattr(export, "MOST_BODIES", 10)
    large, bare = world_spec(world).compile(), world_spec(world, drawn=False).compile()
    assert {large.geom(k).name for k in np.flatnonzero(large.geom_bodyid)} == {"ground"}
    assert places(large) == places(usual)
    left = places(bare)
    assert left.items() < places(usual).items()
    untouched = {usual.geom(k).name for k in range(usual.ngeom) if not usual.geom_contype[k]} - {"horizon"}
    assert places(usual).keys() - left.keys() == untouched


def test_only_plants_near_a_point_are_exported_on_request(world):
    model = world_spec(world, near=np.array([0.0, 0.0]), radius=2.0).compile()
    names = {model.geom(i).name.partition("/")[0] for i in range(model.ngeom)}
    assert "r0v0" in names and "ground" in names and "r0v5" not in names and "r1v0" not in names


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"rows": 0}, "rows"),
        ({"rows": 2.5}, "rows"),
        ({"slope": 0.9}, "slope"),
        ({"slope": float("nan")}, "slope"),
        ({"style": "guyot"}, "style"),
        ({"sun_elevation": 0.0}, "sun_elevation"),
        ({"nails_per_row": 4}, "nails_per_row is 4, but a row has 3 posts"),
        ({"rows": 30, "nails_per_row": 2}, "marker ids"),
    ],
)
def test_options_out_of_range_are_refused(values, word):
    with pytest.raises(InvalidInput, match=word):
        VineyardOptions(**values)


def test_options_come_from_a_users_file_with_their_place():
    document = Document(file="m.yaml", data={"world": {"style": "gobelet", "slope": 0.15}}, places={("world",): (3, 1)})
    options = validate_options(VineyardOptions, document, ("world",))
    assert (options.style, options.slope, options.rows) == ("gobelet", 0.15, 3)
    for values in ({"slop": 0.1}, {"nails_per_row": 9}):
        document = Document(file="m.yaml", data={"world": values}, places={("world",): (3, 1)})
        with pytest.raises(FileError, match=r"m\.yaml:3:1: world"):
            validate_options(VineyardOptions, document, ("world",))


def test_the_sun_shines_from_where_it_is_put():
    sun = generate_vineyard(VineyardOptions(sun_azimuth=90.0, sun_elevation=30.0, sun_strength=0.5, rows=1)).sun
    np.testing.assert_allclose(-sun.direction, [math.cos(math.pi / 6), 0.0, 0.5], atol=1e-12)
    assert sun.diffuse[0] == pytest.approx(0.375)
