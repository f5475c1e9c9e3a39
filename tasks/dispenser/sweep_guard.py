"""How high the hand must go in a sweep to pass wood that reaches out of the row, by what was seen ahead of it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from grape.geometry import transform
from grape.messages import Array
from grape.perception.cloud import crop_mask, voxel_grid
from grape.planning import SphereModel
from grape.tasks.dispenser.own_hand import OWN_HAND, OWN_LOOP

CELL_M, LEAST_POINTS = 0.01, 4  # of the cloud; a cell with fewer points is noise
OWN_M = 0.025  # what is nearer to the hand's shape is the hand
TIGHT_M, ROOM_M = 0.015, 0.03  # nearer is too near; it goes as high as leaves so much
STEP_M, MOST_M = 0.02, 0.08  # of the way up; higher, abreast of its base, the arm comes near a singularity


class SweepGuard:
    """Remembers what was seen, and holds the hand's shape against it.

    Args:
        body: of the arm, with what the hand holds; what the last joint carries is the hand.
        holding: whether that is a dispenser, which dangles.

    Attributes:
        seen: (n, 3) m in base_link, what was seen, thinned.
    """

    def __init__(self, body: SphereModel, holding: bool = False) -> None:
        self._holding = holding
        self._spheres = body.spheres[body.spheres[:, 0] == body.joint_count][:, 1:]
        self.seen = np.empty((0, 3))
        self._tree: cKDTree | None = None

    def add(self, in_hand: Array, T_base_hand: Array) -> None:
        """What one look shows: points (n, 3) m in the hand's frame, of which some may be the hand, and its pose."""
        solid = voxel_grid(transform(T_base_hand, in_hand[~self._own(in_hand)]), CELL_M, LEAST_POINTS)
        if len(solid):
            self.seen = voxel_grid(np.vstack([self.seen, solid]), CELL_M)
            self._tree = cKDTree(self.seen)

    def _own(self, in_hand: Array) -> Array:
        """(n,) bool: points on or beside the hand's shape, or where a held dispenser dangles."""
        near, own = crop_mask(in_hand, *OWN_HAND), np.zeros(len(in_hand), bool)
        gaps = np.linalg.norm(in_hand[near, None] - self._spheres[:, :3], axis=2) - self._spheres[:, 3]
        own[near] = (gaps < OWN_M).any(axis=1)
        return own | crop_mask(in_hand, *OWN_LOOP) if self._holding else own

    def clearance(self, poses: Array, lift_m: float = 0.0) -> float:
        """Metres between the hand at the nearest of its poses (n, 4, 4) in base_link, lifted, and what was seen."""
        if self._tree is None:
            return float("inf")
        centers = np.array([transform(T, self._spheres[:, :3]) for T in poses])
        centers[..., 2] += lift_m
        return float((self._tree.query(centers)[0] - self._spheres[:, 3]).min())

    def lift(self, poses: Array, above_m: float) -> float | None:
        """The least lift (m) above `above_m` at which the hand has room at all poses (n, 4, 4).

        None when there is none, or when something is in the way up at the first pose.
        """
        for lift in np.arange(above_m + STEP_M, MOST_M + 1e-9, STEP_M):
            if self.clearance(poses[:1], float(lift)) <= 0.0:
                return None
            if self.clearance(poses, float(lift)) >= ROOM_M:
                return float(lift)
        return None
