"""Seeded worlds: generators of vineyards, their site files, and their export to the physics and the ray caster."""

from grape.sim.worlds.export import world_spec
from grape.sim.worlds.model import Capsule, Label, NailTruth, Plate, SpurTruth, Sun, Terrain, World
from grape.sim.worlds.options import VineyardOptions
from grape.sim.worlds.vineyard import generate_vineyard, grow_world, vineyard_site

__all__ = [
    "Capsule",
    "Label",
    "NailTruth",
    "Plate",
    "SpurTruth",
    "Sun",
    "Terrain",
    "VineyardOptions",
    "World",
    "generate_vineyard",
    "grow_world",
    "vineyard_site",
    "world_spec",
]
