"""A map for localisation out of a surveyed site, and what of a laser scan can be on it: trunks and posts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grape.errors import InvalidInput
from grape.mapping.occupancy import FREE, OCCUPIED, OccupancyGrid
from grape.messages import LaserScan
from grape.navigation.grid import GridSpec
from grape.site import Site


def map_of_site(site: Site, resolution: float = 0.05, margin: float = 5.0) -> OccupancyGrid:
    """The site's plants as occupied cells, everything else free, in the site's map frame.

    What the site does not list, such as posts without a nail, is missing: AMCL takes it for clutter.

    Args:
        margin: m of free ground around plants, start and headlands.

    Raises:
        InvalidInput: the site has no plants.
    """
    if not site.plants:
        raise InvalidInput("a site without plants gives no map to localise in")
    places = np.array([plant.position for plant in site.plants])
    around = [places, *(area.polygon for area in site.headlands), *(row.line for row in site.rows), site.start[None]]
    spec = GridSpec.around(np.vstack(around), margin, resolution)
    occupancy = np.full((spec.rows, spec.columns), FREE, np.int8)
    occupancy[tuple(spec.cells(places).T)] = OCCUPIED
    return OccupancyGrid(spec=spec, occupancy=occupancy)


def plants_in_scan(scan: LaserScan, width: float = 0.25, gap: float = 0.2, radius: float = 0.04) -> LaserScan:
    """A scan of narrow things alone, as far as their middles; everything else counts as no return.

    Ground, which a tilted scanner sees as bands, walls and robots are wider than trunks and posts.

    Args:
        width: m, of the widest thing that is kept.
        gap: m, by which the ranges of neighbouring beams differ where one thing ends and another begins.
        radius: m, of trunks: a laser sees their bark, a map has their middles.
    """
    angles = scan.angle_min + scan.angle_increment * np.arange(scan.ranges.size)
    seen = np.isfinite(scan.ranges) & (scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max)
    ranges = np.where(seen, scan.ranges, 0.0)
    ends = ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    begins = np.ones(ranges.size, bool)
    begins[1:] = ~(seen[1:] & seen[:-1] & (np.abs(np.diff(ranges)) < gap))
    first = np.flatnonzero(begins)
    last = np.append(first[1:], ranges.size) - 1
    narrow = np.hypot(*(ends[last] - ends[first]).T) <= width
    kept = seen & narrow[np.cumsum(begins) - 1]
    return replace(scan, ranges=np.where(kept, ranges + radius, np.inf))
