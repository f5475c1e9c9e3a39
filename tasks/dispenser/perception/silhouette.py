"""Spur candidates from the silhouette: the cloud drawn as seen from the robot, thinned to a skeleton, its ends."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class SilhouetteOptions:
    """The drawing and its skeleton.

    Args:
        pixel_m: size of a pixel.
        close_px: holes of this size are closed.
        jump_m: the drawing is cut where something lies this far behind what is in front.
        min_pixels: smaller parts are noise.
        axis_m: length of skeleton that gives tip and direction.
        min_m: shorter ends are buds and rough outlines.
        min_rise: smallest upward part of the direction.
    """

    pixel_m: float = 0.003
    close_px: int = 5
    jump_m: float = 0.025
    min_pixels: int = 25
    axis_m: float = 0.060
    min_m: float = 0.025
    min_rise: float = 0.05

    def __post_init__(self) -> None:
        if min(self.pixel_m, self.jump_m, self.axis_m, self.min_m) <= 0 or self.close_px < 1:
            raise InvalidInput(f"silhouette sizes must be positive, got {self}")


@dataclass(frozen=True)
class _Drawing:
    """depth (h, w) m along the view, 9 where empty; occupied (h, w) uint8; origin (u, v) m of pixel (0, 0)."""

    depth: Array
    occupied: Array
    origin: Array


def silhouette_candidates(
    points: Array, up: Array, toward_robot: Array, options: SilhouetteOptions | None = None
) -> Array:
    """(k, 6): tip (m) and unit direction of every skeleton end that points upwards.

    Args:
        points: (n, 3) m.
        up: (3,) unit vector against gravity.
        toward_robot: (3,) horizontal unit vector from the vine to the robot.
        options: see `SilhouetteOptions`.
    """
    options = options or SilhouetteOptions()
    if len(points) < options.min_pixels:
        return np.empty((0, 6))
    axes = np.stack([np.cross(up, toward_robot), -up, -toward_robot])  # right, down, away: rows
    local = points @ axes.T
    drawing = _draw(local, options)
    found = []
    for path in skeleton_ends(drawing.occupied, round(options.axis_m / options.pixel_m)):
        candidate = _axis_of(path, drawing, options)
        if candidate is not None:
            tip, direction = axes.T @ candidate[0], axes.T @ candidate[1]
            if direction @ up >= options.min_rise:
                found.append(np.r_[tip, direction])
    return np.array(found).reshape(-1, 6)


def _draw(local: Array, options: SilhouetteOptions) -> _Drawing:
    """Nearest point wins in each pixel; small holes closed; parts behind a depth edge cut off."""
    from grape.tasks.dispenser.perception.silhouette_kernels import nearest_depth

    margin = 6
    origin = local[:, :2].min(axis=0) - margin * options.pixel_m
    w, h = np.floor((local[:, :2].max(axis=0) - origin) / options.pixel_m).astype(int) + margin
    depth = nearest_depth(np.ascontiguousarray(local), origin, options.pixel_m, h, w)
    seen = np.isfinite(depth)
    far = float(local[:, 2].max()) + 1.0
    depth = np.where(seen, depth, far).astype(np.float32)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (options.close_px, options.close_px))
    occupied = cv2.morphologyEx(seen.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    front = cv2.erode(depth, np.ones((3, 3), np.uint8))
    depth = cv2.medianBlur(np.where(occupied > 0, np.where(seen, depth, front), far).astype(np.float32), 3)
    occupied[depth - cv2.erode(depth, np.ones((3, 3), np.uint8)) > options.jump_m] = 0
    _, labels, stats, _ = cv2.connectedComponentsWithStats(occupied, connectivity=8)
    keep = stats[:, cv2.CC_STAT_AREA] >= options.min_pixels
    keep[0] = False
    return _Drawing(
        depth=np.where(depth < far - 0.5, depth, np.nan), occupied=keep[labels].astype(np.uint8), origin=origin
    )


def skeleton_ends(occupied: Array, longest_px: int) -> list[Array]:
    """Paths (k, 2) of (row, column) from each end of the skeleton inwards, to a junction or where the part widens."""
    from grape.tasks.dispenser.perception.silhouette_kernels import thin, walk

    width = cv2.distanceTransform(occupied, cv2.DIST_L2, 3)
    skeleton = thin(occupied.copy())
    ring = np.ones((3, 3), np.uint8)
    ring[1, 1] = 0
    degree = cv2.filter2D(skeleton, -1, ring, borderType=cv2.BORDER_CONSTANT) * skeleton
    ends = np.argwhere(degree == 1)
    return [walk(skeleton, degree, width, int(r), int(c), max(longest_px, 3)) for r, c in ends]


def _axis_of(path: Array, drawing: _Drawing, options: SilhouetteOptions) -> tuple[Array, Array] | None:
    """Tip and direction (right, down, away) of a skeleton path; the depth along it is a fitted line."""
    if len(path) * options.pixel_m < options.min_m:
        return None
    depth = drawing.depth[path[:, 0], path[:, 1]]
    measured = np.isfinite(depth)
    if measured.sum() < 5:
        return None
    t = np.linspace(0.0, 1.0, len(path))
    slope, start = np.polyfit(t[measured], depth[measured], 1)
    ends = (path[[0, -1]][:, ::-1] + 0.5) * options.pixel_m + drawing.origin
    tip, base = np.r_[ends[0], start], np.r_[ends[1], start + slope]
    length = float(np.linalg.norm(tip - base))
    return (tip, (tip - base) / length) if length > 0.015 else None
