"""From options to a vineyard: first the site as a surveyor would draw it, then everything that stands on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from grape.geodesy import Datum
from grape.messages import Array
from grape.sim.worlds.growth import Growth
from grape.sim.worlds.model import Capsule, NailTruth, Plate, SpurTruth, Terrain, World
from grape.sim.worlds.options import FIRST_MARKER_ID, VineyardOptions, post_stations
from grape.sim.worlds.structures import NAIL_REACH, make_nail, make_post, make_weeds, make_wires
from grape.sim.worlds.terrain import add_mud, make_sun, make_terrain
from grape.sim.worlds.vines import cordon_height, grow_cordon, grow_gobelet
from grape.site import Area, Plant, RefillPoint, Row, Side, Site

FENCE_HALF_WIDTH = 0.28
HEADLAND_DEPTH = 5.5
START = (-3.0, -1.3)
REFILL = (-4.4, -0.955)  # in the headland, facing the first lane: the robot leaves it straight ahead
POST_CLEARANCE = 0.09  # vine wood keeps this far from a post's axis, along the row
NAIL_CLEARANCE = 0.20


def generate_vineyard(options: VineyardOptions) -> World:
    """The vineyard of the options: the same options give the same world, to the bit."""
    return grow_world(vineyard_site(options), options)


def vineyard_site(options: VineyardOptions) -> Site:
    """Rows along map x at y = 0, spacing, ...; the first vine at x = 0; the start before the first row."""
    posts = post_stations(options)
    rows, plants, fences = [], [], []
    marker = FIRST_MARKER_ID
    for r in range(options.rows):
        id, y = f"r{r}", r * options.row_spacing
        side: Side = "right" if r % 2 == 0 else "left"
        row = Row(id=id, side=side, line=np.array([[posts[0], y], [posts[-1], y]]))
        rows.append(row)
        plants += [
            Plant(id=f"{id}v{v}", row=id, kind="vine", side=side, position=np.array([v * options.vine_spacing, y]))
            for v in range(options.vines_per_row)
        ]
        for n, x in enumerate(_nail_stations(posts, options.nails_per_row)):
            plants.append(_nail(f"{id}n{n}", row, np.array([x, y]), marker, options.nail_height))
            marker += 2
        low, high = row.line[0] - FENCE_HALF_WIDTH, row.line[-1] + FENCE_HALF_WIDTH
        fences.append(Area(id=f"{id}_fence", polygon=_box(low, high)))
    low_y, high_y = -0.5 * options.row_spacing - 1.0, (options.rows - 0.5) * options.row_spacing + 1.0
    west = _box(np.array([posts[0] - HEADLAND_DEPTH, low_y]), np.array([posts[0] - FENCE_HALF_WIDTH, high_y]))
    east = _box(np.array([posts[-1] + FENCE_HALF_WIDTH, low_y]), np.array([posts[-1] + HEADLAND_DEPTH, high_y]))
    return Site(
        datum=Datum(
            latitude_deg=options.datum_latitude,
            longitude_deg=options.datum_longitude,
            altitude_m=options.datum_altitude,
        ),
        rows=tuple(rows),
        plants=tuple(plants),
        headlands=(Area(id="headland_west", polygon=west), Area(id="headland_east", polygon=east)),
        fences=tuple(fences),
        start=np.array(START),
        start_heading_rad=0.0,
        refills=(RefillPoint(id="refill", position=np.array(REFILL), yaw_rad=0.0),),
    )


def _nail_stations(posts: list[float], count: int) -> list[float]:
    """x of the posts that carry nails, inner posts first, then the far end, then the near end; in order of x."""
    return sorted([*posts[1:-1], posts[-1], posts[0]][:count])


def _nail(id: str, row: Row, position: Array, marker: int, height: float) -> Plant:
    normal = row.aisle_normal
    return Plant(
        id=id,
        row=row.id,
        kind="nail",
        side=row.side,
        position=position,
        markers=(marker, marker + 1),
        height_m=height,
        yaw_rad=float(np.arctan2(normal[1], normal[0])),
        reach_m=NAIL_REACH,
    )


def _box(low: Array, high: Array) -> Array:
    return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])


def grow_world(site: Site, options: VineyardOptions) -> World:
    """Everything that stands on a site: vines at its plants, posts along its rows, nails, wires, weeds, ground, sun.

    Args:
        site: from `vineyard_site`, or surveyed by a user; its rows, plants and datum win over those of the options.
        options: style, terrain, posts, weeds, sun and seed.
    """
    ground, plants, green, wet = np.random.default_rng(options.seed).spawn(4)
    terrain = add_mud(make_terrain(site, options, ground), site, options, wet)
    capsules: list[Capsule] = []
    plates: list[Plate] = []
    spurs: list[SpurTruth] = []
    nails: list[NailTruth] = []
    for row in site.rows:
        height = cordon_height(plants)
        posts = _row_posts(row, site, options)
        feet = _on_ground(terrain, np.array([row.line[0] + row.direction * s for s in posts]))
        capsules += [make_post(f"{row.id}/post{k}", foot, options.post_height) for k, foot in enumerate(feet)]
        if options.style == "cordon":
            capsules += make_wires(row.id, feet, height)
        for plant in (p for p in site.plants if p.row == row.id):
            foot = _on_ground(terrain, plant.position)
            if plant.kind == "nail":
                parts = make_nail(plant, foot, plants)
                capsules.append(parts.capsule)
                plates += parts.plates
                nails.append(parts.truth)
                continue
            growth = _grow(plant, height, _reach(plant, row, posts, site), options, plants)
            rods, truths = _stand(growth, foot, row)
            capsules += rods
            spurs += truths
        weeds = make_weeds(f"{row.id}/weed", row, options.weeds, green)
        capsules += [_moved(weed, np.eye(3), [0.0, 0.0, float(terrain.height(weed.p0[:2]))]) for weed in weeds]
    return World(
        site=site,
        terrain=terrain,
        sun=make_sun(options),
        capsules=tuple(capsules),
        plates=tuple(plates),
        spurs=tuple(spurs),
        nails=tuple(nails),
        walkers=options.walkers,
    )


def _row_posts(row: Row, site: Site, options: VineyardOptions) -> list[float]:
    """Stations (m from the row's first point) of its posts: the ends, every `post_spacing`, and one at every nail."""
    length = float(np.linalg.norm(row.line[-1] - row.line[0]))
    step = max(1, round(options.post_spacing / options.vine_spacing)) * options.vine_spacing
    regular = [*np.arange(0.0, length - 0.5 * options.vine_spacing, step), length]
    nails = [_station(p.position, row) for p in site.plants if p.row == row.id and p.kind == "nail"]
    kept = [s for s in regular if all(abs(s - n) > 0.3 for n in nails)]
    return sorted([*(float(s) for s in kept), *nails])


def _station(position: Array, row: Row) -> float:
    return float((position - row.line[0]) @ row.direction)


def _reach(plant: Plant, row: Row, posts: Iterable[float], site: Site) -> tuple[float, float]:
    """How far wood may go from a vine along -x and +x of the row before it comes too near to a post (m)."""
    here = _station(plant.position, row)
    nails = {_station(p.position, row) for p in site.plants if p.row == row.id and p.kind == "nail"}
    behind, ahead = 10.0, 10.0
    for post in posts:
        gap = abs(post - here) - (NAIL_CLEARANCE if post in nails else POST_CLEARANCE)
        if post < here:
            behind = min(behind, gap)
        else:
            ahead = min(ahead, gap)
    return max(behind, 0.1), max(ahead, 0.1)


def _grow(
    plant: Plant,
    height: float,
    reach: tuple[float, float],
    options: VineyardOptions,
    rng: np.random.Generator,
) -> Growth:
    if options.style == "cordon":
        return grow_cordon(plant.id, height, reach, options.uncut_canes, rng)
    return grow_gobelet(plant.id, options.uncut_canes, rng)


def _stand(growth: Growth, foot: Array, row: Row) -> tuple[list[Capsule], list[SpurTruth]]:
    """The vine turned along its row and put on its foot (3,) in the map frame."""
    x, y = row.direction
    R = np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
    spurs = [replace(s, base=R @ s.base + foot, tip=R @ s.tip + foot, direction=R @ s.direction) for s in growth.spurs]
    return [_moved(capsule, R, foot) for capsule in growth.capsules], spurs


def _moved(capsule: Capsule, R: Array, shift: Array | list[float]) -> Capsule:
    return replace(capsule, p0=R @ capsule.p0 + shift, p1=R @ capsule.p1 + shift)


def _on_ground(terrain: Terrain, xy: Array) -> Array:
    """Points (..., 3) on the ground at (..., 2)."""
    return np.concatenate([xy, terrain.height(xy)[..., None]], axis=-1)
