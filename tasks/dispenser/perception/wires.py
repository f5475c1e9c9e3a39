"""Wires of a trellis in a scan: they go on where the sensor has not looked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array
from grape.perception.cloud import voxel_grid


@dataclass(frozen=True, kw_only=True)
class WireOptions:
    """What counts as a wire. Lengths in m, angles in rad.

    Args:
        yaw, pitch, step: how far its direction may be off the scan's to a side and upwards (it keeps to its posts, the
            robot to the bumps under its wheels), and in which steps that is tried.
        cell: width of the cells across it in which its points are gathered.
        bin: length of the pieces along it, of which `covered` (share) must have a point.
        shortest: length of the scan along the row, below which nothing is told.
        thick: half of its width, by how much its points scatter.
        alone: share of what is within `around` of its points that is along it, within `thick`; less is wood.
        most: wires that are looked for.
    """

    yaw: float = float(np.radians(3.0))
    pitch: float = float(np.radians(12.0))
    step: float = float(np.radians(1.0))
    cell: float = 0.025
    bin: float = 0.05
    covered: float = 0.85
    shortest: float = 0.4
    thick: float = 0.02
    around: float = 0.05
    alone: float = 0.8
    most: int = 6


def find_wires(points: Array, options: WireOptions | None = None) -> tuple[tuple[Array, Array], ...]:
    """Straight thin things from one end of a scan to the other.

    Args:
        points: (n, 3) m of a scan along x, which is the row's direction; such as `Sweep.points` in base_link.

    Returns:
        Both ends (3,) of each, the one at lower x first.

    Raises:
        InvalidInput: another shape.
    """
    options, points = options or WireOptions(), np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidInput(f"points (n, 3) needed, got {points.shape}")
    if not len(points):
        return ()
    low, high = np.quantile(points[:, 0], [0.005, 0.995])
    if high - low < options.shortest:
        return ()
    left = _alone(voxel_grid(points, 0.5 * options.thick), options)
    found: list[tuple[Array, Array]] = []
    for _ in range(options.most):
        line = _best(left, low, high, options)
        if line is None:
            break
        found.append((_at(line, low), _at(line, high)))
        left = left[_across(left, *line) > options.around]
    return tuple(found)


def going_on(wires: tuple[tuple[Array, Array], ...], reach: float = 0.8, spacing: float = 0.01) -> Array:
    """(n, 3) m, points of wires for `reach` m beyond both of their ends."""
    steps = np.arange(spacing, reach, spacing)[:, None]
    parts = [np.zeros((0, 3))]
    for a, b in wires:
        along = (b - a) / np.linalg.norm(b - a)
        parts += [a - steps * along, b + steps * along]
    return np.vstack(parts)


def _alone(points: Array, options: WireOptions) -> Array:
    """Those of the points (n, 3) around which, but along x, there is next to nothing else."""
    from scipy.spatial import cKDTree

    i, j = cKDTree(points).query_pairs(options.around, output_type="ndarray").T
    beside = np.hypot(*(points[i, 1:] - points[j, 1:]).T) > options.thick
    ends = np.concatenate([i, j])
    others = np.bincount(ends, minlength=len(points))
    aside = np.bincount(ends, np.concatenate([beside, beside]), minlength=len(points))
    return points[(others > 0) & (aside <= (1.0 - options.alone) * others)]


def _best(points: Array, low: float, high: float, options: WireOptions) -> tuple[Array, Array] | None:
    """Point and direction of the line that most pieces of the scan have points on; None where none is covered."""
    bins = max(1, int((high - low) / options.bin))
    inside = points[(points[:, 0] >= low) & (points[:, 0] <= high)]
    if not len(inside):
        return None
    middle = np.array([0.5 * (low + high), 0.0, 0.0])
    piece = np.minimum(((inside[:, 0] - low) / (high - low) * bins).astype(int), bins - 1)
    yaws, pitches = (np.arange(-most, most + 1e-9, options.step) for most in (options.yaw, options.pitch))
    best, covered = None, options.covered * bins - 1e-9
    for yaw in np.tan(yaws):
        for pitch in np.tan(pitches):
            across = inside[:, 1:] - (inside[:, :1] - middle[0]) * [yaw, pitch]
            cells = np.floor(across / options.cell).astype(int)
            names, which = np.unique(cells @ [1 << 20, 1], return_inverse=True)
            pieces = np.bincount(np.unique(which * bins + piece) // bins, minlength=len(names))
            if pieces.max() > covered:
                covered, k = pieces.max(), int(pieces.argmax())
                best = inside[which == k]
    if best is None:
        return None
    line = _fit(best)
    near = points[_across(points, *line) < options.thick]
    return _fit(near) if len(near) > 2 else line


def _fit(points: Array) -> tuple[Array, Array]:
    """Centre (3,) and unit direction (3,), x > 0, of the line through points."""
    centre = points.mean(axis=0)
    _, _, rows = np.linalg.svd(points - centre, full_matrices=False)
    return centre, rows[0] * (1.0 if rows[0, 0] > 0 else -1.0)


def _across(points: Array, centre: Array, direction: Array) -> Array:
    """(n,) m, distances from a line."""
    return np.linalg.norm(np.cross(points - centre, direction), axis=1)


def _at(line: tuple[Array, Array], x: float) -> Array:
    centre, direction = line
    return centre + (x - centre[0]) / direction[0] * direction
