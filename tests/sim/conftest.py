"""A small flat world with one vine row, shared by the tests of the simulation."""

import os
from functools import cache

import numpy as np
import pytest

os.environ.setdefault("MUJOCO_GL", "egl")

from grape.geometry import pose
from grape.robots.husky_jaco2 import DESCRIPTION as HUSKY
from grape.sim.dispenser import place_dispenser
from grape.sim.simulation import Simulation, SimulationOptions
from grape.sim.worlds import VineyardOptions, generate_vineyard


@cache
def small_world(slope=0.0, style="cordon"):
    """One row of two vines and one nail on smooth ground."""
    return generate_vineyard(
        VineyardOptions(
            rows=1, vines_per_row=2, nails_per_row=1, weeds=0.0, slope=slope, roughness_rms=0.0, style=style
        )
    )


def make(seed=1, dispensers=0, slope=0.0, style="cordon", robot=HUSKY, **options):
    """A simulation of the small world."""
    return Simulation(
        small_world(slope, style), robot, seed=seed, options=SimulationOptions(dispensers=dispensers, **options)
    )


@pytest.fixture
def simulate():
    """`make`, with what it made closed after the test."""
    made = []

    def build(**options):
        made.append(make(**options))
        return made[-1]

    yield build
    for simulation in made:
        simulation.close()


def place(simulation, index, T_map_loop):
    """Put a dispenser elsewhere, relaxed and at rest."""
    physics = simulation._physics
    place_dispenser(physics.model, physics.data, f"dispenser_{index}", T_map_loop)


def over(tip, base, along=0.0):
    """A loop a little below a tip, its plane square to the spur or nail, its middle `along` beside it."""
    z = (tip - base) / np.linalg.norm(tip - base)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(z, x), z])
    return pose(R, tip - 0.015 * z + R @ np.array([0.0, along, 0.0]))
