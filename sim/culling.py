"""Takes bodies that cannot touch anything soon out of the search for contacts.

MuJoCo asks every body for contacts in every step, though loops lie in their feeder and vines stand ten metres away.
Every other beat this lists which bodies are near each other, generously, and hides the rest of their contact bits.
Hidden pairs are too far apart to meet before the next look, so the contacts found are the same, number for number.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from grape.messages import Array
from grape.sim.cells import CELL_M, Cells

LOOK_STEPS = 10  # between two looks: 20 ms
MARGIN_M = 0.055  # around either body of a pair: nothing meets unseen that is slower than 5 m/s
_GROUND_BITS = 1 << 29, 1 << 30
_WORLD_BITS = 1 << 27, 1 << 28


@dataclass(frozen=True, kw_only=True)
class _WideBody:
    """A standing body whose box holds half of the world: asked by squares, and with contact bits of its own.

    Attributes:
        bits: (bodies, 2) added to contype and conaffinity of who is near it, none for who cannot touch it.
    """

    body: int
    cells: Cells
    bits: Array


class ContactCulling:
    """Holds the contact bits of a model's bodies to what is near.

    Args:
        model: whose `body_contype` and `body_conaffinity` are rewritten; those of its geoms stay.
        data: a state of it with poses; only fixed bodies are read.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model = model
        self._contype, self._conaffinity = model.body_contype.copy(), model.body_conaffinity.copy()
        touchable = (self._contype != 0) | (self._conaffinity != 0)
        fixed = (model.body_weldid == 0) & (model.body_mocapid < 0)
        unbounded = _bodies_with(model, mujoco.mjtGeom.mjGEOM_PLANE)
        ground = _bodies_with(model, mujoco.mjtGeom.mjGEOM_HFIELD)
        self._moving = np.flatnonzero(touchable & ~fixed)
        self._boxes = np.tile([-1e30] * 3 + [1e30] * 3, (model.nbody, 1))
        standing = np.setdiff1d(np.flatnonzero(touchable & fixed), np.union1d(unbounded, ground))
        first, geoms = _geoms_of(model, standing)
        boxes = _standing_boxes(model, data, geoms)
        for k, body in enumerate(standing):
            own = boxes[first[k] : first[k + 1]]
            self._boxes[body] = [*own[:, :3].min(axis=0), *own[:, 3:].max(axis=0)]
        self._wide: list[_WideBody] = []
        if len(ground) == 1 and fixed[ground[0]]:
            self._set_apart(int(ground[0]), Cells.of_ground(model, data, int(ground[0])), _GROUND_BITS)
        if 0 in standing:  # the pieces of a large vineyard
            self._set_apart(0, Cells.of_boxes(boxes[: first[1]]), _WORLD_BITS)
        partners = _partners(model, self._contype, self._conaffinity)
        apart = [wide.body for wide in self._wide]
        partners[apart, :] = partners[:, apart] = False
        self._first_partner, self._partners = _partner_lists(partners, self._moving)
        self._first, self._geoms = _geoms_of(model, self._moving)
        self._near = np.zeros((2, model.nbody), dtype=np.int32)

    def look(self, data: mujoco.MjData) -> None:
        """Find who is near whom, and let only them meet until the next look."""
        if not self._moving.size:
            return
        from grape.sim._culling_kernels import bound_bodies, mark_in_cells, mark_neighbours

        model, boxes, moving, near = self._model, self._boxes, self._moving, self._near
        bound_bodies(self._first, self._geoms, moving, data.geom_xpos, model.geom_rbound, MARGIN_M, boxes)
        near[:] = 0
        mark_neighbours(boxes, moving, self._first_partner, self._partners, self._contype, self._conaffinity, near)
        for wide in self._wide:
            cells = wide.cells
            mark_in_cells(boxes, moving, cells.lowest, cells.highest, cells.origin, CELL_M, wide.bits, wide.body, near)
        model.body_contype[:], model.body_conaffinity[:] = near

    def show_all(self) -> None:
        """Let everything meet everything until the next look: after bodies have been put elsewhere."""
        self._model.body_contype[:], self._model.body_conaffinity[:] = self._contype, self._conaffinity

    def _set_apart(self, body: int, cells: Cells, own: tuple[int, int]) -> None:
        bits = np.zeros((self._model.nbody, 2), dtype=np.int32)
        bits[(self._contype & self._conaffinity[body]) != 0, 0] = own[0]
        bits[(self._conaffinity & self._contype[body]) != 0, 1] = own[1]
        self._wide.append(_WideBody(body=body, cells=cells, bits=bits))


def _bodies_with(model: mujoco.MjModel, kind: mujoco.mjtGeom) -> Array:
    """Bodies that have touchable geoms of a type."""
    touchable = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return np.unique(model.geom_bodyid[(model.geom_type == kind) & touchable])


def _partners(model: mujoco.MjModel, contype: Array, conaffinity: Array) -> Array:
    """Which bodies may touch, as the engine sees it: (bodies, bodies) bool."""
    meets = (contype[:, None] & conaffinity[None, :]) != 0
    weld, parent = model.body_weldid, model.body_weldid[model.body_parentid[model.body_weldid]]
    child = (weld[:, None] == parent[None, :]) & (weld[:, None] != 0) & (weld[None, :] != 0)
    return (meets | meets.T) & ~(child | child.T) & (weld[:, None] != weld[None, :])


def _partner_lists(partners: Array, moving: Array) -> tuple[Array, Array]:
    """Each pair once, with its moving body: where each one's partners begin (moving + 1,), and their indices."""
    left = partners.copy()
    lists = []
    for body in moving:
        lists.append(np.flatnonzero(left[body]))
        left[:, body] = False
    first = np.concatenate([[0], np.cumsum([len(others) for others in lists])]).astype(np.int64)
    return first, np.concatenate([np.zeros(0, dtype=np.int64), *lists])


def _geoms_of(model: mujoco.MjModel, bodies: Array) -> tuple[Array, Array]:
    """Touchable geoms of bodies, one body after the other: where each begins (bodies + 1,), and their indices."""
    touchable = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    lists = [np.flatnonzero(touchable & (model.geom_bodyid == body)) for body in bodies]
    first = np.concatenate([[0], np.cumsum([len(geoms) for geoms in lists])]).astype(np.int64)
    return first, np.concatenate([np.zeros(0, dtype=np.int64), *lists])


def _standing_boxes(model: mujoco.MjModel, data: mujoco.MjData, geoms: Array) -> Array:
    """Boxes (n, 6) m, lower and upper corner, around geoms that do not move, `MARGIN_M` wider."""
    R_map_geom = data.geom_xmat[geoms].reshape(-1, 3, 3)
    centre, half = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
    centre = data.geom_xpos[geoms] + np.einsum("nij,nj->ni", R_map_geom, centre)
    half = np.einsum("nij,nj->ni", np.abs(R_map_geom), half) + MARGIN_M
    return np.hstack([centre - half, centre + half])
