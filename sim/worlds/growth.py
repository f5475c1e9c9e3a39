"""What both vine styles share: directions, wobbling branches, spurs with buds, uncut canes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grape.messages import Array
from grape.sim.worlds.model import Capsule, Color, Label, SpurTruth

WOODS: dict[Label, Color] = {
    Label.TRUNK: (0.34, 0.27, 0.21, 1.0),
    Label.ARM: (0.41, 0.31, 0.23, 1.0),
    Label.SPUR: (0.60, 0.42, 0.25, 1.0),
    Label.BUD: (0.68, 0.52, 0.37, 1.0),
    Label.CANE: (0.56, 0.40, 0.24, 1.0),
}
SPUR_LENGTH = (0.060, 0.150)
SPUR_DIAMETER = (0.007, 0.011)
UP = np.array([0.0, 0.0, 1.0])


@dataclass
class Growth:
    """The pieces of one vine while it grows, in its own frame: foot at the origin, x along the row, z up."""

    plant: str
    shade: float  # brightness of this vine's wood around 1
    capsules: list[Capsule] = field(default_factory=list)
    spurs: list[SpurTruth] = field(default_factory=list)

    def rod(self, name: str, p0: Array, p1: Array, radius: float, label: Label) -> None:
        """Adds one capsule."""
        r, g, b, a = WOODS[label]
        rgba = (min(r * self.shade, 1.0), min(g * self.shade, 1.0), min(b * self.shade, 1.0), a)
        self.capsules.append(
            Capsule(name=f"{self.plant}/{name}", p0=p0, p1=p1, radius=radius, label=label, rgba=rgba, plant=self.plant)
        )

    def branch(self, name: str, points: Array, radii: Array, label: Label) -> None:
        """Adds a chain of capsules along points (n, 3) with radii (n,)."""
        for k in range(len(points) - 1):
            self.rod(f"{name}_{k}", points[k], points[k + 1], float(radii[k] + radii[k + 1]) / 2, label)


def tilted(tilt: float, azimuth: float) -> Array:
    """(3,) unit vector `tilt` rad from vertical towards `azimuth` rad about z."""
    return np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])


def wobble(start: Array, direction: Array, length: float, pieces: int, sigma: float, rng: np.random.Generator) -> Array:
    """Points (pieces + 1, 3) of a branch whose direction walks at random by `sigma` a piece."""
    points = [np.asarray(start, dtype=float)]
    d = np.asarray(direction, dtype=float)
    for _ in range(pieces):
        d = d + rng.normal(0.0, sigma, 3)
        d = d / np.linalg.norm(d)
        points.append(points[-1] + d * (length / pieces))
    return np.array(points)


def add_spur(growth: Growth, base: Array, direction: Array, rng: np.random.Generator) -> None:
    """A knob of old wood at `base`, then last year's wood cut to a spur of two buds: 4 capsules."""
    n = len(growth.spurs)
    knob_way = 0.5 * direction + 0.5 * UP + rng.normal(0.0, 0.1, 3)
    knob = base + knob_way / np.linalg.norm(knob_way) * rng.uniform(0.015, 0.035)
    growth.rod(f"knob{n}", base, knob, rng.uniform(0.010, 0.013), Label.ARM)
    length, diameter = rng.uniform(*SPUR_LENGTH), rng.uniform(*SPUR_DIAMETER)
    tip = knob + direction * length
    growth.rod(f"spur{n}", knob, tip - direction * diameter / 2, diameter / 2, Label.SPUR)
    across = np.cross(direction, rng.normal(0.0, 1.0, 3))
    across /= np.linalg.norm(across)
    for k, share in enumerate((rng.uniform(0.2, 0.4), rng.uniform(0.65, 0.85))):
        out = across * (-1) ** k  # buds alternate by 180 degrees
        angle = np.radians(rng.uniform(30.0, 45.0))
        bark = knob + direction * length * share + out * diameter * 0.4
        point = bark + (direction * np.cos(angle) + out * np.sin(angle)) * rng.uniform(0.003, 0.006)
        growth.rod(f"bud{n}_{k}", bark, point, 0.0025, Label.BUD)
    growth.spurs.append(
        SpurTruth(
            id=f"{growth.plant}/spur{n}",
            plant=growth.plant,
            base=knob,
            tip=tip,
            direction=direction,
            diameter=diameter,
        )
    )


def add_cane(growth: Growth, base: Array, rng: np.random.Generator) -> None:
    """A thin shoot the pruner forgot, drooping: 2 capsules."""
    length = rng.uniform(0.2, 0.5)
    way = tilted(rng.uniform(0.2, 1.0), rng.uniform(0.0, 2 * np.pi))
    middle = base + way * length / 2
    end = middle + (way - np.array([0.0, 0.0, rng.uniform(0.3, 0.8)])) * length / 2
    growth.branch("cane", np.array([base, middle, end]), np.array([0.004, 0.003, 0.002]), Label.CANE)
