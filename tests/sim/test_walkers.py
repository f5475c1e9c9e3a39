"""People and animals: where they are, who sees them, and what the referee makes of them."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import pose, rotation_y
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.areas import distance_to_rods
from grape.sim.encounters import Encounters
from grape.sim.raycast import capsule_distances
from grape.sim.simulation import Simulation, SimulationOptions
from grape.sim.worlds import Terrain, VineyardOptions, WalkerOptions, generate_vineyard
from grape.sim.worlds.walkers import Walkers

FLAT = Terrain(heights=np.zeros((2, 2)), x_range=(-50.0, 50.0), y_range=(-50.0, 50.0), slope=0.0)
WORLD = generate_vineyard(
    VineyardOptions(rows=1, vines_per_row=2, nails_per_row=1, weeds=0.0, slope=0.0, roughness_rms=0.0)
)


def there(time_s: float, **options) -> list[float]:
    """x, y and yaw of one walker."""
    walker = WalkerOptions(**{"id": "a", "path": ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0)), "speed": 0.5, **options})
    x, y, _, yaw = Walkers((walker,), FLAT).poses(time_s)[0]
    return [float(x), float(y), float(yaw)]


def test_a_walker_starts_walks_waits_and_stays():
    places = {t: there(t, start_s=3.0, wait_s=2.0) for t in (0.0, 3.0, 5.0, 7.0, 8.9, 10.0, 60.0)}
    assert places[0.0] == places[3.0] == [0.0, 0.0, 0.0]
    assert places[5.0] == pytest.approx([1.0, 0.0, 0.0])
    assert places[7.0] == places[8.9] == pytest.approx([2.0, 0.0, 0.0]), "waits"
    assert places[10.0] == pytest.approx([2.0, 0.5, np.pi / 2])
    assert places[60.0] == pytest.approx([2.0, 1.0, np.pi / 2])


def test_a_walker_in_a_loop_comes_round_again():
    length = 3.0 + np.hypot(2.0, 1.0)
    assert there(1.0 + 3 * length / 0.5, loop=True) == pytest.approx(there(1.0, loop=True), abs=1e-9)
    assert there(0.9 * length / 0.5, loop=True)[:2] == pytest.approx([0.2 * length / 2, 0.1 * length / 2], abs=0.2)


def test_a_walker_is_never_faster_than_it_says():
    times = np.arange(0.0, 20.0, 0.1)
    places = np.array([there(t, wait_s=0.3, loop=True)[:2] for t in times])
    assert np.hypot(*np.diff(places, axis=0).T).max() <= 0.05 + 1e-9


def test_walkers_stay_on_the_ground():
    hill = replace(FLAT, heights=np.array([[0.0, 10.0], [0.0, 10.0]]))
    walkers = Walkers((WalkerOptions(id="a", path=((10.0, 0.0),)),), hill)
    assert walkers.poses(0.0)[0, 2] == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("change", "text"),
    [({"speed": 9.0}, "speed"), ({"path": ()}, "path"), ({"kind": "cow"}, "kind"), ({"id": "a b"}, "id")],
)
def test_impossible_walkers_are_refused(change, text):
    with pytest.raises(InvalidInput, match=text):
        WalkerOptions(**{"id": "a", "path": ((0.0, 0.0),), **change})


def test_two_walkers_of_one_id_are_refused():
    with pytest.raises(InvalidInput, match="id of its own"):
        VineyardOptions(walkers=(WalkerOptions(id="a", path=((0.0, 0.0),)),) * 2)


def test_rays_to_a_capsule_agree_with_the_physics_engine():
    rng = np.random.default_rng(3)
    p0, p1, radius = np.array([0.1, -0.2, 0.3]), np.array([-0.3, 0.4, 1.1]), 0.15
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[radius, 0, 0], fromto=[*p0, *p1])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    origins = rng.normal(size=(500, 3))
    origins *= 2.0 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.normal(scale=0.3, size=(500, 3)) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ours = capsule_distances(origins, directions, p0, p1, radius)
    geom = np.zeros(1, dtype=np.int32)
    theirs = np.array(
        [mujoco.mj_ray(model, data, o, d, None, 1, -1, geom, None) for o, d in zip(origins, directions, strict=True)]
    )
    assert (theirs > 0).sum() > 60 and (theirs < 0).sum() > 50
    np.testing.assert_allclose(np.where(theirs < 0, np.inf, theirs), ours, atol=1e-9)


def test_distance_to_rods_is_between_their_outlines():
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    rods = np.array([[[3.0, -5.0], [3.0, 5.0]], [[4.0, 4.0], [9.0, 9.0]]])
    assert distance_to_rods(square, rods, np.array([0.2, 0.1])) == pytest.approx(1.8)
    assert distance_to_rods(square, rods[1:], np.array([0.1])) == pytest.approx(np.hypot(3, 3) - 0.1)
    assert distance_to_rods(square, np.array([[[0.0, 0.0], [0.0, 0.0]]]), np.array([0.1])) == 0.0
    assert distance_to_rods(square, np.array([[[-5.0, 0.0], [5.0, 0.0]]]), np.array([0.1])) == 0.0


def simulate(*walkers: WalkerOptions) -> Simulation:
    options = SimulationOptions(dispensers=0, settle_s=0.2)
    return Simulation(replace(WORLD, walkers=walkers), DESCRIPTION, seed=1, options=options)


@pytest.fixture(scope="module")
def met() -> Simulation:
    """A person who comes from 6 m ahead of the robot, at (-3, -1.3) and facing +x, to 2 m before its centre."""
    simulation = simulate(WalkerOptions(id="anna", path=((3.0, -1.3), (-1.0, -1.3)), speed=2.0))
    for _ in range(200):
        simulation.advance()
        simulation.referee.observe()
    yield simulation
    simulation.close()


def test_the_front_laser_sees_the_legs_where_they_are(met):
    scan = met.drivers.scans["front_laser"].latest()
    ahead = scan.ranges[540 - 40 : 540 + 41]
    legs = -1.0 - -3.0 - 0.45 - 0.2  # to the person's centre, less half a stride
    assert np.abs(ahead[np.isfinite(ahead)].min() - legs) < 0.15
    old = met.drivers.scans["front_laser"].since(met.clock.now() - 1.5)[0]
    assert old.ranges[540 - 40 : 540 + 41].min() > ahead.min() + 1.0, "an old frame shows where it was then"


def test_the_velodyne_sees_the_body(met):
    points = met.drivers.clouds["velodyne"].latest().points
    body = points[
        (np.abs(points[:, 1] - 0.2) < 0.3) & (points[:, 0] > 1.2) & (points[:, 0] < 2.0) & (points[:, 2] > -0.4)
    ]
    assert len(body) > 50 and np.ptp(body[:, 2]) > 0.5


def test_the_camera_sees_the_person(met):
    from grape.sim.render import View

    beside = View(target=np.array([-1.0, -1.3, 1.0]), distance_m=3.0, azimuth_deg=90.0, elevation_deg=0.0)
    picture = met.render(beside, 320, 240).astype(int)
    blue = (picture[..., 0] < 60) & (picture[..., 2] > picture[..., 0] + 20)  # trousers and shirt, not the sky
    rows, columns = np.nonzero(blue[60:, 110:210])
    assert len(rows) > 300 and np.ptp(rows) > 60 and np.ptp(columns) < 90


def test_the_referee_tells_the_least_distance_and_no_contact(met):
    found = met.referee.verdict()["truth"]
    assert found["walkers"]["anna"]["contacts"] == 0 and found["collisions"] == []
    front = -3.0 + 0.495
    assert found["walkers"]["anna"]["least_distance_m"] == pytest.approx(-1.0 - 0.25 - front, abs=0.03)


@pytest.mark.parametrize("slope", [0.0, 0.15, -0.15])
def test_the_least_distance_is_seen_from_above_on_a_slope_too(slope):
    hill = replace(FLAT, heights=np.array([[-50.0, 50.0], [-50.0, 50.0]]) * slope)
    anna = Walkers((WalkerOptions(id="anna", path=((1.5, 0.0),)),), hill)
    footprint = np.array([[0.5, 0.3], [-0.5, 0.3], [-0.5, -0.3], [0.5, -0.3]])
    encounters = Encounters(anna, footprint)
    tilt = np.arctan(slope)
    encounters.observe(pose(rotation_y(-tilt), (0.0, 0.0, 0.13)), 0.0)
    nearest = 1.5 - 0.18 - 0.07  # a foot
    assert encounters.least_m[0] == pytest.approx(nearest - 0.5 * np.cos(tilt), abs=0.005)


def test_a_walker_who_runs_into_the_robot_touches_it_and_is_not_pushed():
    simulation = simulate(WalkerOptions(id="pig", kind="boar", path=((-1.3, -1.3), (-2.2, -1.3)), speed=2.0))
    for _ in range(60):
        simulation.advance()
        simulation.referee.observe()
    found = simulation.referee.verdict()["truth"]
    simulation.close()
    assert found["walkers"]["pig"]["contacts"] >= 1 and found["walkers"]["pig"]["least_distance_m"] == 0.0
    assert all(entry["b"] == "walker/pig" for entry in found["collisions"])


def test_without_walkers_nothing_is_told_of_them():
    simulation = simulate()
    simulation.advance()
    simulation.referee.observe()
    assert "walkers" not in simulation.referee.verdict()["truth"]
    assert simulation._physics.snapshot().tobytes() == simulation._physics.data.qpos.tobytes()
    simulation.close()


def test_a_world_that_was_kept_goes_on_with_its_walkers(tmp_path):
    walker = WalkerOptions(id="rex", kind="dog", path=((1.0, -3.0), (-6.0, -3.0)))
    first = simulate(walker)
    first.keep(tmp_path)
    for _ in range(30):
        first.advance()
    scan = first.drivers.scans["front_laser"].latest()
    first.close()
    second = simulate(walker)
    assert second.keep(tmp_path)
    for _ in range(5):
        first.advance()
        second.advance()
    again, expected = (simulation.drivers.scans["front_laser"].latest() for simulation in (second, first))
    second.close()
    assert scan.stamp < again.stamp and again.ranges.tobytes() == expected.ranges.tobytes()
