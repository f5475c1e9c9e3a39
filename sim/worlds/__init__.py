"""Seeded worlds: generators of vineyards, their site files, and their export to the physics and the ray caster."""

from grape.plugins import WorldType
from grape.sim.worlds.export import world_spec
from grape.sim.worlds.model import Capsule, Label, NailTruth, Plate, SpurTruth, Sun, Terrain, World
from grape.sim.worlds.options import VineyardOptions, WalkerOptions
from grape.sim.worlds.vineyard import generate_vineyard, grow_world, vineyard_site

VINEYARD = WorldType(options=VineyardOptions, site=vineyard_site, grow=grow_world)

__all__ = [
    "VINEYARD",
    "Capsule",
    "Label",
    "NailTruth",
    "Plate",
    "SpurTruth",
    "Sun",
    "Terrain",
    "VineyardOptions",
    "WalkerOptions",
    "World",
    "generate_vineyard",
    "grow_world",
    "vineyard_site",
    "world_spec",
]
