"""Whether polygons on the ground touch: what the referee needs of plane geometry."""

from __future__ import annotations

import numpy as np

from grape.messages import Array


def polygons_touch(a: Array, b: Array) -> bool:
    """Whether two simple polygons (n, 2) and (m, 2) overlap or touch."""
    if (a.max(axis=0) < b.min(axis=0)).any() or (b.max(axis=0) < a.min(axis=0)).any():
        return False
    return _edges_cross(a, b) or contains(b, a[0]) or contains(a, b[0])


def contains(polygon: Array, point: Array) -> bool:
    """Whether a point (2,) lies in a simple polygon (n, 2): the crossing-number rule."""
    start, end = polygon, np.roll(polygon, -1, axis=0)
    spans = (start[:, 1] > point[1]) != (end[:, 1] > point[1])
    rise = np.where(spans, end[:, 1] - start[:, 1], 1.0)
    at = start[:, 0] + (point[1] - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
    return bool(np.count_nonzero(spans & (point[0] < at)) % 2)


def _edges_cross(a: Array, b: Array) -> bool:
    p, r = a[:, None], (np.roll(a, -1, axis=0) - a)[:, None]  # (n, 1, 2)
    q, s = b[None], (np.roll(b, -1, axis=0) - b)[None]  # (1, m, 2)
    d = q - p
    cross = r[..., 0] * s[..., 1] - r[..., 1] * s[..., 0]
    safe = np.where(cross == 0.0, 1.0, cross)
    t = (d[..., 0] * s[..., 1] - d[..., 1] * s[..., 0]) / safe
    u = (d[..., 0] * r[..., 1] - d[..., 1] * r[..., 0]) / safe
    return bool(((cross != 0.0) & (t >= 0) & (t <= 1) & (u >= 0) & (u <= 1)).any())


def passes_through(loop: Array, start: Array, end: Array) -> bool:
    """Whether the segment from `start` to `end` (3,) pierces the surface spanned by a closed loop (n, 3) of points.

    The surface is the fan of triangles around the loop's centre.
    """
    centre = loop.mean(axis=0)
    a, b = loop - centre, np.roll(loop, -1, axis=0) - centre  # edges of the triangles at the centre
    d = end - start
    normal = np.cross(a, b)
    along = normal @ d
    safe = np.where(np.abs(along) < 1e-12, 1.0, along)
    t = (normal @ (centre - start)) / safe
    hit = start + t[:, None] * d - centre  # (n, 3)
    # Barycentric coordinates of the hit in each triangle.
    area = np.maximum((normal**2).sum(axis=1), 1e-18)
    u = (np.cross(hit, b) * normal).sum(axis=1) / area
    v = (np.cross(a, hit) * normal).sum(axis=1) / area
    inside = (np.abs(along) >= 1e-12) & (t >= 0) & (t <= 1) & (u >= 0) & (v >= 0) & (u + v <= 1)
    return bool(np.count_nonzero(inside) % 2)


def distance_to_rods(polygon: Array, ends: Array, radii: Array) -> float:
    """Distance (m) from a simple polygon (n, 2) to the nearest of rods that are seen from above; 0 where they touch.

    Args:
        ends: (rods, 2, 2) m.
        radii: (rods,) m.
    """
    least = np.inf
    for (p0, p1), radius in zip(ends, radii, strict=True):
        if contains(polygon, p0) or _edges_cross(polygon, np.stack([p0, p1])):
            return 0.0
        nearest = min(_to_edges(polygon, p0).min(), _to_edges(polygon, p1).min(), _to_segment(polygon, p0, p1).min())
        least = min(least, float(nearest) - radius)
    return max(0.0, least)


def _to_edges(polygon: Array, point: Array) -> Array:
    """Distances (n,) of a point (2,) to the edges of a polygon."""
    edge, offset = np.roll(polygon, -1, axis=0) - polygon, point - polygon
    along = np.clip((offset * edge).sum(axis=1) / np.maximum((edge**2).sum(axis=1), 1e-18), 0.0, 1.0)
    return np.hypot(*(offset - along[:, None] * edge).T)


def _to_segment(points: Array, p0: Array, p1: Array) -> Array:
    """Distances (n,) of points (n, 2) to the segment from `p0` to `p1` (2,)."""
    edge, offset = p1 - p0, points - p0
    along = np.clip(offset @ edge / max(float(edge @ edge), 1e-18), 0.0, 1.0)
    return np.hypot(*(offset - along[:, None] * edge).T)
