"""A place where a dispenser can be hung, and the score that orders such places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, frozen_array
from grape.perception.checks import as_unit, as_vector


@dataclass(frozen=True, kw_only=True)
class DeploymentPose:
    """One spur, in the frame of the cloud it was found in.

    tip and base (3,) m; direction (3,) unit vector from base to tip; diameter_m and length_m as measured (the length is
    rough, trust the tip); score in 0...1 is the product of `factors`; frames is how many views found it.
    """

    tip: Array
    base: Array
    direction: Array
    diameter_m: float
    length_m: float
    score: float
    factors: Mapping[str, float]
    frames: int = 1

    def __post_init__(self) -> None:
        for name in ("tip", "base"):
            object.__setattr__(self, name, frozen_array(as_vector(getattr(self, name), 3, name)))
        object.__setattr__(self, "direction", frozen_array(as_unit(self.direction, "direction")))
        object.__setattr__(self, "factors", MappingProxyType(dict(self.factors)))

    def tilt(self, up: Array) -> float:
        """Angle (rad) between the spur and `up` (3,), a unit vector against gravity."""
        return float(np.arccos(np.clip(self.direction @ up, -1.0, 1.0)))


@dataclass(frozen=True, kw_only=True)
class ScoreOptions:
    """Soft gates: each gives 1 inside, falls linearly over its ramp, and has a floor that it does not fall below.

    Args:
        length_m: (0 below, 1 above) and (1 below, `length_floor` above): stubs and canes.
        tilt_deg: full up to the first, 0 from the second.
        diameter_m: rising and falling ramp.
        free: points beyond the tip, relative to the spur's own, that are tolerated, and that make the end not free.
        corridor: the same for the hand's way to the tip (a cylinder of `corridor_radius_m` along the approach).
        crowd: the same for neighbours beside the upper spur.
        wider: thickness of what the spur stands on relative to its own, where it counts nothing and fully (weeds and
            lone sticks stand on nothing).
        behind_m: how far behind the cloud's middle, seen from the robot, a spur starts and ends losing.
        height_m: rising and falling ramp of the tip's height along `up`; None does not look at it.
        pitch_deg: pitch of the hand's approach above the horizontal.
    """

    length_m: tuple[float, float, float, float] = (0.035, 0.075, 0.17, 0.21)
    length_floor: float = 0.4
    tilt_deg: tuple[float, float] = (40.0, 65.0)
    diameter_m: tuple[float, float, float, float] = (0.0045, 0.0065, 0.0135, 0.019)
    free: tuple[float, float] = (0.02, 0.25)
    corridor: tuple[float, float] = (0.1, 1.0)
    corridor_floor: float = 0.4
    corridor_radius_m: float = 0.040
    crowd: tuple[float, float] = (0.2, 1.5)
    crowd_floor: float = 0.5
    wider: tuple[float, float] = (1.0, 1.8)
    wider_floor: float = 0.25
    behind_m: tuple[float, float] = (0.05, 0.25)
    behind_floor: float = 0.7
    height_m: tuple[float, float, float, float] | None = None
    pitch_deg: float = 50.0

    def __post_init__(self) -> None:
        for name in (
            "length_m",
            "tilt_deg",
            "diameter_m",
            "free",
            "corridor",
            "crowd",
            "wider",
            "behind_m",
            "height_m",
        ):
            ramp = getattr(self, name)
            if ramp is not None and not all(a < b for a, b in zip(ramp[::2], ramp[1::2], strict=True)):
                raise InvalidInput(f"{name} must rise in each ramp, got {ramp}")


@dataclass(frozen=True, kw_only=True)
class SpurMeasure:
    """What the cloud shows of one spur. Counts are points; thickness_m is of what the spur stands on."""

    tip: Array
    base: Array
    direction: Array
    diameter_m: float
    own: int
    beyond: int
    below: int
    beside: int
    corridor: int
    thickness_m: float
    behind_m: float

    @property
    def length_m(self) -> float:
        """Distance of tip and base."""
        return float(np.linalg.norm(self.tip - self.base))


def ramp(value: float, low: float, high: float) -> float:
    """0 up to `low`, 1 from `high`, linear between."""
    return float(np.clip((value - low) / (high - low), 0.0, 1.0))


def _fall(value: float, limits: tuple[float, float], floor: float = 0.0) -> float:
    return 1.0 - (1.0 - floor) * ramp(value, *limits)


def score_factors(spur: SpurMeasure, up: Array, reach: float, options: ScoreOptions) -> dict[str, float]:
    """The gates of a spur by name, each 0...1; their product is its score.

    Args:
        spur: see `SpurMeasure`.
        up: (3,) unit vector against gravity.
        reach: 0...1, how well the arm reaches the tip.
        options: see `ScoreOptions`.
    """
    own = max(spur.own, 20)
    tilt = float(np.degrees(np.arccos(np.clip(spur.direction @ up, -1.0, 1.0))))
    length, diameter = options.length_m, options.diameter_m
    factors = {
        "length": ramp(spur.length_m, *length[:2]) * _fall(spur.length_m, length[2:], options.length_floor),
        "tilt": _fall(tilt, options.tilt_deg),
        "diameter": ramp(spur.diameter_m, *diameter[:2]) * _fall(spur.diameter_m, diameter[2:]),
        "free_end": _fall(spur.beyond / own, options.free),
        "corridor": _fall(spur.corridor / own, options.corridor, options.corridor_floor),
        "crowd": _fall(spur.beside / own, options.crowd, options.crowd_floor),
        "attached": 0.4 + 0.6 * ramp(spur.below, 2, 12),
        "stands_on": options.wider_floor
        + (1 - options.wider_floor) * ramp(spur.thickness_m / max(spur.diameter_m, 0.003), *options.wider),
        "near_side": _fall(spur.behind_m, options.behind_m, options.behind_floor),
        "points": ramp(spur.own, 8, 25),
        "reach": float(np.clip(reach, 0.0, 1.0)),
    }
    if options.height_m is not None:
        height = float(spur.tip @ up)
        factors["height"] = ramp(height, *options.height_m[:2]) * _fall(height, options.height_m[2:])
    return factors
