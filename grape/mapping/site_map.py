"""A map for localisation out of a surveyed site: a cell where each trunk and each post with a nail stands."""

from __future__ import annotations

import numpy as np

from grape.errors import InvalidInput
from grape.mapping.occupancy import FREE, OCCUPIED, OccupancyGrid
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
