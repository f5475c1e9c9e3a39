"""Image points of markers: projection, depth, interaction matrix and gain.

Source: Chaumette and Hutchinson, Visual servo control, part I, 2006.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp

import numpy as np

from grape.control.compiled import kernels
from grape.geometry import inverse, rotation_log
from grape.messages import Array


def marker_corners(side: float) -> Array:
    """Corners (4, 3) m of a marker in its frame (x right, y up, z out of its face), in the order of OpenCV."""
    h = 0.5 * side
    return np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])


def project(points_camera: Array) -> Array:
    """Normalised image coordinates (n, 2) of points (n, 3) m in the optical frame."""
    return points_camera[:, :2] / points_camera[:, 2:]


def normalise(pixels: Array, K: Array) -> Array:
    """Normalised image coordinates (n, 2) of pixels (n, 2)."""
    return (pixels - K[:2, 2]) / np.array([K[0, 0], K[1, 1]])


def square_depths(xy: Array, side: float) -> Array:
    """Depths (4,) m of the corners of a square seen at normalised coordinates (4, 2), in order around it.

    The diagonals of a square bisect each other, so z0 m0 - z1 m1 + z2 m2 - z3 m3 = 0; its side gives the scale.
    """
    m = np.column_stack([xy, np.ones(4)])
    ratios = np.r_[1.0, np.linalg.solve(np.column_stack([m[1], -m[2], m[3]]), m[0])]
    ratios = np.clip(ratios / ratios.mean(), 0.5, 1.5)
    corners = ratios[:, None] * m
    return ratios * side / float(np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).mean())


def interaction_matrix(xy: Array, depth: Array) -> Array:
    """(2 n, 6): how normalised points (n, 2) at depths (n,) m move with the camera's twist (optical frame)."""
    return kernels().interaction_matrix(xy, depth)


def adaptive_gain(error: float, at_zero: float, at_infinity: float, slope: float) -> float:
    """1/s: high for small errors and low for large ones; `slope` is that at zero error."""
    span = at_zero - at_infinity
    return span * exp(-slope / max(span, 1e-9) * error) + at_infinity


def view_velocity(T_camera_marker: Callable[[float], Array], standoff: float, speed: float) -> Array:
    """Twist (6,) of the camera, optical frame, that follows the desired view while the stand-off shrinks at `speed`."""
    du = 1e-3
    T_now_next = T_camera_marker(standoff) @ inverse(T_camera_marker(max(standoff - du, 0.0)))
    span = min(du, standoff)
    if span <= 0.0:
        return np.zeros(6)
    return np.r_[T_now_next[:3, 3], rotation_log(T_now_next[:3, :3])] * speed / span
