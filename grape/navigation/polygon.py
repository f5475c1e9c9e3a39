"""Points and polygons in the plane."""

from __future__ import annotations

import numpy as np

from grape.messages import Array


def in_polygon(points: Array, polygon: Array, margin: float = 0.0) -> Array:
    """Which of the points (n, 2) lie in a polygon (k, 2), or no farther than `margin` from its edges; all in metres."""
    low, high = polygon.min(axis=0) - margin, polygon.max(axis=0) + margin
    inside = ((points >= low) & (points <= high)).all(axis=1)
    candidates = points[inside][:, None, :]  # (n, 1, 2)
    if not len(candidates):
        return inside
    start, end = polygon, np.roll(polygon, -1, axis=0)
    edge = end - start  # (k, 2)
    offset = candidates - start  # (n, k, 2)
    straddles = (start[:, 1] > candidates[..., 1]) != (end[:, 1] > candidates[..., 1])
    rise = np.where(edge[:, 1] == 0.0, 1.0, edge[:, 1])
    left = candidates[..., 0] < start[:, 0] + edge[:, 0] * offset[..., 1] / rise
    found = (straddles & left).sum(axis=1) % 2 == 1
    if margin > 0.0:
        along = np.clip((offset * edge).sum(axis=-1) / np.maximum((edge**2).sum(axis=-1), 1e-12), 0.0, 1.0)
        gap = offset - along[..., None] * edge
        found |= ((gap**2).sum(axis=-1) <= margin**2).any(axis=1)
    inside[inside] = found
    return inside
