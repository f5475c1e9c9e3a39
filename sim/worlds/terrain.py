"""The ground: a slope, correlated roughness, a smooth patch where the robot starts, and mud; and the sun."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grape.messages import Array
from grape.sim.worlds.model import Sun, Terrain
from grape.sim.worlds.options import VineyardOptions
from grape.site import Site

MARGIN_ALONG_M = 6.0  # of ground beyond the row ends
MARGIN_ACROSS_M = 4.0
SMOOTH_RADIUS_M = 1.2  # no roughness this near to the start, full roughness at twice the distance
GLOSS_RAD = np.radians(12.0)  # of semi-gloss photo paper in the sun


def make_terrain(site: Site, options: VineyardOptions, rng: np.random.Generator) -> Terrain:
    """The height field under a site; z is 0 at the map origin, rises by `slope` along map x and is rough around that.

    Roughness is white noise under a Gaussian filter, scaled to the RMS asked for: its autocorrelation
    exp(-d^2 / (4 sigma^2)) falls to 1/e at d = 2 sigma.
    """
    from scipy.ndimage import gaussian_filter

    corners = np.concatenate([row.line for row in site.rows] + [a.polygon for a in site.headlands] + [site.start[None]])
    low = np.minimum(corners.min(axis=0), site.start - 3.0)
    high = np.maximum(corners.max(axis=0), site.start + 3.0)
    rows = np.concatenate([row.line for row in site.rows])
    margin = np.array([MARGIN_ALONG_M, MARGIN_ACROSS_M])
    low = np.minimum(low, rows.min(axis=0) - margin)
    high = np.maximum(high, rows.max(axis=0) + margin)
    nx, ny = (int(np.ceil(n)) + 1 for n in (high - low) / options.terrain_resolution)
    x, y = np.linspace(low[0], high[0], nx), np.linspace(low[1], high[1], ny)
    noise = gaussian_filter(
        rng.standard_normal((ny, nx)), options.roughness_correlation / 2 / options.terrain_resolution, mode="wrap"
    )
    noise -= noise.mean()
    noise *= options.roughness_rms / noise.std()
    X, Y = np.meshgrid(x, y)
    distance = np.hypot(X - site.start[0], Y - site.start[1])
    blend = np.clip(distance / SMOOTH_RADIUS_M - 1.0, 0.0, 1.0)
    heights = options.slope * X + blend * noise
    heights.flags.writeable = False
    return Terrain(
        heights=heights,
        x_range=(float(low[0]), float(high[0])),
        y_range=(float(low[1]), float(high[1])),
        slope=options.slope,
    )


def add_mud(terrain: Terrain, site: Site, options: VineyardOptions, rng: np.random.Generator) -> Terrain:
    """The ground with round patches of mud, even over it; those that come nearer than 1.2 m to the start are left out.

    Heights stay those of the dry ground: a patch changes nothing but the friction of the wheels in it.
    """
    low, high = (np.array(ends) for ends in zip(terrain.x_range, terrain.y_range, strict=True))
    places = rng.uniform(low, high, (options.mud, 2))
    radii = options.mud_radius * rng.uniform(0.6, 1.4, options.mud)
    clear = np.hypot(*(places - site.start).T) > radii + SMOOTH_RADIUS_M
    mud = np.column_stack([places, radii])[clear]
    mud.flags.writeable = False
    return replace(terrain, mud=mud, mud_friction=options.mud_friction)


# azimuth and elevation (deg), diffuse and ambient colour, sky at the zenith and at the horizon
_SUNS: dict[str, tuple[float, float, tuple, tuple, tuple, tuple]] = {
    "noon": (170.0, 62.0, (0.75, 0.74, 0.70), (0.28, 0.29, 0.32), (0.36, 0.56, 0.82), (0.80, 0.87, 0.93)),
    "low": (255.0, 15.0, (0.95, 0.62, 0.32), (0.20, 0.19, 0.24), (0.40, 0.43, 0.55), (0.70, 0.58, 0.48)),
    "overcast": (170.0, 80.0, (0.30, 0.30, 0.31), (0.50, 0.50, 0.52), (0.66, 0.68, 0.71), (0.82, 0.83, 0.84)),
}


def make_sun(options: VineyardOptions) -> Sun:
    """The light of a preset, with azimuth, elevation and strength of their own where given."""
    azimuth, elevation, diffuse, ambient, zenith, horizon = _SUNS[options.sun]
    azimuth = np.radians(azimuth if options.sun_azimuth is None else options.sun_azimuth)
    elevation = np.radians(elevation if options.sun_elevation is None else options.sun_elevation)
    towards: Array = np.array(
        [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    r, g, b = (min(c * options.sun_strength, 1.0) for c in diffuse)
    direct = 0.0 if options.sun == "overcast" else 1.0
    return Sun(
        direction=-towards,
        diffuse=(r, g, b),
        ambient=ambient,
        sky_top=zenith,
        sky_horizon=horizon,
        gloss_rad=direct * options.glare * GLOSS_RAD,
    )
