"""Input checks that the perception functions share: each returns the value in the type it computes with, or raises."""

from __future__ import annotations

from typing import Any

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array


def as_points(points: Any, name: str = "points") -> Array:
    """`points` as float64 (n, 3), finite.

    Raises:
        InvalidInput: another shape, or a value that is not finite.
    """
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidInput(f"{name} must have shape (n, 3), got {array.shape}")
    if not np.isfinite(array).all():
        raise InvalidInput(f"{name} must be finite, got {int((~np.isfinite(array)).any(axis=1).sum())} bad rows")
    return array


def as_vector(vector: Any, size: int, name: str) -> Array:
    """`vector` as float64 (size,), finite.

    Raises:
        InvalidInput: another shape, or a value that is not finite.
    """
    array = np.asarray(vector, dtype=np.float64)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InvalidInput(f"{name} must be {size} finite numbers, got {vector}")
    return array


def as_unit(vector: Any, name: str) -> Array:
    """`vector` (3,) scaled to length 1.

    Raises:
        InvalidInput: another shape, not finite, or zero.
    """
    array = as_vector(vector, 3, name)
    norm = float(np.linalg.norm(array))
    if norm < 1e-9:
        raise InvalidInput(f"{name} must not be zero, got {vector}")
    return array / norm


def as_intrinsics(K: Any) -> Array:
    """A camera matrix as float64 (3, 3) with positive focal lengths.

    Raises:
        InvalidInput: another shape, not finite, or a focal length that is not positive.
    """
    array = np.asarray(K, dtype=np.float64)
    if array.shape != (3, 3) or not np.isfinite(array).all() or array[0, 0] <= 0 or array[1, 1] <= 0:
        raise InvalidInput(f"K must be a finite 3 x 3 camera matrix with positive focal lengths, got {K}")
    return array


def as_bgr(image: Any) -> Array:
    """A colour image (h, w, 3) uint8.

    Raises:
        InvalidInput: another shape or type, or no pixels.
    """
    array = np.asarray(image)
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype != np.uint8 or array.size == 0:
        raise InvalidInput(f"a colour image must be (h, w, 3) uint8 and not empty, got {array.shape} {array.dtype}")
    return array


def as_depth(depth: Any, shape: tuple[int, ...] | None = None) -> Array:
    """A depth image (h, w) as float32 m, with 0 wherever the measurement is missing (NaN, infinite, negative).

    Args:
        depth: (h, w) m.
        shape: the (h, w) that it has to have, when given.

    Raises:
        InvalidInput: another shape, or no pixels.
    """
    array = np.asarray(depth, dtype=np.float32)
    if array.ndim != 2 or array.size == 0:
        raise InvalidInput(f"a depth image must be (h, w) and not empty, got {array.shape}")
    if shape is not None and array.shape != tuple(shape):
        raise InvalidInput(f"the depth image must be registered to the colour image {tuple(shape)}, got {array.shape}")
    return np.where(np.isfinite(array) & (array > 0), array, np.float32(0))


def as_region(roi: Any, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """A region (u0, v0, u1, v1) in px, cut to an image of `shape` (h, w); the end is exclusive.

    Raises:
        InvalidInput: not four numbers, or nothing of it is inside the image.
    """
    values = as_vector(roi, 4, "roi")
    u0, v0 = int(max(values[0], 0)), int(max(values[1], 0))
    u1, v1 = int(min(values[2], shape[1])), int(min(values[3], shape[0]))
    if u1 <= u0 or v1 <= v0:
        raise InvalidInput(f"roi (u0, v0, u1, v1) must overlap the image of {shape[1]} x {shape[0]} px, got {roi}")
    return u0, v0, u1, v1
