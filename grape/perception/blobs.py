"""Blobs of one colour in an RGB-D image: hue, saturation and value limits, a depth gate, morphology, shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, RgbdImage, frozen_array
from grape.perception.checks import as_bgr, as_depth, as_intrinsics, as_region


@dataclass(frozen=True, kw_only=True)
class BlobOptions:
    """Which pixels and which shapes count.

    Args:
        hue: (low, high) in OpenCV's 0...179; low > high wraps round through red.
        saturation, value: smallest, 0...255.
        open_px, close_px: kernel sizes of the morphology; 0 leaves the step out.
        area_px: (smallest, largest) at focal length `focal_px`; scaled by (f / focal_px)^2 for the camera at hand.
        focal_px: the focal length that `area_px` is given for.
        solidity: smallest area relative to the convex hull.
        hull_distance: largest difference of the Hu invariants to those of the own convex hull.
        depth_fraction: smallest share of a blob's pixels that carry a depth inside the gate.
        depth_fill_px: coloured pixels without depth count when they are this near to one inside the gate.
    """

    hue: tuple[int, int] = (175, 5)
    saturation: int = 120
    value: int = 50
    open_px: int = 3
    close_px: int = 5
    area_px: tuple[float, float] = (60.0, 2500.0)
    focal_px: float = 615.0
    solidity: float = 0.80
    hull_distance: float = 0.12
    depth_fraction: float = 0.3
    depth_fill_px: int = 3

    def __post_init__(self) -> None:
        if not all(0 <= h <= 179 for h in self.hue):
            raise InvalidInput(f"hue limits must lie in 0...179, got {self.hue}")
        if not 0 <= self.area_px[0] < self.area_px[1] or self.focal_px <= 0:
            raise InvalidInput(f"areas must rise and the focal length be positive, got {self.area_px}, {self.focal_px}")
        if min(self.open_px, self.close_px, self.depth_fill_px) < 0:
            raise InvalidInput("kernel sizes must not be negative")


@dataclass(frozen=True, kw_only=True)
class Blob:
    """One blob: centre (2,) px, median depth m (NaN without a depth), its place (3,) m in the optical frame, shape."""

    centre: Array
    depth_m: float
    position: Array
    area_px: float
    solidity: float
    hull_distance: float


def colour_mask(bgr: Array, options: BlobOptions) -> Array:
    """(h, w) bool: pixels inside the colour limits, after a light blur.

    Raises:
        InvalidInput: not a colour image.
    """
    hsv = cv2.cvtColor(cv2.GaussianBlur(as_bgr(bgr), (3, 3), 0), cv2.COLOR_BGR2HSV)
    low, high = options.hue
    floor = (options.saturation, options.value)
    spans = [(low, high)] if low <= high else [(low, 179), (0, high)]
    mask = np.zeros(hsv.shape[:2], np.uint8)
    for start, end in spans:
        mask |= cv2.inRange(hsv, (start, *floor), (end, 255, 255))
    return mask > 0


def gated_mask(colour: Array, depth: Array, depth_range: tuple[float, float] | None, options: BlobOptions) -> Array:
    """The coloured pixels inside the depth gate, and those without a depth right beside them, after morphology."""
    mask = colour
    if depth_range is not None:
        gated = colour & (depth > depth_range[0]) & (depth < depth_range[1])
        reach = 2 * options.depth_fill_px + 1
        beside = cv2.dilate(gated.astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
        mask = gated | (colour & (depth <= 0) & beside)
    out: Array = mask.astype(np.uint8)
    for size, operation in ((options.open_px, cv2.MORPH_OPEN), (options.close_px, cv2.MORPH_CLOSE)):
        if size > 1:
            out = cv2.morphologyEx(out, operation, np.ones((size, size), np.uint8))
    return out > 0


def find_blobs(
    image: RgbdImage,
    options: BlobOptions | None = None,
    *,
    depth_range: tuple[float, float] | None = None,
    roi: Any = None,
) -> tuple[Blob, ...]:
    """The blobs of a colour in an image, largest first.

    Args:
        image: registered colour and depth.
        options: see `BlobOptions`.
        depth_range: (near, far) m; None takes every depth, also none.
        roi: (u0, v0, u1, v1) px; blobs are cut at its border.

    Raises:
        InvalidInput: an image of another shape or type, or a region outside the image.
    """
    options = options or BlobOptions()
    K = as_intrinsics(image.info.K)
    bgr = as_bgr(image.bgr)
    depth = as_depth(image.depth, bgr.shape[:2])
    mask = gated_mask(colour_mask(bgr, options), depth, depth_range, options)
    if roi is not None:
        u0, v0, u1, v1 = as_region(roi, bgr.shape)
        window = np.zeros_like(mask)
        window[v0:v1, u0:u1] = mask[v0:v1, u0:u1]
        mask = window
    scale = K[0, 0] * K[1, 1] / options.focal_px**2
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = [_measure(contour, depth, K, scale, depth_range, options) for contour in contours]
    return tuple(sorted((b for b in found if b is not None), key=lambda b: -b.area_px))


def _measure(
    contour: Array, depth: Array, K: Array, scale: float, gate: tuple[float, float] | None, options: BlobOptions
) -> Blob | None:
    """The blob inside a contour, or None when its size, shape or depth does not fit."""
    area = float(cv2.contourArea(contour))
    if not options.area_px[0] * scale < area < options.area_px[1] * scale:
        return None
    hull = cv2.convexHull(contour)
    solidity = area / max(float(cv2.contourArea(hull)), 1.0)
    hull_distance = float(cv2.matchShapes(contour, hull, cv2.CONTOURS_MATCH_I1, 0))
    if solidity < options.solidity or hull_distance > options.hull_distance:
        return None
    u, v, w, h = cv2.boundingRect(contour)
    inside = np.zeros((h, w), np.uint8)
    cv2.drawContours(inside, [contour], -1, 1, -1, offset=(-u, -v))
    z = depth[v : v + h, u : u + w][inside > 0]
    near, far = gate or (0.0, np.inf)
    measured = z[(z > near) & (z < far)]
    if gate is not None and len(measured) < options.depth_fraction * len(z):
        return None
    moments = cv2.moments(contour)
    centre = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    depth_m = float(np.median(measured)) if len(measured) else float("nan")
    return Blob(
        centre=frozen_array(centre),
        depth_m=depth_m,
        position=frozen_array(back_project(centre, depth_m, K)),
        area_px=area,
        solidity=solidity,
        hull_distance=hull_distance,
    )


def back_project(pixel: Array, depth_m: float, K: Array) -> Array:
    """(3,) m in the optical frame of a pixel (2,) at a depth along z."""
    return np.array([(pixel[0] - K[0, 2]) / K[0, 0], (pixel[1] - K[1, 2]) / K[1, 1], 1.0]) * depth_m
