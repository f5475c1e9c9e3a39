"""Which level of the feeder is on top, from the place of the dispensers' red wings relative to the feeder's markers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import inverse, is_pose, pose, transform
from grape.messages import Array, RgbdImage, frozen_array
from grape.perception.blobs import BlobOptions, colour_mask, gated_mask
from grape.perception.checks import as_bgr, as_depth, as_intrinsics
from grape.tasks.dispenser.perception.wings import WING


@dataclass(frozen=True, kw_only=True)
class FeederGeometry:
    """The stack of dispensers in the `feeder` frame: origin at the centre of the lowest loop, z up, loops along y.

    Args:
        pitch_m: height of one level.
        levels: how many fit.
        wing_m: distance of a wing's centre from the loop's centre along x.
        marker_side_m: side of the feeder's markers.
        T_feeder_marker: pose of each marker id.
    """

    pitch_m: float = 0.018
    levels: int = 8
    wing_m: float = 0.020
    marker_side_m: float = 0.040
    T_feeder_marker: Mapping[int, Array] = field(
        default_factory=lambda: {
            1: pose(translation=(-0.085, -0.060, -0.030)),
            2: pose(translation=(0.085, -0.060, -0.030)),
        }
    )

    def __post_init__(self) -> None:
        if self.pitch_m <= 0 or self.levels < 1 or self.wing_m <= 0 or self.marker_side_m <= 0:
            raise InvalidInput(f"feeder sizes must be positive, got {self}")
        if not all(is_pose(T) for T in self.T_feeder_marker.values()):
            raise InvalidInput("every feeder marker needs a 4 x 4 pose")
        poses = {int(i): frozen_array(T, float) for i, T in self.T_feeder_marker.items()}
        object.__setattr__(self, "T_feeder_marker", MappingProxyType(poses))


@dataclass(frozen=True, kw_only=True)
class FeederOptions:
    """How the top dispenser is found among the red pixels over the feeder.

    Args:
        wing: colour, morphology; shape limits are not used, since wings of lower levels merge with the top ones.
        margin_m: half-extent (x, y) of the space over the feeder in which wings are looked for.
        layer_m: pixels this far below the highest ones are of the same dispenser.
        min_area_m2: surface that each wing must show, square metres facing the camera.
        max_tilt_m: largest height difference of the two wings.
        both_sides: both wings must be seen; otherwise one is enough (a finger may hide the other).
    """

    wing: BlobOptions = WING
    margin_m: tuple[float, float] = (0.040, 0.030)
    layer_m: float = 0.008
    min_area_m2: float = 1.5e-5
    max_tilt_m: float = 0.010
    both_sides: bool = True


@dataclass(frozen=True, kw_only=True)
class FeederTop:
    """The top dispenser, or why there is none.

    level counts from 0 (lowest), None when no dispenser is made out; empty says that nothing red is over the feeder;
    height_m is the height over level 0 as measured; midpoint (3,) m between the wings in the feeder frame; wings_px
    (k, 2) their centres in the image.
    """

    level: int | None
    reason: str
    empty: bool = False
    height_m: float = float("nan")
    midpoint: Array | None = None
    wings_px: Array | None = None


def feeder_top(
    image: RgbdImage,
    T_camera_feeder: Array,
    feeder: FeederGeometry | None = None,
    options: FeederOptions | None = None,
) -> FeederTop:
    """Which dispenser is on top, from the place of the highest red wings in the feeder frame.

    Args:
        image: registered colour and depth.
        T_camera_feeder: pose of the feeder frame in the optical frame, from the feeder's markers (`board_pose` with
            `feeder.T_feeder_marker`) or from the arm's kinematics.
        feeder: see `FeederGeometry`.
        options: see `FeederOptions`.

    Raises:
        InvalidInput: an image of another shape or type, or no pose.
    """
    feeder, options = feeder or FeederGeometry(), options or FeederOptions()
    pixels, points = _red_over_feeder(image, T_camera_feeder, feeder, options)
    K = as_intrinsics(image.info.K)
    if len(points) == 0:
        return FeederTop(level=None, reason="no red pixels over the feeder", empty=True)
    wings = []
    for side in (points[:, 0] < 0, points[:, 0] >= 0):  # each wing by itself: a loop may lie tilted in its channels
        heights = np.sort(points[side, 2])
        if len(heights) == 0:
            continue
        top = float(heights[-max(1, min(len(heights) // 4, 10))])  # a few stray depths do not count
        chosen = side & (points[:, 2] > top - options.layer_m)
        depth = float(np.median(pixels[chosen, 2]))
        if chosen.sum() * depth**2 / (K[0, 0] * K[1, 1]) >= options.min_area_m2:
            wings.append((np.median(points[chosen], axis=0), pixels[chosen, :2].mean(axis=0)))
    if not wings or (options.both_sides and len(wings) < 2):
        return FeederTop(level=None, reason=f"{len(wings)} of 2 wings seen on top")
    return _top_level(wings, feeder, options)


def _red_over_feeder(
    image: RgbdImage, T_camera_feeder: Array, feeder: FeederGeometry, options: FeederOptions
) -> tuple[Array, Array]:
    """Pixels (n, 3) u, v, depth and points (n, 3) in the feeder frame of what is red and over the feeder."""
    if not is_pose(T_camera_feeder):
        raise InvalidInput(f"T_camera_feeder must be a 4 x 4 pose, got {T_camera_feeder}")
    K, bgr = as_intrinsics(image.info.K), as_bgr(image.bgr)
    depth = as_depth(image.depth, bgr.shape[:2])
    mask = gated_mask(colour_mask(bgr, options.wing), depth, None, options.wing) & (depth > 0)
    v, u = np.nonzero(mask)
    z = depth[v, u].astype(np.float64)
    camera = np.column_stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z])
    points = transform(inverse(T_camera_feeder), camera)
    x_max, y_max = options.margin_m
    low, high = -0.5 * feeder.pitch_m, (feeder.levels - 0.5) * feeder.pitch_m
    inside = (np.abs(points[:, 0]) < x_max) & (np.abs(points[:, 1]) < y_max)
    inside &= (points[:, 2] > low) & (points[:, 2] < high)
    return np.column_stack([u, v, z])[inside], points[inside]


def _top_level(wings: list[tuple[Array, Array]], feeder: FeederGeometry, options: FeederOptions) -> FeederTop:
    places = np.array([place for place, _ in wings])
    if np.ptp(places[:, 2]) > options.max_tilt_m:
        return FeederTop(level=None, reason=f"the two wings differ by {np.ptp(places[:, 2]) * 1000:.0f} mm in height")
    middle = places.mean(axis=0)
    if len(wings) == 1:
        middle = middle - [np.sign(middle[0]) * feeder.wing_m, 0.0, 0.0]
    level = int(np.clip(round(middle[2] / feeder.pitch_m), 0, feeder.levels - 1))
    return FeederTop(
        level=level,
        reason="",
        height_m=float(middle[2]),
        midpoint=frozen_array(middle),
        wings_px=frozen_array([px for _, px in wings]),
    )
