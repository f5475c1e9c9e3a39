"""Where a scan was taken, given points that are already in the map: correlative search, then point-to-line fit.

Source: Olson, Real-time correlative scan matching, ICRA 2009; Censi, An ICP variant using a point-to-line metric,
ICRA 2008.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from grape.geometry import wrap_angle
from grape.mapping.planar import transform_points
from grape.messages import Array
from grape.navigation.grid import GridSpec

BLOCK = 8  # cells a side that share a bound in wide searches
NEIGHBOURS = 6  # points that give the direction of a wall


@dataclass(frozen=True, kw_only=True)
class MatchOptions:
    """How a scan is matched; lengths in m, angles in rad.

    `noise` is the standard deviation of a point. `correlated` says how many points err together, so that the
    information is not overrated. Points farther than `wall` from each other give no direction of a wall: a row of
    trunks is none.
    """

    resolution: float = 0.1
    sigma: float = 0.1
    turn_step: float = 0.0125
    iterations: int = 12
    reach: float = 0.4  # correspondences of the fit are nearer than this, at first
    last_reach: float = 0.15
    noise: float = 0.03
    correlated: float = 10.0
    wall: float = np.inf


@dataclass(frozen=True, kw_only=True)
class Match:
    """A scan's pose in the reference's frame.

    Args:
        pose: (3,) x y yaw.
        response: 0..1, mean of the field at the scan's points after the search.
        inliers: share of points that lie near the reference after the fit.
        information: (3, 3) of x y yaw in the robot's own axes, the inverse of a covariance.
    """

    pose: Array
    response: float
    inliers: float
    information: Array


class Reference:
    """Points (n, 2) m in the map, prepared for matching scans against them."""

    def __init__(self, points: Array, options: MatchOptions | None = None, margin: float = 1.0) -> None:
        self.points = np.ascontiguousarray(points, float)
        self.options = options or MatchOptions()
        self.spec = GridSpec.around(self.points, margin, self.options.resolution)

    @cached_property
    def field(self) -> Array:
        """(rows, columns) float32 of responses 0..1."""
        from grape.mapping.match_kernels import stamp_points

        field = np.zeros((self.spec.rows, self.spec.columns), np.float32)
        stamp_points(field, self.spec.origin, self.spec.resolution, self.points, self.options.sigma)
        return field

    @cached_property
    def bound(self) -> Array:
        """The field's maxima over the BLOCK x BLOCK cells that begin at each cell."""
        from scipy.ndimage import maximum_filter1d

        once = maximum_filter1d(self.field, BLOCK, axis=0, origin=-(BLOCK // 2), mode="constant")
        return maximum_filter1d(once, BLOCK, axis=1, origin=-(BLOCK // 2), mode="constant")

    @cached_property
    def tree(self) -> Any:
        """For the nearest of the points."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points)

    @cached_property
    def shape(self) -> tuple[Array, Array]:
        """Normals (n, 2) of the walls that points lie on, and weights (n,) 0..1 along the wall: 0 on straight ones."""
        count = min(NEIGHBOURS, len(self.points))
        distance, index = self.tree.query(self.points, k=count)
        distance, near = distance.reshape(-1, count), self.points[index.reshape(-1, count)]
        if np.isfinite(self.options.wall):  # a neighbour that is too far says as little as the point itself
            near = np.where(distance[..., None] <= self.options.wall, near, self.points[:, None])
        near = near - near.mean(axis=1, keepdims=True)
        values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near) / count)
        along = np.clip(values[:, 0] / np.maximum(values[:, 1], 1e-12), 0.0, 1.0)
        return vectors[:, :, 0], np.where(values[:, 1] < 1e-12, 1.0, along)

    def search(self, points: Array, guess: Array, reach: float, turn: float, pull: Array) -> tuple[Array, float]:
        """Best pose (3,) within `reach` m and `turn` rad of a guess, and its response; `pull` as in the kernel."""
        from grape.mapping.match_kernels import search

        options, cells = self.options, max(round(reach / self.options.resolution), 1)
        steps = max(round(turn / options.turn_step), 1)
        turns = options.turn_step * np.arange(-steps, steps + 1)
        wide = cells > 2 * BLOCK
        bound, block = (self.bound, BLOCK) if wide else (self.field, 1)
        found = search(
            self.field, bound, block, self.spec.origin, self.spec.resolution,
            np.ascontiguousarray(points, float), np.asarray(guess, float), cells, turns, np.asarray(pull, float),
        )  # fmt: skip
        return found[:3], float(found[3])

    def fit(self, points: Array, start: Array, prior: tuple[Array, Array] | None = None) -> tuple[Array, float, Array]:
        """Pose (3,), share of inliers and information (3, 3) in the map's axes of the point-to-line fit.

        Args:
            prior: pose (3,) and information (3, 3) in the map's axes that pull on the fit.
        """
        options, pose = self.options, np.array(start, float)
        scale = 1.0 / (options.noise**2 * options.correlated)
        normals, along = self.shape
        reaches = np.geomspace(options.reach, options.last_reach, options.iterations)
        for reach in reaches:
            moved = transform_points(pose, points)
            distance, index = self.tree.query(moved, distance_upper_bound=reach)
            near = np.isfinite(distance)
            if near.sum() < 5:
                return pose, 0.0, np.zeros((3, 3))
            k = index[near]
            off, arm = moved[near] - self.points[k], moved[near] - pose[:2]
            weight = scale / (1.0 + (distance[near] / (3.0 * options.noise)) ** 2)  # Cauchy
            H, g = _normal_equations(off, arm, normals[k], along[k], weight)
            information = H.copy()
            if prior is not None:
                information += prior[1]
                shift = pose - prior[0]
                shift[2] = wrap_angle(shift[2])
                g = g + prior[1] @ shift
            step = -np.linalg.solve(information + 1e-6 * np.eye(3), g)
            pose = pose + np.clip(step, -0.3, 0.3)
            if np.abs(step).max() < 1e-4 and reach <= 1.5 * options.last_reach:
                break
        pose[2] = wrap_angle(pose[2])
        return pose, float((distance < options.last_reach).mean()), information


def _normal_equations(off: Array, arm: Array, normal: Array, along: Array, weight: Array) -> tuple[Array, Array]:
    """H (3, 3) and g (3,) of point-to-line errors, with a share `along` of the point-to-point ones."""
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    turned = np.column_stack([-arm[:, 1], arm[:, 0]])
    H, g = np.zeros((3, 3)), np.zeros(3)
    for axis, share in ((normal, weight), (tangent, weight * along)):
        J = np.column_stack([axis, (axis * turned).sum(axis=1)])
        H += (J * share[:, None]).T @ J
        g += J.T @ (share * (axis * off).sum(axis=1))
    return H, g


def turned_information(information: Array, yaw: float) -> Array:
    """Information (3, 3) of x y yaw in axes that are turned by `yaw` against those it is given in."""
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return R.T @ information @ R


def match(
    reference: Reference, points: Array, guess: Array, reach: float, turn: float, prior: Array | None = None
) -> Match:
    """Match a scan's points (n, 2) m around a guess (3,).

    Args:
        reach, turn: how far from the guess to search, m and rad.
        prior: (3, 3) information of the guess in the robot's own axes, where it is to count.
    """
    pull = np.zeros(2)
    known = None
    if prior is not None:
        known = (np.asarray(guess, float), turned_information(prior, -guess[2]))
        per_point = 0.5 * reference.options.correlated / max(len(points), 1)
        pull = np.minimum(per_point * np.array([min(prior[0, 0], prior[1, 1]), prior[2, 2]]) * 0.1, [2.0, 4.0])
    start, response = reference.search(points, guess, reach, turn, pull)
    pose, inliers, information = reference.fit(points, start, known)
    return Match(pose=pose, response=response, inliers=inliers, information=turned_information(information, pose[2]))
