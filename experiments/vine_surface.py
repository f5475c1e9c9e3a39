"""A cloud of a vine beside the vine as it is: how far its points are off, and how much of the surface it has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from grape.messages import Array
from grape.sim.raycast import Raycaster
from grape.sim.worlds import Capsule, Label, World
from grape.tasks.dispenser.actions.scan_vine import SWEEP

WOOD = (Label.TRUNK, Label.ARM, Label.SPUR, Label.BUD, Label.CANE)
BESIDE_M, OVER_GROUND_M = 0.40, 0.30  # of the row's line, and over the ground: what is taken to be the vine
NEAR_M = 0.020  # a place of the surface has a point when one is nearer
SAMPLE_M2 = 1e-4  # of the surface, a sample
SKIN_M = 0.005  # by which a line of sight may end before a sample


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceScore:
    """How good a cloud is.

    Attributes:
        off_mm: (n,) of its points, from the nearest true surface.
        swept, seen: samples of the surface within the swept span, and those of them in the LiDAR's sight.
        had: samples in sight with a point nearby.
    """

    off_mm: Array
    swept: int
    seen: int
    had: int


def score_cloud(world: World, plant: str, points: Array, passes: Sequence[Array]) -> SurfaceScore:
    """Holds a cloud against its vine.

    Args:
        plant: id of the vine.
        points: (n, 3) m, map frame.
        passes: true poses (k, 4, 4) in map of the LiDAR on each straight pass along the row, which its plane crosses.
    """
    caster, samples = Raycaster(world), surface_samples(world, plant)
    places = [along_row(world, plant, T[:, :3, 3]) for T in passes]
    low, high = min(p.min() for p in places), max(p.max() for p in places)
    along = along_row(world, plant, samples)
    samples, along = (values[(along >= low) & (along <= high)] for values in (samples, along))
    seen = np.zeros(len(samples), bool)
    for T, lidar_along in zip(passes, places, strict=True):
        seen |= seen_from(caster.cast, samples, along, T, lidar_along)
    gaps, _ = cKDTree(points).query(samples[seen])
    near = points[of_vine(world, plant, points, low, high)]
    return SurfaceScore(
        off_mm=1e3 * caster.distance(near), swept=len(samples), seen=int(seen.sum()), had=int((gaps < NEAR_M).sum())
    )


def along_row(world: World, plant: str, points: Array) -> Array:
    """(n,) m from the plant, in the direction in which the row is worked."""
    spot = world.site.plant(plant)
    way: Array = (np.asarray(points)[:, :2] - spot.position) @ world.site.row(spot.row).work_direction
    return way


def of_vine(world: World, plant: str, points: Array, low: float, high: float) -> Array:
    """(n,) bool: points in the row between two places along it, over the ground."""
    spot = world.site.plant(plant)
    along = along_row(world, plant, points)
    aside = (points[:, :2] - spot.position) @ world.site.row(spot.row).aisle_normal
    height = points[:, 2] - world.terrain.height(points[:, :2])
    inside: Array = (along > low) & (along < high) & (np.abs(aside) < BESIDE_M) & (height > OVER_GROUND_M)
    return inside


def wood_of(world: World, plant: str) -> list[Capsule]:
    """The rods that a vine is made of."""
    return [rod for rod in world.capsules if rod.plant == plant and rod.label in WOOD]


def surface_samples(world: World, plant: str) -> Array:
    """(n, 3) m, map frame, evenly drawn points on the round sides of a vine's rods, over the ground."""
    rng, found = np.random.default_rng(0), [np.empty((0, 3))]
    for rod in wood_of(world, plant):
        axis = rod.p1 - rod.p0
        length = float(np.linalg.norm(axis))
        count = round(2 * np.pi * rod.radius * length / SAMPLE_M2)
        aside = rng.normal(size=(count, 3))
        aside -= np.outer(aside @ axis, axis) / length**2
        aside *= rod.radius / np.linalg.norm(aside, axis=1, keepdims=True)
        found.append(rod.p0 + rng.uniform(size=(count, 1)) * axis + aside)
    samples = np.concatenate(found)
    return samples[samples[:, 2] - world.terrain.height(samples[:, :2]) > OVER_GROUND_M]


def seen_from(cast: Any, samples: Array, along: Array, T_map_lidar: Array, lidar_along: Array) -> Array:
    """(n,) bool: samples with a free line of sight from the LiDAR abreast of them, within its ranges and bearings.

    Args:
        cast: distances (n,) m along rays, of origins and unit directions (n, 3).
        samples: (n, 3) m, and `along` (n,) m, where along the row they are.
        T_map_lidar: (k, 4, 4) on one pass, and `lidar_along` (k,) m, where along the row those are.
    """
    order = np.argsort(lidar_along)
    abreast = np.searchsorted(lidar_along[order], along)
    T = T_map_lidar[order[np.minimum(abreast, len(order) - 1)]]
    rays = samples - T[:, :3, 3]
    far = np.linalg.norm(rays, axis=1)
    ways = rays / far[:, None]
    bearing = np.arccos(np.clip(np.einsum("ni,ni->n", ways, T[:, :3, 0]), -1.0, 1.0))
    free = np.asarray(cast(T[:, :3, 3], ways)) > far - SKIN_M
    within = (far > SWEEP.range_m[0]) & (far < SWEEP.range_m[1]) & (bearing < SWEEP.bearing_rad[1])
    abeam = (along >= lidar_along.min()) & (along <= lidar_along.max())
    seen: Array = free & within & abeam
    return seen
