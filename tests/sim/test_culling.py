"""Culling of the search for contacts: what it hides could not have touched."""

import mujoco
import numpy as np
import pytest

from grape.sim.culling import ContactCulling
from grape.sim.faults import DropDispenser
from grape.sim.worlds import export
from tests.sim.conftest import over, place


def commanded(simulation, beats):
    """Drive, then move the arm and a loop about: the number of contacts after each beat."""
    found = []
    for beat in range(beats):
        simulation.drivers.base.send(0.8 if beat < 40 else 0.0, 0.5)
        simulation.drivers.arm.send(0.5 * np.sin(np.arange(6) + beat / 20))
        if beat == 60:
            simulation.inject(DropDispenser(index=1))
        simulation.advance()
        found.append(simulation._physics.data.ncon)
    return found


def with_loops_on_plants(simulation):
    """The simulation, its first two loops on an upright spur and a nail."""
    world = simulation.world
    spur, nail = max(world.spurs, key=lambda spur: spur.direction[2]), world.nails[0]
    place(simulation, 0, over(spur.tip, spur.base))
    place(simulation, 1, over(nail.tip, nail.base))
    simulation._physics.rearranged()
    return simulation


@pytest.fixture(params=[False, True], ids=["small", "large"])
def vineyard(request, monkeypatch):
    """Whether the plants have bodies of their own, or are the world's as in a large vineyard."""
    if request.param:
        monkeypatch.setattr(export, "MOST_BODIES", 1)


def contacts(simulation):
    """Place and depth (n, 4) of each contact, and the names of the plants and posts that are touched."""
    data, parts = simulation._physics.data, simulation.referee._parts
    rows = np.column_stack([data.contact.pos, data.contact.dist])
    return rows[np.lexsort(rows.T)], sorted(
        parts.names[geom] for geom in data.contact.geom.ravel() if parts.plants[geom]
    )


def hidden_bodies(model):
    """Which bodies are out of the search for contacts: (bodies,) bool."""
    return (model.body_contype | model.body_conaffinity) == 0


@pytest.mark.usefixtures("vineyard")
def test_a_culled_scene_moves_as_the_whole_one_to_the_last_bit(simulate, monkeypatch):
    culled, whole = simulate(seed=3, dispensers=2), simulate(seed=3, dispensers=2)
    contacts = commanded(culled, 110)
    whole._physics.rearranged()
    monkeypatch.setattr(ContactCulling, "look", lambda self, data: None)
    assert commanded(whole, 110) == contacts
    assert culled._physics.data.qpos.tobytes() == whole._physics.data.qpos.tobytes()
    assert max(contacts) > min(contacts)


@pytest.mark.usefixtures("vineyard")
def test_loops_hang_on_plants_as_in_the_whole_scene_to_the_last_bit(simulate, monkeypatch):
    culled, whole = (with_loops_on_plants(simulate(seed=3, dispensers=2)) for _ in range(2))
    culled.advance(steps=300)
    monkeypatch.setattr(ContactCulling, "look", lambda self, data: None)
    whole.advance(steps=300)
    assert culled._physics.data.qpos.tobytes() == whole._physics.data.qpos.tobytes()
    touched = contacts(culled)[1]
    assert any("spur" in name or "arm" in name for name in touched) and any("nail" in name for name in touched)


def test_a_large_vineyard_is_touched_where_its_plants_would_be(simulate, monkeypatch):
    usual = with_loops_on_plants(simulate(dispensers=2))
    usual.advance(steps=300)
    monkeypatch.setattr(export, "MOST_BODIES", 1)
    large = simulate(dispensers=2)
    large._physics.data.qpos[:] = usual._physics.data.qpos
    large._physics.rearranged()
    for simulation in (usual, large):
        mujoco.mj_forward(simulation._physics.model, simulation._physics.data)
    (places, names), (large_places, large_names) = contacts(usual), contacts(large)
    assert names == large_names and len(names) > 3
    np.testing.assert_allclose(large_places, places, rtol=0.0, atol=1e-9)


def test_far_bodies_are_hidden_and_the_ground_stays(simulate):
    simulation = simulate(dispensers=1)
    simulation.advance()
    model = simulation._physics.model
    hidden = hidden_bodies(model)
    assert hidden[model.body("world/r0v1/").id]
    assert not hidden[model.body("world/ground").id]
    assert not hidden[model.body("wheel_front_left").id]
    assert hidden[model.body("dispenser_0_p2").id], "a tube in the feeder has nothing near"


def test_the_wires_are_hidden_while_the_robot_is_in_the_lane(simulate):
    simulation = simulate()
    physics, row = simulation._physics, simulation.world.site.rows[0].line
    physics.data.qpos[physics.model.joint("base").qposadr[0] :][:2] = row.mean(axis=0) - [0.0, 1.3]
    simulation.advance(steps=20)
    model = physics.model
    wires = [body for body in range(model.nbody) if "/wire" in model.body(body).name]
    assert len(wires) == 3 and hidden_bodies(model)[wires].all()


def test_a_large_vineyard_is_hidden_until_something_is_near(simulate, monkeypatch):
    monkeypatch.setattr(export, "MOST_BODIES", 1)
    simulation = simulate(dispensers=2)
    model = simulation._physics.model
    simulation.advance(steps=20)
    assert hidden_bodies(model)[0] and not hidden_bodies(model)[model.body("world/ground").id]
    with_loops_on_plants(simulation).advance(steps=20)
    assert not hidden_bodies(model)[0]


def test_what_was_put_elsewhere_is_seen_at_once(simulate):
    simulation = simulate(dispensers=1)
    simulation.advance()
    simulation.inject(DropDispenser(index=0))
    model = simulation._physics.model
    assert model.body_contype[model.body("dispenser_0_p2").id]
