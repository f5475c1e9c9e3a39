"""Culling of the search for contacts: what it hides could not have touched."""

import numpy as np

from grape.sim.culling import ContactCulling
from grape.sim.faults import DropDispenser


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


def test_a_culled_scene_moves_as_the_whole_one_to_the_last_bit(simulate, monkeypatch):
    culled, whole = simulate(seed=3, dispensers=2), simulate(seed=3, dispensers=2)
    contacts = commanded(culled, 110)
    whole._physics.rearranged()
    monkeypatch.setattr(ContactCulling, "look", lambda self, data: None)
    assert commanded(whole, 110) == contacts
    assert culled._physics.data.qpos.tobytes() == whole._physics.data.qpos.tobytes()
    assert max(contacts) > min(contacts)


def test_far_bodies_are_hidden_and_the_ground_stays(simulate):
    simulation = simulate(dispensers=1)
    simulation.advance()
    model = simulation._physics.model
    hidden = (model.body_contype | model.body_conaffinity) == 0
    assert hidden[model.body("world/r0v1").id]
    assert not hidden[model.body("world/ground").id]
    assert not hidden[model.body("wheel_front_left").id]
    assert hidden[model.body("dispenser_0_p2").id], "a tube in the feeder has nothing near"


def test_what_was_put_elsewhere_is_seen_at_once(simulate):
    simulation = simulate(dispensers=1)
    simulation.advance()
    simulation.inject(DropDispenser(index=0))
    model = simulation._physics.model
    assert model.body_contype[model.body("dispenser_0_p2").id]
