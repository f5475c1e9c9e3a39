"""Where each dispenser ended: hanging on a plant, in the feeder, on the hand, dropped, or never in play."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from grape import site_features
from grape.messages import Array
from grape.sim.areas import passes_through
from grape.sim.compose import DISPENSER
from grape.sim.dispenser import LoopReader
from grape.sim.parts import Part, PartTable
from grape.sim.physics import Physics
from grape.sim.stock import in_store
from grape.sim.worlds.model import Label, World
from grape.site import Plant

_CARRIERS = (Label.SPUR, Label.BUD, Label.NAIL, Label.CANE, Label.ARM)
_LOWEST_M = 0.2  # above the ground
_AT_REST_MPS = 0.05
_REACH_M = 0.15  # from the loop's centre to the tip it hangs on
_KNOB_M = 0.06  # below a spur's base: the old wood that it stands on, down to which a loop slides


class DispenserPlace(StrEnum):
    """Where a dispenser is."""

    PLANT = "plant"
    FEEDER = site_features.FEEDER
    HAND = site_features.HAND
    DROPPED = site_features.DROPPED
    STOCK = site_features.STOCK  # not in play yet


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where one dispenser is.

    Attributes:
        plant, offset_mm: which one it hangs on, and how far from the tip, where it hangs on one.
        level: in the feeder, 0 is the lowest.
    """

    where: DispenserPlace
    plant: str | None = None
    offset_mm: float = 0.0
    level: int | None = None


def census(places: Iterable[Place]) -> dict[str, int]:
    """How many dispensers are where: feeder, hand, dropped, and the id of each plant on which one hangs."""
    found = {str(where): 0 for where in DispenserPlace if where is not DispenserPlace.PLANT}
    for place in places:
        name = place.plant or str(place.where)
        found[name] = found.get(name, 0) + 1
    return dict(sorted(found.items()))


@dataclass(frozen=True, kw_only=True)
class _Carrier:
    plant: str
    base: Array
    tip: Array


def _axis(base: Array, tip: Array) -> Array:
    """(3,) unit vector from base to tip."""
    return (tip - base) / np.linalg.norm(tip - base)


class HangingJudge:
    """Judges where the dispensers of a scene are.

    Args:
        pitch_m: height of one level of the feeder.
    """

    def __init__(self, physics: Physics, world: World, parts: PartTable, pitch_m: float) -> None:
        self._physics = physics
        self._parts = parts
        self._pitch_m = pitch_m
        self._terrain = world.terrain
        self.plants: tuple[Plant, ...] = world.site.plants
        self._carriers = tuple(
            [
                _Carrier(plant=spur.plant, base=spur.base - _KNOB_M * _axis(spur.base, spur.tip), tip=spur.tip)
                for spur in world.spurs
            ]
            + [_Carrier(plant=nail.id, base=nail.base, tip=nail.tip) for nail in world.nails]
        )
        self._arms = tuple(
            _Carrier(plant=rod.plant, base=rod.p0, tip=rod.p1) for rod in world.capsules if rod.label is Label.ARM
        )
        names = [physics.model.body(k).name for k in range(physics.model.nbody)]
        count = sum(name.startswith(DISPENSER) and name.removeprefix(DISPENSER).isdigit() for name in names)
        self._loops = [LoopReader.of(physics.model, f"{DISPENSER}{k}") for k in range(count)]

    def places(self) -> tuple[Place, ...]:
        """Where every dispenser is now, in the order of their names."""
        return tuple(self._place(loop) for loop in self._loops)

    def _place(self, loop: LoopReader) -> Place:
        line = loop.polyline(self._physics.data)
        if in_store(float(line[0, 2])):
            return Place(where=DispenserPlace.STOCK)
        touched = self._touched_geoms(loop)
        kinds = {Part(int(self._parts.kinds[geom])) for geom in touched}
        if kinds & {Part.NAIL, Part.FINGER, Part.ARM}:
            return Place(where=DispenserPlace.HAND)
        if Part.BODY in kinds:
            return self._loose(line)
        carrier = self._carrier(line, touched)
        if carrier is None or Part.WHEEL in kinds or not self._hangs_still(loop, line):
            return self._loose(line)
        offset = np.linalg.norm(line[:-1].mean(axis=0)[:2] - carrier.tip[:2])
        return Place(where=DispenserPlace.PLANT, plant=carrier.plant, offset_mm=1000.0 * float(offset))

    def _touched_geoms(self, loop: LoopReader) -> set[int]:
        pairs = self._physics.data.contact.geom
        own = np.isin(self._physics.model.geom_bodyid[pairs], list(loop.subtree))
        return {int(geom) for geom in pairs[own[:, ::-1] & ~own]}

    def _carrier(self, line: Array, touched: set[int]) -> _Carrier | None:
        """What goes through the loop, spur or nail before arm; else the nearest tip of the plant that the loop touches.

        A loop that has slid from its spur down an arm, into the fork for instance, comes off over the spur's tip alone.
        """
        centre = line.mean(axis=0)

        def nearest(carriers: tuple[_Carrier, ...]) -> list[_Carrier]:
            return sorted(carriers, key=lambda carrier: float(np.linalg.norm(carrier.tip - centre)))

        near = nearest(self._carriers)
        for carrier in (*near[:12], *nearest(self._arms)[:12]):
            if passes_through(line, carrier.base, carrier.tip):
                return carrier
        plants = {self._parts.plants[geom] for geom in touched if self._parts.labels[geom] in _CARRIERS}
        return next((c for c in near if c.plant in plants and np.linalg.norm(c.tip - centre) < _REACH_M), None)

    def _hangs_still(self, loop: LoopReader, line: Array) -> bool:
        ground = float(np.max(self._terrain.height(line[:, :2])))
        speed = np.linalg.norm(self._physics.data.cvel[list(loop.subtree), 3:], axis=1)
        return bool(line[:, 2].min() > ground + _LOWEST_M and np.median(speed) < _AT_REST_MPS)

    def _loose(self, line: Array) -> Place:
        """In the feeder when the loop's centre is inside the stack, else dropped."""
        feeder = self._physics.data.body("feeder")
        local = feeder.xmat.reshape(3, 3).T @ (line.mean(axis=0) - feeder.xpos)
        if abs(local[0]) < 0.05 and abs(local[1]) < 0.06 and -0.03 < local[2] < 0.25:
            return Place(where=DispenserPlace.FEEDER, level=max(0, round(local[2] / self._pitch_m)))
        return Place(where=DispenserPlace.DROPPED)
