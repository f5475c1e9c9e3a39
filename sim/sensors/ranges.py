"""Range noise and limits of a laser scanner.

Source: facts sheet, section 3; REP-117 for what lies outside the limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class RangeModel:
    """White noise, systematic error and limits of a range sensor, all in metres."""

    range_min: float
    range_max: float
    sigma: float
    systematic: float = 0.0  # standard deviation of an error that stays (half of it) or wanders slowly (the other half)


def measured_ranges(true: Array, bias: float, model: RangeModel, rng: np.random.Generator) -> Array:
    """Ranges (n,) as the sensor tells them: +inf no return, -inf nearer than it can see.

    Args:
        true: distances (n,) in metres, +inf where the beam hits nothing.
        bias: systematic error at this moment, m.
    """
    measured = true + bias + model.sigma * rng.standard_normal(true.shape)
    measured = np.where(true > model.range_max, np.inf, measured)
    return np.where(true < model.range_min, -np.inf, measured)


@dataclass(frozen=True, kw_only=True)
class BeamSpot:
    """How wide a beam is: diameter where it leaves the sensor (m), divergence across and along the scan plane (rad).

    Source: the perception study (TiM561).
    """

    diameter: float = 0.007
    divergence: tuple[float, float] = (0.0086, 0.0144)


_SPOT_ANGLES = np.arange(6) * np.pi / 3
_SPOT_OFFSETS = np.vstack([[0.0, 0.0], 0.72 * np.stack([np.cos(_SPOT_ANGLES), np.sin(_SPOT_ANGLES)], axis=1)])  # (7, 2)
_SPOT_WEIGHTS = np.array([0.22] + [0.13] * 6)
_ECHO_DEPTH_M = 0.25  # echoes nearer to each other merge into one
_ECHO_ENERGY = 0.20  # share of the beam that an echo needs


def spot_rays(origin: Array, directions: Array, axis: Array, spot: BeamSpot) -> tuple[Array, Array]:
    """Origins and unit directions (n, 7, 3) of the rays that stand for each beam's spot.

    Args:
        origin: (3,) of the sensor.
        directions: (n, 3) unit vectors of the beams.
        axis: (3,) unit normal of the scan plane.
    """
    along = np.cross(axis, directions)  # (n, 3), in the scan plane
    across, within = _SPOT_OFFSETS[:, 0], _SPOT_OFFSETS[:, 1]
    spread = across[None, :, None] * axis + within[None, :, None] * along[:, None, :]  # (n, 7, 3)
    widened = (
        across[None, :, None] * axis * spot.divergence[0]
        + within[None, :, None] * along[:, None, :] * spot.divergence[1]
    )
    rays = directions[:, None, :] + 0.5 * widened
    return origin + 0.5 * spot.diameter * spread, rays / np.linalg.norm(rays, axis=2, keepdims=True)


def spot_ranges(distances: Array) -> Array:
    """One range (n,) for each beam of the distances (n, 7) of its rays: mixed pixels and lost thin things included.

    The first echo that carries enough of the beam's energy counts; echoes close behind each other are averaged.
    """
    ranges = np.full(len(distances), np.inf)
    left = np.isfinite(distances)
    for _ in range(2):
        near = np.where(left, distances, np.inf)
        first = near.min(axis=1)
        group = left & (near < first[:, None] + _ECHO_DEPTH_M)
        energy = group @ _SPOT_WEIGHTS
        found = ~np.isfinite(ranges) & (energy >= _ECHO_ENERGY)
        mean = (np.where(group, distances, 0.0) @ _SPOT_WEIGHTS) / np.maximum(energy, 1e-9)
        ranges[found] = mean[found]
        left &= ~group
    return ranges
