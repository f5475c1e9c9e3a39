"""Pictures for the renderer: the ground with grassy aisles, and markers with whole texels per cell."""

from __future__ import annotations

import numpy as np

from grape.messages import Array
from grape.sim.worlds.model import Terrain
from grape.site import Site

CELL_PX = 32  # a marker has 6 cells; the margin is 1.5 cells, so both are whole texels
GROUND_PX = 768
SOIL = np.array([0.47, 0.37, 0.26])
GRASS = np.array([0.34, 0.41, 0.19])
MUD = np.array([0.23, 0.17, 0.12])


def marker_picture(id: int) -> Array:
    """(n, n, 3) uint8 of a DICT_4X4_50 marker with its white margin, first row at the top."""
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    cells = dictionary.markerSize + 2
    margin = CELL_PX * 3 // 2
    picture = cv2.aruco.generateImageMarker(dictionary, id, cells * CELL_PX)
    framed = cv2.copyMakeBorder(picture, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=255)
    return np.repeat(framed[:, :, None], 3, axis=2)


def ground_picture(site: Site, terrain: Terrain, rng: np.random.Generator) -> Array:
    """(n, n, 3) uint8 seen from above, x right and y down: bare soil under the rows, grass in the aisles, dark mud."""
    from scipy.ndimage import gaussian_filter

    x = np.linspace(terrain.x_range[0], terrain.x_range[1], GROUND_PX)
    y = np.linspace(terrain.y_range[0], terrain.y_range[1], GROUND_PX)
    X, Y = np.meshgrid(x, y)
    distance = np.full(X.shape, np.inf)
    for row in site.rows:
        for a, b in zip(row.line[:-1], row.line[1:], strict=True):
            distance = np.minimum(distance, _distance_to_segment(X, Y, a, b))
    coarse = gaussian_filter(rng.standard_normal(X.shape, np.float32), 9.0)
    coarse /= coarse.std()
    fine = gaussian_filter(rng.standard_normal(X.shape, np.float32), 0.8)
    fine /= fine.std()
    green = np.clip((distance - 0.45) / 0.35 + 0.5 * coarse, 0.0, 0.9)[..., None]
    color = (1.0 - green) * SOIL + green * GRASS
    for x0, y0, radius in terrain.mud:
        color[np.hypot(X - x0, Y - y0) < radius] = MUD
    color = color * (1.0 + 0.05 * coarse + 0.09 * fine)[..., None]
    return (np.clip(color, 0.0, 1.0) * 255.0).astype(np.uint8)


def _distance_to_segment(X: Array, Y: Array, a: Array, b: Array) -> Array:
    d = b - a
    s = np.clip(((X - a[0]) * d[0] + (Y - a[1]) * d[1]) / (d @ d), 0.0, 1.0)
    return np.hypot(X - a[0] - s * d[0], Y - a[1] - s * d[1])
