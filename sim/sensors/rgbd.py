"""What a colour and depth camera adds to a perfect picture: blur, pixel noise, stereo depth noise, limits and glare.

Source: facts sheet, section 3 (depth noise sigma = z^2 s / (f B)); glare as a saturated disc: the perception study.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class Glare:
    """A saturated disc in the picture: centre (u, v) and radius in pixels."""

    u: float
    v: float
    radius: float


@dataclass(frozen=True, kw_only=True)
class RgbdModel:
    """Errors of an RGB-D camera."""

    blur_px: float = 0.6  # standard deviation
    noise: float = 3.0  # grey levels, standard deviation
    subpixel: float = 0.08  # px of disparity, standard deviation
    stereo_baseline: float = 0.05  # m
    depth_min: float = 0.20  # m
    depth_max: float = 10.0  # m
    depth_step: float = 0.001  # m
    glare: Glare | None = field(default=None)


@dataclass(frozen=True, kw_only=True)
class GlossyPlate:
    """A flat face that mirrors the sun.

    Attributes:
        T_camera_plate: (4, 4) of the face's centre in the optical frame, z out of the face.
        half_size: (2,) m.
        gloss_rad: how far from the sun's mirror image the face still saturates the picture.
    """

    T_camera_plate: Array
    half_size: Array
    gloss_rad: float


def sun_on_plate(plate: GlossyPlate, towards_sun: Array, K: Array, depth: Array) -> Array | None:
    """Pixels (n, 2) as (v, u) that a plate's mirrored sun saturates; None when there are none.

    A pixel is lit when its ray, mirrored by the face, comes within `gloss_rad` of the sun.

    Args:
        towards_sun: (3,) unit vector in the optical frame.
        K: (3, 3) px.
        depth: (h, w) m along z, true: what stands before the plate hides it.
    """
    centre, R = plate.T_camera_plate[:3, 3], plate.T_camera_plate[:3, :3]
    normal = R[:, 2]
    if normal @ towards_sun <= 0.0 or normal @ centre >= 0.0:  # the face is in its own shadow or turned away
        return None
    corners = centre + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * plate.half_size @ R[:, :2].T
    if (corners[:, 2] < 0.05).any():
        return None
    outline = corners[:, :2] / corners[:, 2:] * (K[0, 0], K[1, 1]) + K[:2, 2]
    low = np.maximum(np.floor(outline.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 1, depth.shape[::-1])
    if (low >= high).any():
        return None
    v, u = np.mgrid[low[1] : high[1], low[0] : high[0]].reshape(2, -1)
    rays = np.column_stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.size)])
    z = (normal @ centre) / (rays @ normal)
    on_face = np.abs((z[:, None] * rays - centre) @ R[:, :2]) <= plate.half_size
    mirrored = rays - 2.0 * (rays @ normal)[:, None] * normal
    near = mirrored @ towards_sun >= np.cos(plate.gloss_rad) * np.linalg.norm(mirrored, axis=1)
    lit = on_face.all(axis=1) & near & (np.abs(depth[v, u] - z) < 0.01)
    return np.column_stack([v, u])[lit] if lit.any() else None


class NoiseBank:
    """Normal noise drawn once and cut at random places: a frame costs an addition instead of a million draws."""

    def __init__(self, rng: np.random.Generator, height: int, width: int, channels: int, margin: int = 160) -> None:
        self._shape = (height, width)
        self._margin = margin
        self._bank = rng.standard_normal((height + margin, width + margin, channels), dtype=np.float32)

    def scaled(self, sigma: float) -> NoiseBank:
        """The bank in whole grey levels of standard deviation `sigma`."""
        self._bank = np.rint(self._bank * sigma).clip(-120, 120).astype(np.int16)
        return self

    def cut(self, rng: np.random.Generator) -> Array:
        """(height, width, channels) of the bank at a random place."""
        i, j = rng.integers(0, self._margin, 2)
        return self._bank[i : i + self._shape[0], j : j + self._shape[1]]


def measured_color(bgr: Array, noise: Array, model: RgbdModel, saturated: Array | None = None) -> Array:
    """The colour picture (h, w, 3) uint8 with blur, `noise` (h, w, 3) in grey levels and glare.

    Args:
        saturated: (n, 2) pixels (v, u) that the mirrored sun whitens before they are blurred.
    """
    import cv2

    if saturated is not None:
        bgr = bgr.copy()
        bgr[saturated[:, 0], saturated[:, 1]] = 255
    blurred = cv2.GaussianBlur(bgr, (0, 0), model.blur_px) if model.blur_px > 0 else bgr
    measured = cv2.add(blurred, np.ascontiguousarray(noise), dtype=cv2.CV_8U)
    if model.glare is not None:
        centre = (round(model.glare.u), round(model.glare.v))
        cv2.circle(measured, centre, round(model.glare.radius), (255, 255, 255), thickness=-1, lineType=cv2.LINE_AA)
    return measured


def measured_depth(
    depth: Array, noise: Array, focal_px: float, model: RgbdModel, saturated: Array | None = None
) -> Array:
    """The depth picture (h, w) float32 in metres, 0 where nothing is measured.

    Args:
        depth: true distance along z, m.
        noise: (h, w) standard normal numbers.
        saturated: (n, 2) pixels (v, u) in which the stereo pair sees nothing but glare.
    """
    sigma = np.float32(model.subpixel / (focal_px * model.stereo_baseline))
    step = np.float32(model.depth_step)
    measured = np.rint((depth + depth * depth * sigma * noise) / step) * step
    measured[(depth < model.depth_min) | (depth > model.depth_max)] = 0.0
    if model.glare is not None:
        v, u = np.ogrid[: depth.shape[0], : depth.shape[1]]
        measured[(u - model.glare.u) ** 2 + (v - model.glare.v) ** 2 <= model.glare.radius**2] = 0.0
    if saturated is not None:
        measured[saturated[:, 0], saturated[:, 1]] = 0.0
    return measured.astype(np.float32, copy=False)
