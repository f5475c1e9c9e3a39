"""Refinement of one spur candidate: its axis, tip and base refitted, and what surrounds it counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from grape.errors import InvalidInput
from grape.messages import Array
from grape.tasks.dispenser.perception.deployment_pose import SpurMeasure


@dataclass(frozen=True, kw_only=True)
class RefineOptions:
    """How an axis is refitted.

    Args:
        iterations: of the fit.
        lateral_m, depth_m: a point belongs to the spur when it is this near to the axis, across and along the view.
        wide_m: lateral half-width in which widths are measured.
        gap_m: a lateral gap this wide separates a spur from what is beside it.
        tip_beyond_m: added to the measured tip, the 99.5th percentile of the points along the axis; negative for a
            camera that smears objects outwards.
        diameter_bias_m: taken off the measured width, for such a camera.
        depth_share: the camera sees the near half of the bark; the axis lies this share of the diameter behind it.
    """

    iterations: int = 4
    lateral_m: float = 0.009
    depth_m: float = 0.014
    wide_m: float = 0.020
    gap_m: float = 0.005
    tip_beyond_m: float = 0.001
    diameter_bias_m: float = 0.0
    depth_share: float = 0.32

    def __post_init__(self) -> None:
        if self.iterations < 1 or min(self.lateral_m, self.depth_m, self.wide_m, self.gap_m) <= 0:
            raise InvalidInput(f"refine options must be positive, got {self}")


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What a spur is judged in: the cloud with its tree, the sensor's places, the hand's way and the vine's middle."""

    points: Array  # (n, 3) m
    tree: cKDTree
    origins: Array  # (k, 3) m
    approach: Array  # (3,) unit vector from the tip towards the coming hand
    toward_robot: Array  # (3,) horizontal unit vector
    middle: Array  # (3,) m, median of the cloud
    corridor_radius_m: float

    def view(self, point: Array) -> Array:
        """(3,) unit vector of the line of sight on `point` from the nearest place of the sensor."""
        origin = self.origins[np.argmin(np.linalg.norm(self.origins - point, axis=1))]
        ray = point - origin
        norm = float(np.linalg.norm(ray))
        return ray / norm if norm > 1e-6 else -self.toward_robot


def measure_spur(tip: Array, direction: Array, scene: Surroundings, options: RefineOptions) -> SpurMeasure | None:
    """Refits the axis of a candidate and measures it; None when no stem is there.

    Args:
        tip: (3,) m guess.
        direction: (3,) unit vector towards the free end.
        scene: see `Surroundings`.
        options: see `RefineOptions`.
    """
    from grape.tasks.dispenser.perception.spur_kernels import grow, lateral_frame

    near = scene.points[scene.tree.query_ball_point(tip, 0.22)]
    if len(near) < 15:
        return None
    view = scene.view(tip)
    guess = np.ascontiguousarray(tip, float), np.ascontiguousarray(direction, float)
    sizes = options.lateral_m, options.depth_m, options.wide_m, options.iterations
    axis, member = grow(near, *guess, view, *sizes)
    if not member.any():
        return None
    tip, base, direction = axis[0] + options.tip_beyond_m * axis[2], axis[1], axis[2]
    across, away = lateral_frame(direction, view)
    diameter = _stem_width(near, tip, base, (direction, across, away), options) - options.diameter_bias_m
    counts = _count_around(near, tip, base, direction, scene)
    inwards = options.depth_share * diameter * away
    return SpurMeasure(
        tip=tip + inwards,
        base=base + inwards,
        direction=direction,
        diameter_m=diameter,
        own=int(member.sum()),
        thickness_m=_thickness_below(near, base, (direction, across, away), options),
        behind_m=float((scene.middle - tip) @ scene.toward_robot),
        **counts,
    )


def _stem_width(
    near: Array, tip: Array, base: Array, axes: tuple[Array, Array, Array], options: RefineOptions
) -> float:
    """35th percentile over 6 mm slices of the contiguous width round the axis: buds and knobs are left out."""
    direction, across, away = axes
    offset = near - tip
    along, lateral = -(offset @ direction), offset @ across
    length = float(np.linalg.norm(tip - base))
    keep = (along > 0.004) & (along < length - 0.006) & (np.abs(lateral) < 0.035)
    keep &= np.abs(offset @ away) < 1.5 * options.depth_m
    slices, lateral = (along[keep] / 0.006).astype(int), lateral[keep]
    widths = [_contiguous(np.sort(lateral[slices == k]), options.gap_m) for k in np.unique(slices)]
    widths = [w for w in widths if w > 0]
    return float(np.percentile(widths, 35)) if widths else 0.0


def _contiguous(values: Array, gap: float) -> float:
    """Width of the run of sorted `values` round zero that has no gap; 0 for fewer than 4 values."""
    if len(values) < 4:
        return 0.0
    cuts = np.nonzero(np.diff(values) > gap)[0] + 1
    run = np.split(values, cuts)[int(np.searchsorted(cuts, np.argmin(np.abs(values)), side="right"))]
    return float(np.ptp(run))


def _thickness_below(near: Array, base: Array, axes: tuple[Array, Array, Array], options: RefineOptions) -> float:
    """Width (m) of what is round the spur's base: twice the 85th percentile of the lateral distance."""
    direction, across, away = axes
    offset = near - base
    along, lateral = offset @ direction, np.abs(offset @ across)
    keep = (along > -0.035) & (along < 0.012) & (lateral < 0.05) & (np.abs(offset @ away) < 2.5 * options.depth_m)
    return float(np.percentile(lateral[keep], 85) * 2) if keep.sum() > 4 else 0.0


def _count_around(near: Array, tip: Array, base: Array, direction: Array, scene: Surroundings) -> dict[str, int]:
    """Points beyond the tip, below the base, beside the upper spur and in the hand's way."""
    from_tip, from_base = near - tip, near - base
    s, s_base = from_tip @ direction, from_base @ direction
    radius = np.linalg.norm(from_tip - s[:, None] * direction, axis=1)
    radius_base = np.linalg.norm(from_base - s_base[:, None] * direction, axis=1)
    length = float(np.linalg.norm(tip - base))
    way = from_tip @ scene.approach
    off_way = np.linalg.norm(from_tip - way[:, None] * scene.approach, axis=1)
    masks = {
        "beyond": (s > 0.008) & (s < 0.05) & (radius < 0.015 + 0.2 * s),
        "below": (s_base < -0.002) & (s_base > -0.035) & (radius_base < 0.04),
        "beside": (s < 0) & (s > -0.6 * length) & (radius > 0.016) & (radius < 0.045),
        "corridor": (way > 0.03) & (way < 0.18) & (off_way < scene.corridor_radius_m),
    }
    return {name: int(mask.sum()) for name, mask in masks.items()}
