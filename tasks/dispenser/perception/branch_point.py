"""The one point that plant mode servos on: the tip of the spur near where it is predicted.

Colour and depth both decide. Of the pixels that look like the spur, those count whose places in space lie beside the
predicted axis: the held loop, which crosses the spur in the image, is nearer to the camera and drops out. What is left
is one bar; its far end is the tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, RgbdImage, frozen_array
from grape.perception.checks import as_bgr, as_depth, as_vector


@dataclass(frozen=True, kw_only=True)
class BranchPointOptions:
    """What belongs to the spur.

    Args:
        below_m, above_m: how far from the predicted tip, along the spur, is looked.
        beside_m: how far the spur may lie beside its predicted axis.
        radius_m: of the bar that is kept, about the surface that is found.
        colour: largest difference to the reference in L, a, b (OpenCV's 0...255 scale).
        bridge_m: a longer gap along the spur, such as one that a finger hides, ends it.
        min_depth_m: below this the camera measures no depth.
        min_area_m2: smallest surface facing the camera.
        max_jump_m: a tip farther from the prediction than this is not it.
    """

    below_m: float = 0.05
    above_m: float = 0.03
    beside_m: float = 0.025
    radius_m: float = 0.009
    colour: tuple[float, float, float] = (40.0, 14.0, 14.0)
    bridge_m: float = 0.012
    min_depth_m: float = 0.20
    min_area_m2: float = 1.0e-5
    max_jump_m: float = 0.030

    def __post_init__(self) -> None:
        lengths = (self.below_m, self.above_m, self.beside_m, self.radius_m, self.bridge_m, self.max_jump_m)
        if min(*lengths, self.min_area_m2, *self.colour) <= 0 or self.min_depth_m < 0:
            raise InvalidInput(f"branch point options must be positive, got {self}")


@dataclass(frozen=True, kw_only=True)
class BranchPoint:
    """The tip in the image, pixel (2,) px and depth_m, or the reason why it is not seen; area_px: pixels that count."""

    pixel: Array | None
    depth_m: float | None
    reason: str
    area_px: int = 0


@dataclass(frozen=True)
class _Surface:
    """What the camera sees about the predicted tip.

    lab (n, 3); along (n,) m from the predicted tip, along the spur; beside (n, 3) m off the predicted axis; pixel (n,)
    distance in px from the predicted tip.
    """

    lab: Array
    along: Array
    beside: Array
    pixel: Array
    px_per_m: float


def _surface(image: RgbdImage, tip: Array, direction: Array, options: BranchPointOptions) -> _Surface | None:
    bgr = as_bgr(image.bgr)
    depth = as_depth(image.depth, bgr.shape[:2])
    tip, direction = as_vector(tip, 3, "predicted tip"), as_vector(direction, 3, "direction")
    if not (np.isfinite(tip).all() and tip[2] > 0 and abs(np.linalg.norm(direction) - 1.0) < 1e-3):
        raise InvalidInput(f"a tip before the camera and a unit vector are needed, got {tip} and {direction}")
    K = np.asarray(image.info.K, float)
    px_per_m = float(K[0, 0] / tip[2])
    ends = np.array([tip + options.above_m * direction, tip - options.below_m * direction])
    centre = tip[:2] / tip[2] * K[[0, 1], [0, 1]] + K[:2, 2]
    ends = ends[:, :2] / np.maximum(ends[:, 2:], 0.05) * K[[0, 1], [0, 1]] + K[:2, 2]
    margin = options.beside_m * px_per_m
    low = np.maximum(np.floor(ends.min(axis=0) - margin), 0).astype(int)
    high = np.minimum(np.ceil(ends.max(axis=0) + margin) + 1, (bgr.shape[1], bgr.shape[0])).astype(int)
    if (high - low < 8).any():
        return None
    patch = np.ascontiguousarray(bgr[low[1] : high[1], low[0] : high[0]])
    z = depth[low[1] : high[1], low[0] : high[0]].astype(float)
    v, u = np.nonzero(z >= options.min_depth_m)
    z = z[v, u]
    pixels = np.column_stack([u + low[0], v + low[1]]).astype(float)
    offset = np.column_stack([(pixels - K[:2, 2]) / K[[0, 1], [0, 1]] * z[:, None], z]) - tip
    along = offset @ direction
    beside = offset - along[:, None] * direction
    keep = (along > -options.below_m) & (along < options.above_m)
    keep &= np.linalg.norm(beside, axis=1) < options.beside_m
    lab = cv2.cvtColor(patch, cv2.COLOR_BGR2LAB)[v[keep], u[keep]].astype(float)
    distance = np.linalg.norm(pixels[keep] - centre, axis=1)
    return _Surface(lab=lab, along=along[keep], beside=beside[keep], pixel=distance, px_per_m=px_per_m)


def reference_colour(
    image: RgbdImage, tip: Array, direction: Array, options: BranchPointOptions | None = None
) -> Array | None:
    """(3,) L, a, b of the surface on the predicted axis that lies nearest to the predicted tip; None if none does.

    Taken once, in the first frame; the later frames are compared with it.

    Args:
        image: registered colour and depth.
        tip: (3,) m, predicted, in the optical frame.
        direction: (3,) unit vector from the spur's base to its tip, in the optical frame.

    Raises:
        InvalidInput: an image of another shape or type, or a prediction that is not finite or behind the camera.
    """
    options = options or BranchPointOptions()
    surface = _surface(image, tip, direction, options)
    if surface is None or len(surface.along) < 10:
        return None
    nearest = np.argsort(np.linalg.norm(surface.beside, axis=1) + 0.5 * np.abs(surface.along), kind="stable")[:60]
    return frozen_array(np.median(surface.lab[nearest], axis=0))


def branch_point(
    image: RgbdImage,
    tip: Array,
    direction: Array,
    reference: Array,
    options: BranchPointOptions | None = None,
    diameter_m: float = 0.0,
) -> BranchPoint:
    """Finds the spur's tip near its predicted place: similar colour, beside the axis, the end of the bar.

    Args:
        image: registered colour and depth.
        tip: (3,) m, where kinematics predict the tip, in the optical frame.
        direction: (3,) unit vector from the spur's base to its tip, in the optical frame.
        reference: (3,) L, a, b from `reference_colour`.
        options: see `BranchPointOptions`.
        diameter_m: of the spur: its axis lies behind the side that is seen.

    Raises:
        InvalidInput: an image of another shape or type, or a prediction or reference that is not finite.
    """
    options = options or BranchPointOptions()
    reference = as_vector(reference, 3, "reference colour")
    surface = _surface(image, tip, direction, options)
    if surface is None:
        return BranchPoint(pixel=None, depth_m=None, reason="the predicted point is outside the image")
    least = max(5, round(options.min_area_m2 * surface.px_per_m**2))
    if len(surface.along) < least:
        return BranchPoint(pixel=None, depth_m=None, reason="nothing at the predicted place")
    similar = (np.abs(surface.lab - reference) < np.array(options.colour)).all(axis=1)
    along, beside = surface.along[similar], surface.beside[similar]
    if len(along) < least:
        return BranchPoint(pixel=None, depth_m=None, reason="nothing of similar colour at the predicted place")
    middle = _middle(beside, options.radius_m)
    bar = np.sort(along[np.linalg.norm(beside - middle, axis=1) < options.radius_m])
    bar = _longest_run(bar, options.bridge_m)
    if len(bar) < least:
        return BranchPoint(pixel=None, depth_m=None, reason="no bar beside the predicted axis")
    middle = middle + _depth_of_axis(tip, direction, diameter_m)
    found = np.asarray(tip, float) + middle + bar[-3:].mean() * np.asarray(direction, float)
    jump = float(np.linalg.norm(found - tip))
    if jump > options.max_jump_m:
        return BranchPoint(pixel=None, depth_m=None, reason=f"the nearest tip is {jump * 1000:.0f} mm off")
    K = np.asarray(image.info.K, float)
    pixel = found[:2] / found[2] * K[[0, 1], [0, 1]] + K[:2, 2]
    return BranchPoint(pixel=frozen_array(pixel), depth_m=float(found[2]), reason="", area_px=len(bar))


def _middle(beside: Array, radius: float) -> Array:
    """(3,) m off the axis where most of the surface lies, found from the axis outwards by mean shift."""
    middle = np.zeros(3)
    for reach in (2.5 * radius, 1.5 * radius, 1.5 * radius, radius):
        distance = np.linalg.norm(beside - middle, axis=1)
        near = distance < max(reach, float(distance.min()) + 0.5 * radius)
        middle = np.asarray(beside[near].mean(axis=0))
    return middle


def _depth_of_axis(tip: Array, direction: Array, diameter: float) -> Array:
    """(3,) m from the middle of the visible half of a round bar to its axis: pi / 8 of the diameter, square to it."""
    across = np.asarray(tip, float) - float(np.dot(tip, direction)) * np.asarray(direction, float)
    return np.asarray(np.pi / 8.0 * diameter * across / max(float(np.linalg.norm(across)), 1e-9))


def _longest_run(places: Array, gap: float) -> Array:
    """The longest stretch of sorted places (n,) without a gap."""
    if not len(places):
        return places
    runs = np.split(places, np.flatnonzero(np.diff(places) > gap) + 1)
    return max(runs, key=lambda run: float(run[-1] - run[0]))
