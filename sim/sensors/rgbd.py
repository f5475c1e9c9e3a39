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


def measured_color(bgr: Array, noise: Array, model: RgbdModel) -> Array:
    """The colour picture (h, w, 3) uint8 with blur, `noise` (h, w, 3) in grey levels and glare."""
    import cv2

    blurred = cv2.GaussianBlur(bgr, (0, 0), model.blur_px) if model.blur_px > 0 else bgr
    measured = cv2.add(blurred, np.ascontiguousarray(noise), dtype=cv2.CV_8U)
    if model.glare is not None:
        centre = (round(model.glare.u), round(model.glare.v))
        cv2.circle(measured, centre, round(model.glare.radius), (255, 255, 255), thickness=-1, lineType=cv2.LINE_AA)
    return measured


def measured_depth(depth: Array, noise: Array, focal_px: float, model: RgbdModel) -> Array:
    """The depth picture (h, w) float32 in metres, 0 where nothing is measured.

    Args:
        depth: true distance along z, m.
        noise: (h, w) standard normal numbers.
    """
    sigma = np.float32(model.subpixel / (focal_px * model.stereo_baseline))
    step = np.float32(model.depth_step)
    measured = np.rint((depth + depth * depth * sigma * noise) / step) * step
    measured[(depth < model.depth_min) | (depth > model.depth_max)] = 0.0
    if model.glare is not None:
        v, u = np.ogrid[: depth.shape[0], : depth.shape[1]]
        measured[(u - model.glare.u) ** 2 + (v - model.glare.v) ** 2 <= model.glare.radius**2] = 0.0
    return measured.astype(np.float32, copy=False)
