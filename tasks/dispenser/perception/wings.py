"""What the red wings of a dispenser tell: it is held by the nails, it hangs on the vine.

All decisions look at one registered colour and depth image. Places are in the camera's optical frame (x right, y down,
z forward) unless said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, RgbdImage, frozen_array
from grape.perception.blobs import Blob, BlobOptions, find_blobs
from grape.perception.checks import as_intrinsics, as_vector

# Hue 175...5 and 60...2500 px at f = 615 as studied. Value 35: under a low sun the shaded side of a wing has 43. Shape
# limits looser than the study's 0.80 and 0.12: a nail before a wing leaves 0.84 and 0.38; depth and place decide.
WING = BlobOptions(value=35, solidity=0.75, hull_distance=0.45)

# A wing seen from its edge, or all but a strip of it hidden: so few pixels of any shape that only vivid red counts.
EDGE_ON = BlobOptions(
    saturation=150, value=60, open_px=2, area_px=(25.0, 2500.0), solidity=0.0, hull_distance=float("inf")
)


@dataclass(frozen=True, kw_only=True)
class Check:
    """A yes-or-no decision with its evidence: the blobs that decided it and, when it is no, why."""

    value: bool
    reason: str
    blobs: tuple[Blob, ...] = ()

    @property
    def ballot(self) -> tuple[bool, str]:
        """Decision and reason, as a vote over frames counts them."""
        return self.value, self.reason


@dataclass(frozen=True, kw_only=True)
class HeldOptions:
    """Where the wings of a held dispenser appear.

    Args:
        wing: colour, morphology and shape of a wing.
        depth_m: (near, far) of the wings.
        window: (left, top, right, bottom) of the image part in front of the nails, as x/z and y/z.
        separation_m: (smallest, largest) distance of the two wings.
        depth_step_m: largest difference of their depths.
    """

    wing: BlobOptions = WING
    depth_m: tuple[float, float] = (0.20, 0.27)
    window: tuple[float, float, float, float] = (-0.26, -0.146, 0.26, 0.375)
    separation_m: tuple[float, float] = (0.022, 0.095)
    depth_step_m: float = 0.020


def held(image: RgbdImage, options: HeldOptions | None = None) -> Check:
    """Whether the nails hold a dispenser: two wings of similar depth, near, in the central window.

    Left-over dispensers in the feeder and everything behind are beyond the depth gate.

    Raises:
        InvalidInput: an image of another shape or type.
    """
    options = options or HeldOptions()
    K = as_intrinsics(image.info.K)
    left, top, right, bottom = options.window
    roi = (
        K[0, 2] + left * K[0, 0], K[1, 2] + top * K[1, 1],
        K[0, 2] + right * K[0, 0], K[1, 2] + bottom * K[1, 1],
    )  # fmt: skip
    blobs = find_blobs(image, options.wing, depth_range=options.depth_m, roi=roi)
    if len(blobs) != 2:
        return Check(value=False, reason=f"{len(blobs)} wings seen, 2 needed", blobs=blobs)
    a, b = blobs
    apart = float(np.linalg.norm(a.position - b.position))
    if abs(a.depth_m - b.depth_m) > options.depth_step_m:
        return Check(value=False, reason=f"wing depths {a.depth_m:.3f} and {b.depth_m:.3f} m differ", blobs=blobs)
    if not options.separation_m[0] <= apart <= options.separation_m[1]:
        return Check(value=False, reason=f"the wings are {apart * 1000:.0f} mm apart", blobs=blobs)
    return Check(value=True, reason="", blobs=blobs)


@dataclass(frozen=True, kw_only=True)
class HungExpectation:
    """Where a hung dispenser should be, and where the nails are, by the arm's kinematics, in the optical frame.

    Args:
        target: (3,) m, the spur or nail tip that the dispenser was put on; None takes the whole image.
        radius_m: wings farther from the target do not count; the loop hangs up to 80 mm below its tip, the arm errs
            by up to 50 mm.
        nails: (3,) m, mid-point between the hand's nails; None leaves the exclusion out.
        nails_radius_m: wings this near to it are of a dispenser that is still on a nail.
    """

    target: Array | None = None
    radius_m: float = 0.15
    nails: Array | None = None
    nails_radius_m: float = 0.085

    def __post_init__(self) -> None:
        for name in ("target", "nails"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, frozen_array(as_vector(value, 3, name)))
        if self.radius_m <= 0 or self.nails_radius_m <= 0:
            raise InvalidInput(f"radii must be positive, got {self.radius_m} and {self.nails_radius_m}")


@dataclass(frozen=True, kw_only=True)
class HungOptions:
    """Which wings count as a hung dispenser's: colour and shape, depth (near, far) m, and how many are needed.

    `edge_on` is asked where `wing` finds fewer; None asks nothing else.
    """

    wing: BlobOptions = WING
    edge_on: BlobOptions | None = EDGE_ON
    depth_m: tuple[float, float] = (0.20, 0.55)
    wings: int = 1


def hung(image: RgbdImage, expectation: HungExpectation | None = None, options: HungOptions | None = None) -> Check:
    """Whether a dispenser hangs where it was put: a wing in the depth gate, near the target and away from the nails.

    Raises:
        InvalidInput: an image of another shape or type.
    """
    expectation, options = expectation or HungExpectation(), options or HungOptions()
    blobs = find_blobs(image, options.wing, depth_range=options.depth_m)
    if len(blobs) < options.wings and options.edge_on is not None:
        blobs = find_blobs(image, options.edge_on, depth_range=options.depth_m)
    if expectation.nails is not None:
        on_nails = [b for b in blobs if np.linalg.norm(b.position - expectation.nails) < expectation.nails_radius_m]
        if on_nails:
            return Check(value=False, reason="a wing is still at the nails", blobs=tuple(on_nails))
    if expectation.target is not None:
        blobs = tuple(b for b in blobs if np.linalg.norm(b.position - expectation.target) <= expectation.radius_m)
    if len(blobs) < options.wings:
        return Check(value=False, reason=f"{len(blobs)} wings at the target, {options.wings} needed", blobs=blobs)
    return Check(value=True, reason="", blobs=blobs)
