"""Triangle meshes of the world's pieces, each made in one go for many pieces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grape.messages import Array
from grape.sim.worlds.model import Capsule, Plate, Terrain

SIDES = 8
# Corner radius of the octagon whose radius, averaged over all directions, is 1: so ranges are right in the mean.
_ROUNDNESS = 1.0 / (np.cos(np.pi / SIDES) * SIDES / np.pi * np.arcsinh(np.tan(np.pi / SIDES)))
Meshes = tuple[
    Array, Array, Array
]  # vertices (n, 3) m in the map frame, triangles (m, 3), index of the piece of each triangle (m,)


def terrain_mesh(terrain: Terrain) -> Meshes:
    """The ground, one piece."""
    X, Y = np.meshgrid(terrain.xs, terrain.ys)
    index = np.arange(X.size).reshape(X.shape)
    a, b, c, d = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel()
    triangles = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
    vertices = np.column_stack([X.ravel(), Y.ravel(), terrain.heights.ravel()])
    return vertices, triangles, np.zeros(len(triangles), int)


def capsule_meshes(capsules: Sequence[Capsule]) -> Meshes:
    """Tubes of 8 sides with pointed ends: a ring at each end of the axis and a tip where the round end is farthest."""
    n = len(capsules)
    if n == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), int), np.zeros(0, int)
    p0, p1 = np.array([c.p0 for c in capsules]), np.array([c.p1 for c in capsules])
    radius = np.array([c.radius for c in capsules])[:, None]
    axis = p1 - p0
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9)
    helper = np.where(np.abs(axis[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    w = np.cross(axis, u)
    turn = np.arange(SIDES) * 2 * np.pi / SIDES
    ring = (radius * _ROUNDNESS)[:, None] * (
        np.cos(turn)[None, :, None] * u[:, None] + np.sin(turn)[None, :, None] * w[:, None]
    )  # (n, SIDES, 3)
    vertices = np.concatenate(
        [p0[:, None] + ring, p1[:, None] + ring, (p0 - radius * axis)[:, None], (p1 + radius * axis)[:, None]], axis=1
    )
    k = np.arange(SIDES)
    m = (k + 1) % SIDES
    first, last = np.full(SIDES, 2 * SIDES), np.full(SIDES, 2 * SIDES + 1)
    one = np.concatenate(
        [
            np.column_stack([k, m, k + SIDES]),
            np.column_stack([m, m + SIDES, k + SIDES]),
            np.column_stack([first, m, k]),
            np.column_stack([last, k + SIDES, m + SIDES]),
        ]
    )
    return _repeat(vertices, one)


def plate_meshes(plates: Sequence[Plate]) -> Meshes:
    """Boxes of 12 triangles."""
    if not plates:
        return np.zeros((0, 3)), np.zeros((0, 3), int), np.zeros(0, int)
    corner = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float)
    vertices = np.array([(corner * p.half_size) @ p.T_map_plate[:3, :3].T + p.T_map_plate[:3, 3] for p in plates])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    one = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return _repeat(vertices, one)


def _repeat(vertices: Array, triangles: Array) -> Meshes:
    """The same triangles (m, 3) for every piece of vertices (n, v, 3)."""
    n, v, _ = vertices.shape
    shifted = triangles[None] + v * np.arange(n)[:, None, None]
    return vertices.reshape(-1, 3), shifted.reshape(-1, 3), np.repeat(np.arange(n), len(triangles))
