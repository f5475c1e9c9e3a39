"""Mud: where it lies, what the wheels have of it, and what the wheel odometry makes of that."""

from dataclasses import replace

import numpy as np
import pytest

from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.simulation import Simulation, SimulationOptions
from grape.sim.worlds import VineyardOptions, generate_vineyard

DRY = VineyardOptions(rows=1, vines_per_row=2, nails_per_row=1, weeds=0.0, slope=0.1, roughness_rms=0.0)
EVERYWHERE = [[0.0, 0.0, 50.0]]


@pytest.fixture
def on_mud():
    """A simulation of a slope of 10 % with patches (x, y, radius)."""
    made = []

    def build(patches, friction=0.12):
        world = generate_vineyard(DRY)
        terrain = replace(world.terrain, mud=np.reshape(patches, (-1, 3)), mud_friction=friction)
        options = SimulationOptions(dispensers=0)
        made.append(Simulation(replace(world, terrain=terrain), DESCRIPTION, seed=1, options=options))
        return made[-1]

    yield build
    for simulation in made:
        simulation.close()


def drive(simulation, seconds, speed=0.5):
    """Metres driven by the truth, and by the mean of the wheels."""
    base, before = simulation.drivers.base, simulation.referee.true_pose()[:3, 3]
    turned = base.latest().position
    for _ in range(round(100 * seconds)):
        base.send(speed, 0.0)
        simulation.advance()
    moved = np.linalg.norm(simulation.referee.true_pose()[:3, 3] - before)
    return moved, float(np.mean(base.latest().position - turned)) * DESCRIPTION.base.wheel_radius


def frictions(simulation):
    model = simulation._physics.model
    return np.array([model.geom(name).friction[0] for name in DESCRIPTION.base.wheel_joints])


def test_wheels_tell_more_than_the_robot_drives_uphill_in_mud(on_mud):
    moved, told = drive(on_mud(EVERYWHERE), 2.5)
    assert told > 1.3 * moved
    moved, told = drive(on_mud([]), 2.5)
    assert told == pytest.approx(moved, rel=0.03)


def test_a_slope_steeper_than_its_friction_holds_nothing(on_mud):
    moved, told = drive(on_mud(EVERYWHERE, friction=0.05), 1.5, speed=0.0)
    assert moved > 0.2 and abs(told) < 0.02


def test_each_wheel_has_the_ground_that_it_stands_on(on_mud):
    x, y = generate_vineyard(DRY).site.start
    simulation = on_mud([[x + 0.256, y + 0.2854, 0.3]])  # the front left wheel
    assert frictions(simulation) == pytest.approx([0.12, 0.7, 0.7, 0.7])
    drive(simulation, 1.6)  # 0.6 m on, the rear left wheel stands there
    assert frictions(simulation) == pytest.approx([0.7, 0.7, 0.12, 0.7])
    drive(simulation, 1.5)
    assert frictions(simulation) == pytest.approx([0.7] * 4)


def test_mud_is_not_better_than_dry_ground(on_mud):
    assert frictions(on_mud(EVERYWHERE, friction=0.9)) == pytest.approx([0.7] * 4)


def test_a_world_in_mud_that_was_brought_back_goes_on_to_the_last_bit(on_mud, tmp_path):
    x, y = generate_vineyard(DRY).site.start
    patches = [[x + 0.45, y + 0.3, 0.15], [x + 0.6, y - 0.3, 0.15]]
    whole = on_mud(patches)
    drive(whole, 1.2)
    killed = on_mud(patches)
    killed.keep(tmp_path / "world")
    drive(killed, 0.7)
    resumed = on_mud(patches)
    resumed.keep(tmp_path / "world")
    for _ in range(50):  # its wheels have told nothing yet
        resumed.drivers.base.send(0.5, 0.0)
        resumed.advance()
    assert resumed._physics.data.qpos.tobytes() == whole._physics.data.qpos.tobytes()


def test_mud_changes_nothing_else_and_the_default_world_has_none():
    dry, wet = generate_vineyard(VineyardOptions(seed=4)), generate_vineyard(VineyardOptions(seed=4, mud=30))
    assert len(dry.terrain.mud) == 0 and len(wet.terrain.mud) > 15
    assert wet.terrain.heights.tobytes() == dry.terrain.heights.tobytes()
    told = [[(c.name, *c.p0, *c.p1, c.radius) for c in world.capsules] for world in (dry, wet)]
    assert told[0] == told[1]


def test_patches_follow_the_seed_and_leave_the_start_dry():
    options = VineyardOptions(seed=4, mud=200, mud_radius=0.5)
    one, same, other = (generate_vineyard(replace(options, seed=seed)) for seed in (4, 4, 5))
    assert one.terrain.mud.tobytes() == same.terrain.mud.tobytes() != other.terrain.mud.tobytes()
    assert ((one.terrain.mud[:, 2] >= 0.3) & (one.terrain.mud[:, 2] <= 0.7)).all()
    around = one.site.start + 1.19 * np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 6.2, 40)])
    assert not one.terrain.muddy(around).any() and not one.terrain.muddy(one.site.start)


def test_mud_is_dark_in_the_picture_of_the_ground():
    from grape.sim.worlds.textures import MUD, ground_picture

    world = generate_vineyard(replace(DRY, mud=3))
    dry = ground_picture(world.site, replace(world.terrain, mud=np.empty((0, 3))), np.random.default_rng(0))
    wet = ground_picture(world.site, world.terrain, np.random.default_rng(0))
    changed = (dry != wet).any(axis=-1)
    assert 0.0 < changed.mean() < 0.5 and abs(wet[changed].mean(axis=0) / 255 - MUD).max() < 0.05
