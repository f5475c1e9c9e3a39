"""A picture of a map with the ways driven on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grape.mapping.occupancy import OccupancyGrid
from grape.messages import Array

ESTIMATE, REFERENCE = (200, 80, 0), (60, 160, 60)  # BGR
LARGEST = 3000  # pixels a side


def write_picture(grid: OccupancyGrid, path: Array, file: Path, reference: Array | None = None) -> None:
    """Write a PNG: the map in grey, the path (n, 3) in blue, the reference (n, 3) in green."""
    import cv2

    cv2.imwrite(str(file), draw(grid, path, reference))


def draw(grid: OccupancyGrid, path: Array, reference: Array | None = None) -> Array:
    """The picture (rows, columns, 3) BGR that `write_picture` writes."""
    import cv2

    known = grid.known()
    grey = np.where(known, 255 - 2.55 * np.maximum(grid.occupancy, 0).astype(float), 190).astype(np.uint8)
    picture = np.ascontiguousarray(np.dstack([grey] * 3))
    for poses, colour in ((reference, REFERENCE), (path, ESTIMATE)):
        if poses is not None:
            places = (poses[:, :2] - grid.spec.origin) / grid.spec.resolution
            line = np.rint(places).astype(np.int32).reshape(-1, 1, 2)
            cv2.polylines(picture, [line], False, colour, 1, cv2.LINE_AA)
    upright: Array = np.ascontiguousarray(np.flipud(picture))
    scale = LARGEST / max(upright.shape[:2])
    return upright if scale >= 1.0 else cv2.resize(upright, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
