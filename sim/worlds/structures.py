"""Posts, wires, nails with their markers, and weeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.geometry import pose
from grape.messages import Array
from grape.sim.worlds.growth import tilted
from grape.sim.worlds.model import Capsule, Color, Label, NailTruth, Plate
from grape.site import Plant, Row

POST_RADIUS = 0.040
BOARD_HALF = np.array([0.125, 0.040, 0.004])  # its middle is 20 mm under the tip's height
BOARD_DROP = 0.020
MARKER_SIDE = 0.040
MARKER_MARGIN = 0.010
MARKER_OFFSET = 0.085  # to either side of the nail
MARKER_DROP = 0.030  # below the tip's height
PLATE_HALF = np.array([MARKER_SIDE / 2 + MARKER_MARGIN, MARKER_SIDE / 2 + MARKER_MARGIN, 0.001])
NAIL_LENGTH = 0.050  # what sticks out of the board
NAIL_RISE = np.radians(15.0)  # upwards, so that a loop stays
FACE = POST_RADIUS + 2 * BOARD_HALF[2]  # from the post's axis to the board's face
NAIL_REACH = float(FACE + NAIL_LENGTH * np.cos(NAIL_RISE))  # from the post's axis to the tip, horizontally
WIRE_RADIUS = 0.0015
_WOOD: Color = (0.47, 0.40, 0.31, 1.0)
_PLANK: Color = (0.55, 0.45, 0.32, 1.0)
_STEEL: Color = (0.58, 0.58, 0.60, 1.0)
_WHITE: Color = (1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class NailParts:
    """A nail, its board and its two marker plates."""

    capsule: Capsule
    plates: tuple[Plate, ...]
    truth: NailTruth


def make_post(name: str, foot: Array, height: float) -> Capsule:
    """A round wooden post standing at `foot` (3,), 0.15 m of it in the ground."""
    top = foot + np.array([0.0, 0.0, height - POST_RADIUS])
    return Capsule(name=name, p0=foot - [0.0, 0.0, 0.15], p1=top, radius=POST_RADIUS, label=Label.POST, rgba=_WOOD)


def make_nail(plant: Plant, foot: Array, rng: np.random.Generator) -> NailParts:
    """A nail plant on the post at `foot` (3,): a board on the aisle side, a nail out of it, two markers beside it."""
    out = np.array([np.cos(plant.yaw_rad), np.sin(plant.yaw_rad), 0.0])
    right = np.array([-out[1], out[0], 0.0])  # for who looks at the board
    up = np.array([0.0, 0.0, 1.0])
    face = np.column_stack([right, up, out])
    tip_height = foot + up * plant.height_m
    direction = out * np.cos(NAIL_RISE) + up * np.sin(NAIL_RISE)
    tip = tip_height + out * NAIL_REACH
    base = tip - direction * NAIL_LENGTH
    diameter = float(rng.uniform(0.005, 0.008))
    board = Plate(
        name=f"{plant.id}/board",
        T_map_plate=pose(face, tip_height + out * (FACE - BOARD_HALF[2]) - up * BOARD_DROP),
        half_size=BOARD_HALF,
        label=Label.BOARD,
        rgba=_PLANK,
        plant=plant.id,
    )
    markers = tuple(
        Plate(
            name=f"{plant.id}/marker{id}",
            T_map_plate=pose(
                face, tip_height + out * (FACE + PLATE_HALF[2]) - up * MARKER_DROP + right * sign * MARKER_OFFSET
            ),
            half_size=PLATE_HALF,
            label=Label.MARKER,
            rgba=_WHITE,
            plant=plant.id,
            marker_id=id,
        )
        for id, sign in zip(plant.markers, (-1.0, 1.0), strict=False)
    )
    nail = Capsule(
        name=f"{plant.id}/nail",
        p0=base - direction * 0.02,
        p1=tip - direction * diameter / 2,
        radius=diameter / 2,
        label=Label.NAIL,
        rgba=_STEEL,
        plant=plant.id,
    )
    truth = NailTruth(
        id=plant.id,
        base=base,
        tip=tip,
        direction=direction,
        diameter=diameter,
        markers=(plant.markers[0], plant.markers[-1]) if plant.markers else (-1, -1),
    )
    return NailParts(capsule=nail, plates=(board, *markers), truth=truth)


def make_wires(row: str, feet: Array, height: float) -> list[Capsule]:
    """A carrier wire at `height` (m) and two more 0.4 and 0.8 m above it, from post to post with feet (n, 3)."""
    wires = []
    for level, lift in enumerate((height, height + 0.4, height + 0.8)):
        for k in range(len(feet) - 1):
            p0, p1 = feet[k] + [0.0, 0.0, lift], feet[k + 1] + [0.0, 0.0, lift]
            name = f"{row}/wire{level}_{k}"
            wires.append(Capsule(name=name, p0=p0, p1=p1, radius=WIRE_RADIUS, label=Label.WIRE, rgba=_STEEL))
    return wires


def make_weeds(name: str, row: Row, density: float, rng: np.random.Generator) -> list[Capsule]:
    """Clumps of stalks along a row with z 0 at the ground; one clump in eight is tall."""
    line = row.line
    length = float(np.linalg.norm(line[-1] - line[0]))
    across = row.aisle_normal
    weeds = []
    for k in range(int(rng.poisson(density * length))):
        foot = line[0] + row.direction * rng.uniform(0.0, length) + across * rng.normal(0.0, 0.12)
        tall = rng.random() < 0.12
        height = rng.uniform(0.40, 0.65) if tall else rng.uniform(0.06, 0.28)
        green = (rng.uniform(0.25, 0.40), rng.uniform(0.42, 0.55), rng.uniform(0.12, 0.20), 1.0)
        for blade in range(int(rng.integers(4, 8))):
            p0 = np.array([*(foot + rng.normal(0.0, 0.02, 2)), -0.02])
            p1 = p0 + tilted(abs(rng.normal(0.0, 0.35)), rng.uniform(0.0, 2 * np.pi)) * height * rng.uniform(0.6, 1.0)
            weeds.append(Capsule(name=f"{name}{k}_{blade}", p0=p0, p1=p1, radius=0.002, label=Label.WEED, rgba=green))
    return weeds
