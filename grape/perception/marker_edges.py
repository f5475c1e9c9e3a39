"""Corners of a marker from its four edges, each located along its whole length.

A window around a corner sees more white than black, so in a blurred picture the corner that is found there lies inside
the true one by a few tenths of a pixel, at every corner of every marker. A straight edge has no such bias.
"""

from __future__ import annotations

import cv2
import numpy as np

from grape.messages import Array

ALONG = np.linspace(0.12, 0.88, 24)  # where profiles cross an edge, as shares of its length: corners are left out
STEP_PX = 0.5  # between the points of a profile
LEAST_HALF_PX, MOST_HALF_PX = 1.5, 4.0  # length of a profile to both sides of the edge
LEAST_CONTRAST = 12.0  # grey levels between the ends of a profile
LEAST_PROFILES = 12  # of each edge must show it
MOVED_MOST_PX = 2.0  # a corner that would move farther keeps its place


def refine_corners(grey: Array, corners: Array, cells: int) -> Array:
    """Corners (4, 2) px of a marker, moved to where its edges meet.

    Args:
        grey: (h, w) uint8, the marker black on white.
        corners: (4, 2) px, right to within a pixel or two, in order around the marker.
        cells: along the marker's side, its black border included.

    Returns:
        The better corners, or `corners` where the marker is too small or its edges are covered.
    """
    corners = np.asarray(corners, float)
    refined = corners
    for _ in range(2):  # the second time the profiles are centred on the edges
        better = _meeting_points(grey, refined, cells)
        if better is None:
            return corners
        refined = better
    moved = np.linalg.norm(refined - corners, axis=1).max()
    return refined if moved <= MOVED_MOST_PX else corners


def _meeting_points(grey: Array, corners: Array, cells: int) -> Array | None:
    """Where the edges near the sides of a quadrangle (4, 2) meet; None when one of them is not seen."""
    sides = np.roll(corners, -1, axis=0) - corners  # edge k goes from corner k to the next
    lengths = np.linalg.norm(sides, axis=1, keepdims=True)
    half = min(MOST_HALF_PX, 0.45 * float(lengths.min()) / cells)
    if half < LEAST_HALF_PX:
        return None
    normals = np.column_stack([sides[:, 1], -sides[:, 0]]) / lengths
    outwards = np.sign(((corners - corners.mean(axis=0)) * normals).sum(axis=1, keepdims=True)) * normals
    feet = corners[:, None] + ALONG[:, None] * sides[:, None]  # (4, n, 2)
    offsets, seen = _offsets(grey, feet, outwards, np.arange(-half, half + 1e-9, STEP_PX))
    if (seen.sum(axis=1) < LEAST_PROFILES).any():
        return None
    ends = _straight(offsets, seen)  # (4, 2) px outwards at the ends of each edge
    a = corners + ends[:, :1] * outwards
    d = np.roll(corners, -1, axis=0) + ends[:, 1:] * outwards - a
    before_a, before_d = np.roll(a, 1, axis=0), np.roll(d, 1, axis=0)
    cross = before_d[:, 0] * d[:, 1] - before_d[:, 1] * d[:, 0]
    if (np.abs(cross) < 0.2 * (lengths * np.roll(lengths, 1, axis=0))[:, 0]).any():
        return None
    gap = a - before_a
    share = (gap[:, 0] * d[:, 1] - gap[:, 1] * d[:, 0]) / cross
    meet: Array = before_a + share[:, None] * before_d
    return meet


def _offsets(grey: Array, feet: Array, outwards: Array, across: Array) -> tuple[Array, Array]:
    """How far (4, n) px outwards of `feet` (4, n, 2) the edge lies, and whether it is seen there.

    The edge is where the brightness rises, in the mean over the profile at `across` (m,) px.
    """
    at = feet[:, :, None] + across[:, None] * outwards[:, None, None]  # (4, n, m, 2)
    u, v = (np.ascontiguousarray(at[..., k].reshape(-1, len(across)), np.float32) for k in (0, 1))
    profiles = cv2.remap(grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)
    rise = np.maximum(np.diff(profiles, axis=1), 0.0)
    seen = profiles[:, -1] - profiles[:, 0] > LEAST_CONTRAST
    offsets = (rise @ (0.5 * (across[1:] + across[:-1]))) / np.maximum(rise.sum(axis=1), 1e-9)
    return offsets.reshape(feet.shape[:2]), seen.reshape(feet.shape[:2])


def _straight(offsets: Array, seen: Array) -> Array:
    """Offsets (4, 2) at both ends of each edge, of the line through `offsets` (4, n), once more without outliers."""
    weight = seen.astype(float)
    for _ in range(2):
        total = np.maximum(weight.sum(axis=1, keepdims=True), 1e-9)
        t = ALONG - (weight @ ALONG)[:, None] / total
        mean = (weight * offsets).sum(axis=1, keepdims=True) / total
        slope = (weight * t * offsets).sum(axis=1, keepdims=True) / np.maximum((weight * t * t).sum(1)[:, None], 1e-9)
        off = np.abs(offsets - mean - slope * t)
        spread = np.median(np.where(seen, off, np.nanmax(off)), axis=1, keepdims=True)
        weight = seen * (off <= np.maximum(3.0 * spread, 0.1))
    middle = mean - slope * (ALONG - t)[:, :1]
    return np.hstack([middle, middle + slope])
