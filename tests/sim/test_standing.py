"""The true map: trunks, posts and weeds where they stand, without what is driven over or only hangs above."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grape.sim.standing import standing_cells
from grape.sim.worlds.model import Capsule, Label
from tests.sim.conftest import small_world


def rod(p0, p1, label):
    return Capsule(name="rod", p0=np.array(p0), p1=np.array(p1), radius=0.02, label=label, rgba=(0, 0, 0, 1))


def test_only_what_is_in_the_way_stands():
    world = replace(small_world(), plates=(), capsules=(
        rod([1.02, 2.03, 0.0], [1.02, 2.03, 1.0], Label.TRUNK),
        rod([5.0, 5.0, 0.0], [5.0, 5.0, 0.1], Label.WEED),
        rod([0.0, 7.0, 1.0], [9.0, 7.0, 1.0], Label.WIRE),
        rod([3.0, 3.0, 2.0], [4.0, 3.0, 2.5], Label.CANE),
    ))  # fmt: skip
    np.testing.assert_allclose(standing_cells(world), [[1.05, 2.05]])


def test_every_trunk_of_a_vineyard_stands():
    world = small_world()
    cells = standing_cells(world)
    for plant in world.site.plants:
        assert np.hypot(*(cells - plant.position[:2]).T).min() < 0.1


def test_heights_count_over_the_ground():
    world = small_world(slope=0.2)
    assert len(standing_cells(world)) > 0.5 * len(standing_cells(small_world()))
