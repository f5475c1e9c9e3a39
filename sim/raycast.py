"""Distances along rays to the static world and to who walks in it: what laser scanners measure before their errors.

Open3D's raycasting (Embree) over triangle meshes takes 5 ms for 14 400 rays whatever the number of vines.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array
from grape.sim.worlds.model import Capsule, Label, Plate, World
from grape.sim.worlds.surfaces import Meshes, capsule_meshes, plate_meshes, terrain_mesh
from grape.sim.worlds.walkers import Walkers

NO_LABEL = -1


class Raycaster:
    """Rays against the world's ground, rods and plates."""

    def __init__(self, world: World) -> None:
        import open3d as o3d

        self._tensor: Any = o3d.core.Tensor
        self._scene = o3d.t.geometry.RaycastingScene()
        self._owners: list[Array] = []  # per mesh: index of the piece that each triangle belongs to
        self._pieces: list[tuple[Capsule | Plate, ...]] = []
        self._add(terrain_mesh(world.terrain), ())
        self._add(capsule_meshes(world.capsules), world.capsules)
        self._add(plate_meshes(world.plates), world.plates)

    def _add(self, meshes: Meshes, pieces: tuple[Capsule | Plate, ...]) -> None:
        vertices, triangles, owners = meshes
        if len(triangles):
            self._scene.add_triangles(
                self._tensor(vertices.astype(np.float32)), self._tensor(triangles.astype(np.uint32))
            )
            self._owners.append(owners)
            self._pieces.append(pieces)

    def cast(self, origins: Array, directions: Array) -> Array:
        """Distances (n,) in metres to the first hit, inf where a ray meets nothing.

        Args:
            origins: (n, 3) m, map frame.
            directions: (n, 3) unit vectors, map frame.

        Raises:
            InvalidInput: the shapes are not (n, 3) both.
        """
        return self._hits(origins, directions)["t_hit"].numpy().astype(float)

    def cast_labelled(self, origins: Array, directions: Array) -> tuple[Array, Array, list[str]]:
        """As `cast`, with the label (n,) of each hit (-1 for none) and the name of its piece: for referee and tests."""
        hits = self._hits(origins, directions)
        ranges = hits["t_hit"].numpy().astype(float)
        meshes, triangles = hits["geometry_ids"].numpy(), hits["primitive_ids"].numpy()
        labels = np.full(len(ranges), NO_LABEL)
        names = [""] * len(ranges)
        for k in np.flatnonzero(np.isfinite(ranges)):
            pieces = self._pieces[meshes[k]]
            if not pieces:
                labels[k], names[k] = Label.GROUND, "ground"
                continue
            piece = pieces[self._owners[meshes[k]][triangles[k]]]
            labels[k], names[k] = piece.label, piece.name
        return ranges, labels, names

    def distance(self, points: Array) -> Array:
        """Distances (n,) in metres of points (n, 3), map frame, to the nearest surface: for referee and tests."""
        query = self._tensor(np.asarray(points, np.float32).reshape(-1, 3))
        return np.asarray(self._scene.compute_distance(query).numpy(), float)

    def _hits(self, origins: Array, directions: Array) -> Any:
        origins, directions = np.asarray(origins), np.asarray(directions)
        if origins.ndim != 2 or origins.shape[1] != 3 or origins.shape != directions.shape:
            raise InvalidInput(f"rays need origins and directions (n, 3), got {origins.shape} and {directions.shape}")
        rays = np.concatenate([origins, directions], axis=1).astype(np.float32)
        return self._scene.cast_rays(self._tensor(rays))


class MovingRays:
    """Rays against a static world and the walkers in it.

    Args:
        cast: distances (n,) m to the static world, of origins and unit directions (n, 3).
    """

    def __init__(self, cast: Callable[[Array, Array], Array], walkers: Walkers) -> None:
        self._cast, self._walkers = cast, walkers

    def cast(self, origins: Array, directions: Array, time_s: float) -> Array:
        """Distances (n,) in metres to the first hit at a time, inf where a ray meets nothing."""
        distances = self._cast(origins, directions)
        for ends, radii in self._walkers.rods(time_s):
            centre = ends.reshape(-1, 3).mean(axis=0)
            reach = (np.linalg.norm(ends - centre, axis=2) + radii[:, None]).max()
            offset = centre - origins
            along = (offset * directions).sum(axis=1)
            aside2 = (offset**2).sum(axis=1) - along**2
            near = np.flatnonzero((aside2 < reach**2) & (along > -reach) & (along - reach < distances))
            for (p0, p1), radius in zip(ends, radii, strict=True):
                hits = capsule_distances(origins[near], directions[near], p0, p1, float(radius))
                distances[near] = np.minimum(distances[near], hits)
        return distances


def capsule_distances(origins: Array, directions: Array, p0: Array, p1: Array, radius: float) -> Array:
    """Distances (n,) along rays to a capsule from `p0` to `p1` (3,), inf where they miss it; all in metres.

    Args:
        origins: (n, 3), outside the capsule.
        directions: (n, 3) unit vectors.
    """
    axis, offset = p1 - p0, origins - p0
    length2 = float(axis @ axis)
    d_axis, o_axis = directions @ axis, offset @ axis
    # The tube: |offset + t d|^2 across the axis = radius^2.
    a = length2 - d_axis**2
    b = length2 * (offset * directions).sum(axis=1) - o_axis * d_axis
    c = length2 * (offset**2).sum(axis=1) - o_axis**2 - radius**2 * length2
    root2 = b * b - a * c
    t = np.where((root2 >= 0.0) & (a > 1e-12), (-b - np.sqrt(np.maximum(root2, 0.0))) / np.maximum(a, 1e-12), np.inf)
    place = o_axis + np.where(np.isfinite(t), t, 0.0) * d_axis
    best = np.where((place >= 0.0) & (place <= length2) & (t >= 0.0), t, np.inf)
    for end in (p0, p1):
        away = origins - end
        b = (away * directions).sum(axis=1)
        root2 = b * b - (away**2).sum(axis=1) + radius**2
        t = np.where(root2 >= 0.0, -b - np.sqrt(np.maximum(root2, 0.0)), np.inf)
        best = np.minimum(best, np.where(t >= 0.0, t, np.inf))
    return best
