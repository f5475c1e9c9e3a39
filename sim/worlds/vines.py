"""Two ways to prune a vine: the cordon of Tuscany and the gobelet of Catalonia.

Source: facts sheet, section 4 (vineyards).
"""

from __future__ import annotations

import numpy as np

from grape.messages import Array
from grape.sim.worlds.growth import UP, Growth, add_cane, add_spur, tilted, wobble
from grape.sim.worlds.model import Label

MAX_CORDON_SPURS = 8
MAX_GOBELET_SPURS = 7
_ROOT = np.array([0.0, 0.0, -0.06])


def cordon_height(rng: np.random.Generator) -> float:
    """Height (m) of a row's carrier wire, and so of its cordons."""
    return float(rng.uniform(0.74, 0.78))


def grow_cordon(plant: str, height: float, reach: tuple[float, float], cane: float, rng: np.random.Generator) -> Growth:
    """A trunk and two arms along the wire with spurs of any orientation, at least half of them within 40 degrees of up.

    Args:
        plant: id, becomes the prefix of every name.
        height: of the carrier wire above the ground, m.
        reach: how far wood may go towards -x and +x before it meets a post, m.
        cane: chance of an uncut cane.
        rng: source of everything random.
    """
    growth = Growth(plant, rng.uniform(0.85, 1.15))
    height = height + rng.uniform(-0.02, 0.02)
    head = np.array([rng.normal(0.0, 0.015), rng.normal(0.0, 0.01), height - 0.03])
    _trunk(growth, head, rng.uniform(0.022, 0.036), rng)
    places: list[tuple[Array, float]] = []
    for k, sign in enumerate((-1.0, 1.0)):
        length = min(rng.uniform(0.44, 0.53), reach[k]) - sign * head[0]
        arm = _cordon_arm(growth, f"arm{k}", head, sign, length, height, rng)
        places += _along(arm, rng)
    places = places[:MAX_CORDON_SPURS]
    directions = _cordon_directions(len(places), rng)
    for (place, radius), direction in zip(places, directions, strict=True):
        if not -reach[0] < place[0] + 0.17 * direction[0] < reach[1]:
            direction = direction * [-1.0, 1.0, 1.0]
        add_spur(growth, place + UP * radius * 0.7, direction, rng)
    if rng.random() < cane:
        add_cane(growth, places[int(rng.integers(len(places)))][0], rng)
    return growth


def _trunk(growth: Growth, head: Array, radius: float, rng: np.random.Generator) -> None:
    """Three capsules from under the ground to `head`."""
    bends = [_ROOT + (head - _ROOT) * s + [rng.normal(0.0, 0.015), rng.normal(0.0, 0.015), 0.0] for s in (0.35, 0.7)]
    growth.branch("trunk", np.array([_ROOT, *bends, head]), radius * np.array([1.15, 1.05, 0.95, 0.9]), Label.TRUNK)


def _cordon_arm(
    growth: Growth, name: str, head: Array, sign: float, length: float, height: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Four capsules that rise from the head and follow the wire; returns points (5, 3) and radii (5,)."""
    share = np.array([0.0, 0.18, 0.45, 0.73, 1.0])
    points = np.column_stack(
        [
            head[0] + sign * length * share,
            head[1] + np.array([0.0, *rng.normal(0.0, 0.008, 4)]),
            np.array([head[2], *(height + rng.normal(0.0, 0.008, 4))]),
        ]
    )
    radii = np.linspace(rng.uniform(0.017, 0.022), rng.uniform(0.010, 0.014), 5)
    growth.branch(name, points, radii, Label.ARM)
    return points, radii


def _along(arm: tuple[Array, Array], rng: np.random.Generator) -> list[tuple[Array, float]]:
    """Places (3,) with the arm's radius there, every 15 to 20 cm along an arm."""
    points, radii = arm
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    places: list[tuple[Array, float]] = []
    s = rng.uniform(0.06, 0.12)
    while s < way[-1] - 0.005 or not places:
        places.append((np.array([np.interp(s, way, points[:, k]) for k in range(3)]), float(np.interp(s, way, radii))))
        s += rng.uniform(0.15, 0.20)
    return places


def _cordon_directions(n: int, rng: np.random.Generator) -> list[Array]:
    """Unit vectors of n spurs: 3 in 5 (rounded up) within 35 degrees of vertical, the others anywhere to 95 degrees."""
    upright = int(np.ceil(0.6 * n))
    tilts = np.concatenate([rng.uniform(0.0, 35.0, upright), rng.uniform(35.0, 95.0, n - upright)])
    return [tilted(np.radians(tilt), rng.uniform(0.0, 2 * np.pi)) for tilt in rng.permutation(tilts)]


def grow_gobelet(plant: str, cane: float, rng: np.random.Generator) -> Growth:
    """A short trunk and 4 or 5 arms like a goblet, with near-vertical spurs on top.

    Args:
        plant: id, becomes the prefix of every name.
        cane: chance of an uncut cane.
        rng: source of everything random.
    """
    growth = Growth(plant, rng.uniform(0.85, 1.15))
    head = np.array([rng.normal(0.0, 0.02), rng.normal(0.0, 0.02), rng.uniform(0.30, 0.50)])
    _trunk(growth, head, rng.uniform(0.030, 0.045), rng)
    arms = int(rng.integers(4, 6))
    first = rng.uniform(0.0, 2 * np.pi)
    crotch = head - UP * 0.02
    ends: list[Array] = []
    for k in range(arms):
        azimuth = first + 2 * np.pi * k / arms + rng.normal(0.0, 0.15)
        way = tilted(np.radians(rng.uniform(30.0, 60.0)), azimuth)
        arm = wobble(crotch, way, rng.uniform(0.20, 0.35), 2, 0.12, rng)
        radius = rng.uniform(0.0125, 0.022)
        growth.branch(f"arm{k}", arm, radius * np.array([1.1, 0.9, 0.75]), Label.ARM)
        add_spur(growth, arm[-1], _near_vertical(rng), rng)
        ends.append(arm[1] + (arm[2] - arm[1]) * 0.35)
    for place in ends:
        if len(growth.spurs) < MAX_GOBELET_SPURS and rng.random() < 0.4:
            add_spur(growth, place, _near_vertical(rng), rng)
    if rng.random() < cane:
        add_cane(growth, ends[int(rng.integers(arms))], rng)
    return growth


def _near_vertical(rng: np.random.Generator) -> Array:
    return tilted(np.radians(rng.uniform(0.0, 28.0)), rng.uniform(0.0, 2 * np.pi))
