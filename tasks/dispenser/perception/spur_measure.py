"""Refinement of one spur candidate: its axis, tip and base refitted, and what surrounds it counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
    """What a spur is judged in: the cloud, the sensor's places, the hand's way and the vine's middle."""

    points: Array  # (n, 3) m
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
    from grape.tasks.dispenser.perception.stem_kernels import (
        beside_line,
        count_around,
        count_in_way,
        stem_width,
        thickness_below,
        within,
    )

    tip, direction = np.ascontiguousarray(tip, float), np.ascontiguousarray(direction, float)
    near = within(scene.points, tip, 0.22)
    stem = beside_line(near, tip, direction, 0.09)
    if len(stem) < 15:
        return None
    view = scene.view(tip)
    sizes = options.lateral_m, options.depth_m, options.wide_m, options.iterations
    axis, member = grow(beside_line(stem, tip, direction, 0.05), tip, direction, view, *sizes)
    if not member.any():
        return None
    tip, base, direction = axis[0] + options.tip_beyond_m * axis[2], axis[1], axis[2]
    axes = np.stack([direction, *lateral_frame(direction, view)])
    length = float(np.linalg.norm(tip - base))
    diameter = stem_width(stem, tip, length, axes, 1.5 * options.depth_m, options.gap_m) - options.diameter_bias_m
    beyond, below, beside = count_around(stem, tip, base, direction)
    inwards = options.depth_share * diameter * axes[2]
    return SpurMeasure(
        tip=tip + inwards,
        base=base + inwards,
        direction=direction,
        diameter_m=diameter,
        own=int(member.sum()),
        beyond=beyond,
        below=below,
        beside=beside,
        corridor=count_in_way(near, tip, scene.approach, scene.corridor_radius_m),
        thickness_m=thickness_below(stem, base, axes, 2.5 * options.depth_m),
        behind_m=float((scene.middle - tip) @ scene.toward_robot),
    )
