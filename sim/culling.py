"""Takes bodies that cannot touch anything soon out of the search for contacts.

MuJoCo asks every body for contacts in every step, though loops lie in their feeder and vines stand ten metres away.
Every other beat this lists which bodies are near each other, generously, and hides the rest of their contact bits.
Hidden pairs are too far apart to meet before the next look, so the contacts found are the same, number for number.
"""

from __future__ import annotations

import mujoco
import numpy as np

from grape.messages import Array

LOOK_STEPS = 10  # between two looks: 20 ms
MARGIN_M = 0.055  # around either body of a pair: nothing meets unseen that is slower than 5 m/s
_CELL_M = 0.5
_GROUND_TYPE, _GROUND_AFFINITY = 1 << 29, 1 << 30


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
        self._ground = int(ground[0]) if len(ground) == 1 and fixed[ground[0]] else -1
        self._moving = np.flatnonzero(touchable & ~fixed)
        partners = _partners(model, self._contype, self._conaffinity)
        self._boxes = np.tile([-1e30] * 3 + [1e30] * 3, (model.nbody, 1))
        standing = np.setdiff1d(np.flatnonzero(touchable & fixed), np.union1d(unbounded, ground))
        self._bound(standing, data, 0.0)
        self._first, self._geoms = _geoms_of(model, self._moving)
        self._bits = np.zeros((model.nbody, 2), dtype=np.int32)
        self._near = np.zeros((2, model.nbody), dtype=np.int32)
        if self._ground >= 0:
            self._set_ground_apart(data)
            partners[self._ground, :] = partners[:, self._ground] = False
        self._first_partner, self._partners = _partner_lists(partners, self._moving)

    def look(self, data: mujoco.MjData) -> None:
        """Find who is near whom, and let only them meet until the next look."""
        if not self._moving.size:
            return
        from grape.sim._culling_kernels import bound_bodies, mark_neighbours, mark_on_ground

        model, boxes = self._model, self._boxes
        bound_bodies(self._first, self._geoms, self._moving, data.geom_xpos, model.geom_rbound, MARGIN_M, boxes)
        near = self._near
        near[:] = 0
        mark_neighbours(
            boxes, self._moving, self._first_partner, self._partners, self._contype, self._conaffinity, near
        )
        if self._ground >= 0:
            mark_on_ground(boxes, self._moving, self._highest, self._origin, _CELL_M, self._bits, self._ground, near)
        model.body_contype[:], model.body_conaffinity[:] = near

    def show_all(self) -> None:
        """Let everything meet everything until the next look: after bodies have been put elsewhere."""
        self._model.body_contype[:], self._model.body_conaffinity[:] = self._contype, self._conaffinity

    def _bound(self, bodies: Array, data: mujoco.MjData, margin: float) -> None:
        from grape.sim._culling_kernels import bound_bodies

        first, geoms = _geoms_of(self._model, bodies)
        bound_bodies(first, geoms, bodies, data.geom_xpos, self._model.geom_rbound, margin, self._boxes)

    def _set_ground_apart(self, data: mujoco.MjData) -> None:
        """The ground's box holds half of the world: ask for heights instead, and give it contact bits of its own."""
        model, ground = self._model, self._ground
        geom = int(model.body_geomadr[ground])
        field = int(model.geom_dataid[geom])
        rows, columns, start = model.hfield_nrow[field], model.hfield_ncol[field], model.hfield_adr[field]
        half_x, half_y, span, _ = model.hfield_size[field]
        heights = model.hfield_data[start : start + rows * columns].reshape(rows, columns) * span
        self._origin = data.geom_xpos[geom] - [half_x, half_y, 0.0]
        self._highest = _block_maxima(
            heights + self._origin[2], np.linspace(0, 2 * half_x, columns), np.linspace(0, 2 * half_y, rows)
        )
        reach = (self._contype & self._conaffinity[ground]) != 0
        touched = (self._conaffinity & self._contype[ground]) != 0
        self._bits[reach, 0] = _GROUND_TYPE
        self._bits[touched, 1] = _GROUND_AFFINITY


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


def _block_maxima(heights: Array, xs: Array, ys: Array) -> Array:
    """The highest of `heights` (ys, xs) in each square of `_CELL_M`, its border included."""
    nx, ny = int(xs[-1] / _CELL_M) + 1, int(ys[-1] / _CELL_M) + 1
    maxima = np.empty((ny, nx))
    for iy in range(ny):
        low = max(np.searchsorted(ys, iy * _CELL_M) - 1, 0)
        band = heights[low : np.searchsorted(ys, (iy + 1) * _CELL_M) + 1].max(axis=0)
        for ix in range(nx):
            left = max(np.searchsorted(xs, ix * _CELL_M) - 1, 0)
            maxima[iy, ix] = band[left : np.searchsorted(xs, (ix + 1) * _CELL_M) + 1].max()
    return maxima
