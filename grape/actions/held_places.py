"""Places where wheels slipped, or something held the base that no sensor shows: later drives go round them."""

from __future__ import annotations

from dataclasses import dataclass

from grape.actions.core import Context
from grape.geometry import planar_of
from grape.messages import Array
from grape.navigation.grid import Footprint
from grape.navigation.polygon import in_polygon

HELD_PLACES = "held_places"  # in world.committed
BELIEVED_S = 600.0  # then it is worth another try
NEAR_M, FAR_M, ASIDE_M = 0.05, 0.9, 0.1  # of a place, from the end of the base that was ahead; wider than the base


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldPlace:
    """Attributes: area: (4, 2) m in map. since: s."""

    area: Array
    since: float


def note_held(ctx: Context, pose: Array, footprint: Footprint, *, backward: bool) -> None:
    """Remember that the base at `pose` (3,) x y yaw in map does not get on, ahead or backward."""
    near, far, half_width = NEAR_M, FAR_M, footprint.half_width + ASIDE_M
    if backward:
        strip = Footprint(front=-footprint.rear - near, rear=footprint.rear + far, half_width=half_width)
    else:
        strip = Footprint(front=footprint.front + far, rear=-footprint.front - near, half_width=half_width)
    place = HeldPlace(area=strip.corners(pose), since=ctx.clock.now())
    ctx.world.committed[HELD_PLACES] = (*ctx.world.committed.get(HELD_PLACES, ()), place)
    ctx.log.event("held", x=float(pose[0]), y=float(pose[1]), yaw=float(pose[2]), backward=backward)


def held_areas(ctx: Context, footprint: Footprint) -> list[Array]:
    """Areas (4, 2) m in map to go round, without those that the base itself stands in."""
    places: tuple[HeldPlace, ...] = ctx.world.committed.get(HELD_PLACES, ())
    if not places or ctx.world.odometry is None:
        return []
    begun, corners = ctx.clock.now() - BELIEVED_S, footprint.corners(planar_of(ctx.world.odometry.pose))
    return [place.area for place in places if place.since > begun and not _meet(place.area, corners)]


def _meet(a: Array, b: Array) -> bool:
    """Whether a corner of one rectangle lies in the other."""
    return bool(in_polygon(a, b).any() or in_polygon(b, a).any())
