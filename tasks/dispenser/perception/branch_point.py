"""The one image point that plant mode servos on: the tip of the spur near where it is predicted."""

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
        window_m: half-size of the searched square around the prediction, at its depth.
        colour: largest difference to the reference in L, a, b (OpenCV's 0...255 scale).
        depth_gate_m: largest difference to the predicted depth.
        min_depth_m: below this the camera measures no depth.
        min_area_m2: smallest component facing the camera.
        top_m: height of the rows at the component's top whose mean is the tip.
        max_jump_m: a tip farther from the prediction than this is not it.
        bridge_m: what lies in front and is no wider than this, such as a tube of the held loop, does not cut the spur.
    """

    window_m: float = 0.04
    colour: tuple[float, float, float] = (40.0, 14.0, 14.0)
    depth_gate_m: float = 0.030
    min_depth_m: float = 0.20
    min_area_m2: float = 1.0e-5
    top_m: float = 0.005
    max_jump_m: float = 0.025
    bridge_m: float = 0.008

    def __post_init__(self) -> None:
        lengths = (self.window_m, self.depth_gate_m, self.top_m, self.max_jump_m, self.bridge_m)
        sizes = (*lengths, self.min_area_m2, *self.colour)
        if min(sizes) <= 0 or self.min_depth_m < 0:
            raise InvalidInput(f"branch point options must be positive, got {self}")


@dataclass(frozen=True, kw_only=True)
class BranchPoint:
    """The tip in the image, or why it is not seen.

    pixel (2,) px is the mean of the component's top rows, None when not found; depth_m is their median depth, None
    when the camera measured none (hold the last one); circle_px (2,) is the centre of the component's enclosing circle.
    """

    pixel: Array | None
    depth_m: float | None
    reason: str
    circle_px: Array | None = None
    area_px: int = 0


@dataclass(frozen=True)
class _Window:
    """The searched part of an image: LAB (h, w, 3) float, depth (h, w) m, origin (u, v); gate and hidden (h, w) bool.

    gate: at the predicted depth. hidden: something nearer may lie in front.
    """

    lab: Array
    depth: Array
    origin: Array
    gate: Array
    hidden: Array
    px_per_m: float


def _window(image: RgbdImage, pixel: Array, depth_m: float, options: BranchPointOptions) -> _Window | None:
    bgr = as_bgr(image.bgr)
    depth = as_depth(image.depth, bgr.shape[:2])
    pixel = as_vector(pixel, 2, "predicted pixel")
    if not (np.isfinite(depth_m) and depth_m > 0):
        raise InvalidInput(f"the predicted depth must be positive metres, got {depth_m}")
    px_per_m = float(image.info.K[0][0]) / depth_m
    half = max(options.window_m * px_per_m, 6.0)
    u0, v0 = (max(round(c - half), 0) for c in pixel)
    u1, v1 = (min(round(c + half) + 1, n) for c, n in zip(pixel, (bgr.shape[1], bgr.shape[0]), strict=True))
    if u1 - u0 < 8 or v1 - v0 < 8:
        return None
    lab = cv2.cvtColor(np.ascontiguousarray(bgr[v0:v1, u0:u1]), cv2.COLOR_BGR2LAB).astype(np.float32)
    z = np.where(depth[v0:v1, u0:u1] < options.min_depth_m, 0.0, depth[v0:v1, u0:u1])
    gate = np.abs(z - depth_m) < options.depth_gate_m
    if depth_m < options.min_depth_m + options.depth_gate_m:
        gate |= z == 0  # perhaps nearer than the camera can measure: there, colour alone decides
    hidden = z < depth_m
    return _Window(lab=lab, depth=z, origin=np.array([u0, v0], float), gate=gate, hidden=hidden, px_per_m=px_per_m)


def reference_colour(
    image: RgbdImage, pixel: Array, depth_m: float, options: BranchPointOptions | None = None
) -> Array | None:
    """(3,) L, a, b of the surface at the predicted depth that lies nearest to the predicted pixel; None if none does.

    Taken once, in the first frame; the later frames are compared with it.

    Args:
        image: registered colour and depth.
        pixel: (2,) px, the predicted tip.
        depth_m: its predicted depth.

    Raises:
        InvalidInput: an image of another shape or type, or a prediction that is not finite.
    """
    options = options or BranchPointOptions()
    window = _window(image, pixel, depth_m, options)
    if window is None or not window.gate.any():
        return None
    inner = cv2.erode(window.gate.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0  # rims mix with the background
    v, u = np.nonzero(inner if inner.sum() >= 10 else window.gate)
    distance = np.hypot(u + window.origin[0] - pixel[0], v + window.origin[1] - pixel[1])
    nearest = np.argsort(distance, kind="stable")[:60]
    return frozen_array(np.median(window.lab[v[nearest], u[nearest]], axis=0).astype(float))


def branch_point(
    image: RgbdImage, pixel: Array, depth_m: float, reference: Array, options: BranchPointOptions | None = None
) -> BranchPoint:
    """Finds the spur's tip near its predicted place: similar colour, depth gate, nearest component, its top rows.

    Args:
        image: registered colour and depth; the image's up is the spur's up (row 0 on top).
        pixel: (2,) px, where kinematics predict the tip.
        depth_m: predicted depth along z.
        reference: (3,) L, a, b from `reference_colour`.
        options: see `BranchPointOptions`.

    Raises:
        InvalidInput: an image of another shape or type, or a prediction or reference that is not finite.
    """
    options = options or BranchPointOptions()
    reference = as_vector(reference, 3, "reference colour")
    window = _window(image, pixel, depth_m, options)
    if window is None:
        return BranchPoint(pixel=None, depth_m=None, reason="the predicted point is outside the image")
    if not window.gate.any():
        return BranchPoint(pixel=None, depth_m=None, reason="nothing at the predicted depth")
    similar = (np.abs(window.lab - reference) < np.array(options.colour)).all(axis=2) & window.gate
    mask = cv2.morphologyEx(similar.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(_bridged(mask, window, options))
    components = [(labels == k) & (mask > 0) for k in range(1, count)]
    least = options.min_area_m2 * window.px_per_m**2
    found = [_tip(component, window, options) for component in components if component.sum() >= least]
    if not found:
        return BranchPoint(pixel=None, depth_m=None, reason="nothing of similar colour at the predicted depth")
    best = min(found, key=lambda p: float(np.linalg.norm(p.pixel - pixel)))
    jump = float(np.linalg.norm(best.pixel - pixel)) / window.px_per_m
    if jump > options.max_jump_m:
        return BranchPoint(pixel=None, depth_m=None, reason=f"the nearest tip is {jump * 1000:.0f} mm off")
    return best


def _bridged(mask: Array, window: _Window, options: BranchPointOptions) -> Array:
    """The mask with its gaps closed where something narrow may hide what lies behind."""
    size = 2 * round(options.bridge_m * window.px_per_m / 2) + 1
    border = cv2.copyMakeBorder(mask, size, size, size, size, cv2.BORDER_CONSTANT)
    closed = cv2.morphologyEx(border, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
    inner = closed[size:-size, size:-size]
    return np.where(window.hidden, inner, mask).astype(np.uint8)


def _tip(component: Array, window: _Window, options: BranchPointOptions) -> BranchPoint:
    v, u = np.nonzero(component)
    rows = max(3, round(options.top_m * window.px_per_m))
    top = v < v.min() + rows
    z = window.depth[v[top], u[top]]
    z = z[z > 0]
    centre, _ = cv2.minEnclosingCircle(np.column_stack([u, v]).astype(np.float32))
    return BranchPoint(
        pixel=frozen_array(np.array([u[top].mean(), v.min()]) + window.origin),
        depth_m=float(np.median(z)) if len(z) > 3 else None,
        reason="",
        circle_px=frozen_array(np.array(centre) + window.origin),
        area_px=int(component.sum()),
    )
