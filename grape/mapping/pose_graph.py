"""Least squares over a graph of planar poses, with edges that may be wrong.

Source: Grisetti et al., A tutorial on graph-based SLAM, IEEE ITS Magazine 2010; Yang et al., Graduated
non-convexity for robust spatial perception, RA-L 2020 (doubtful edges, Geman-McClure).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import wrap_angle
from grape.mapping.planar import between
from grape.messages import Array, frozen_array


@dataclass(frozen=True, kw_only=True)
class Edge:
    """Pose `relative` (3,) of node `second` in node `first`, its information (3, 3) in the axes of `second`.

    A `doubtful` edge (a loop closure) counts less the worse it fits.
    """

    first: int
    second: int
    relative: Array
    information: Array
    doubtful: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "relative", frozen_array(self.relative, float))
        object.__setattr__(self, "information", frozen_array(self.information, float))
        if self.relative.shape != (3,) or self.information.shape != (3, 3) or self.first == self.second:
            raise InvalidInput(f"an edge joins two nodes by (3,) and (3, 3), got {self.first} and {self.second}")


@dataclass(frozen=True, kw_only=True)
class GraphOptions:
    """`doubt`: chi-square at which a doubtful edge counts a quarter; steps below `enough` (m, rad) end it.

    At first doubt is so large that every edge counts; it is halved with each step down to `doubt`, since before a loop
    is closed right closures fit as badly as wrong ones.
    """

    iterations: int = 40
    doubt: float = 30.0
    enough: float = 1e-4


@dataclass(frozen=True, kw_only=True)
class Solution:
    """Poses (n, 3) and the chi-square (m,) and weight (m,) of each edge there."""

    poses: Array
    chi_square: Array
    weight: Array


def optimise(poses: Array, edges: Sequence[Edge], options: GraphOptions | None = None) -> Solution:
    """Poses (n, 3) that fit the edges best; the first pose stays.

    Raises:
        InvalidInput: an edge names a node that is not there.
    """
    options = options or GraphOptions()
    x = np.array(poses, float)
    first, second = np.array([e.first for e in edges], int), np.array([e.second for e in edges], int)
    if len(edges) and not (min(first.min(), second.min()) >= 0 and max(first.max(), second.max()) < len(x)):
        raise InvalidInput(f"edges name nodes outside 0 to {len(x) - 1}")
    z = np.array([e.relative for e in edges]).reshape(-1, 3)
    omega = np.array([e.information for e in edges]).reshape(-1, 3, 3)
    doubtful = np.array([e.doubtful for e in edges], bool)
    doubt = 0.0
    for _ in range(options.iterations if len(edges) else 0):
        error, A, B = _linearised(x[first], x[second], z)
        chi = _chi_square(error, omega)
        doubt = max(0.5 * doubt if doubt else 2.0 * float(chi[doubtful].max(initial=0.0)), options.doubt)
        weighted = omega * _weights(chi, doubtful, doubt)[:, None, None]
        step = _step(len(x), first, second, error, A, B, weighted)
        x += step
        if doubt == options.doubt and np.abs(step).max() < options.enough:
            break
    x[:, 2] = wrap_angle(x[:, 2])
    error = between(z, between(x[first], x[second])) if len(edges) else np.zeros((0, 3))
    chi = _chi_square(error, omega)
    return Solution(poses=x, chi_square=chi, weight=_weights(chi, doubtful, options.doubt))


def _chi_square(error: Array, omega: Array) -> Array:
    return np.einsum("ni,nij,nj->n", error, omega, error)


def _weights(chi: Array, doubtful: Array, doubt: float) -> Array:
    return np.where(doubtful, (doubt / (doubt + chi)) ** 2, 1.0)


def _linearised(xi: Array, xj: Array, z: Array) -> tuple[Array, Array, Array]:
    """Errors (m, 3) and their derivatives (m, 3, 3) by both poses; equations 30 to 33 of the tutorial."""
    error = between(z, between(xi, xj))
    ci, si = np.cos(xi[:, 2]), np.sin(xi[:, 2])
    cz, sz = np.cos(z[:, 2]), np.sin(z[:, 2])
    c, s = ci * cz - si * sz, si * cz + ci * sz  # rotation of the edge's frame
    dx, dy = (xj - xi)[:, 0], (xj - xi)[:, 1]
    tx, ty = -si * dx + ci * dy, -ci * dx - si * dy  # derivative of R_i^T (t_j - t_i) by yaw_i
    A, B = np.zeros((len(z), 3, 3)), np.zeros((len(z), 3, 3))
    A[:, 0, 0], A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = -c, -s, s, -c
    A[:, 0, 2], A[:, 1, 2], A[:, 2, 2] = cz * tx + sz * ty, -sz * tx + cz * ty, -1.0
    B[:, 0, 0], B[:, 0, 1], B[:, 1, 0], B[:, 1, 1], B[:, 2, 2] = c, s, -s, c, 1.0
    return error, A, B


def _step(n: int, first: Array, second: Array, error: Array, A: Array, B: Array, omega: Array) -> Array:
    from scipy import sparse
    from scipy.sparse.linalg import splu

    g = np.zeros((n, 3))
    blocks, rows, columns = [], [], []
    for J, at in ((A, first), (B, second)):
        JO = np.einsum("mki,mkl->mil", J, omega)
        np.add.at(g, at, np.einsum("mik,mk->mi", JO, error))
        for K, other in ((A, first), (B, second)):
            blocks.append(np.einsum("mik,mkj->mij", JO, K))
            rows.append(3 * at[:, None, None] + np.arange(3)[:, None] + np.zeros((1, 3), int))
            columns.append(3 * other[:, None, None] + np.arange(3)[None, :] + np.zeros((3, 1), int))
    values, row, column = (np.concatenate(part).ravel() for part in (blocks, rows, columns))
    H = sparse.csc_matrix((values, (row, column)), shape=(3 * n, 3 * n)) + 1e-6 * sparse.identity(3 * n, format="csc")
    H = (H + sparse.csc_matrix((np.full(3, 1e9), (range(3), range(3))), shape=H.shape)).tocsc()
    step = splu(H).solve(-g.ravel()).reshape(n, 3)
    step[0] = 0.0
    return step
