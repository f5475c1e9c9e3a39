"""Wires in a scan: found where they are, told from wood, and led on beyond its ends."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.messages import Array
from grape.tasks.dispenser.perception.wires import find_wires, going_on


def stick(a: Array, b: Array, radius: float, count: int, rng: np.random.Generator, noise: float = 0.005) -> Array:
    """(n, 3) points on a rod, with noise."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    around = rng.normal(size=(count, 3))
    around *= radius / np.linalg.norm(around, axis=1, keepdims=True)
    return a + rng.random((count, 1)) * (b - a) + around + rng.normal(0.0, noise, (count, 3))


def scene(rng: np.random.Generator, wires: list[tuple[Array, Array]]) -> Array:
    """A cordon with spurs, ground, and wires from x = 0 to 0.7."""
    wood = [stick([0.0, 0.85, 0.6], [0.7, 0.85, 0.62], 0.025, 4000, rng)]
    wood += [stick([x, 0.85, 0.6], [x + 0.05, 0.87, 0.8], 0.006, 300, rng) for x in (0.1, 0.3, 0.55)]
    wood.append(stick([0.35, 0.85, -0.1], [0.35, 0.85, 0.6], 0.03, 2000, rng))
    ground = np.column_stack([rng.random((3000, 2)) * [0.7, 0.8] + [0.0, 0.5], rng.normal(-0.13, 0.01, 3000)])
    return np.vstack([*wood, ground, *(stick(a, b, 0.001, 400, rng) for a, b in wires)])


WIRES = [
    (np.array([0.0, 0.86, 1.03]), np.array([0.7, 0.84, 1.05])),
    (np.array([0.0, 0.87, 1.42]), np.array([0.7, 0.85, 1.45])),
]


def test_wires_are_found_where_they_are_and_wood_is_not_one() -> None:
    found = sorted(find_wires(scene(np.random.default_rng(1), WIRES)), key=lambda ends: ends[0][2])
    assert len(found) == 2
    for (a, b), (true_a, true_b) in zip(found, WIRES, strict=True):
        assert np.linalg.norm(a - true_a) < 0.02 and np.linalg.norm(b - true_b) < 0.02


@pytest.mark.parametrize("rise", [-0.2, -0.08, 0.1])
def test_wires_are_found_from_a_robot_that_stands_on_a_bump(rise: float) -> None:
    wires = [(a, b + np.array([0.0, 0.0, 0.7 * rise])) for a, b in WIRES]
    found = sorted(find_wires(scene(np.random.default_rng(5), wires)), key=lambda ends: ends[0][2])
    assert len(found) == 2
    for (a, b), (true_a, true_b) in zip(found, wires, strict=True):
        assert np.linalg.norm(a - true_a) < 0.02 and np.linalg.norm(b - true_b) < 0.02


def test_they_go_on_beyond_both_ends() -> None:
    found = find_wires(scene(np.random.default_rng(2), WIRES[:1]))
    beyond = going_on(found, reach=0.5)
    a, b = WIRES[0]
    along = (b - a) / np.linalg.norm(b - a)
    assert np.linalg.norm(np.cross(beyond - a, along), axis=1).max() < 0.02
    assert beyond[:, 0].min() < -0.45 and beyond[:, 0].max() > 1.15
    assert not ((beyond[:, 0] > 0.03) & (beyond[:, 0] < 0.67)).any(), "between them they were seen"


@pytest.mark.parametrize("ends", [([0.0, 0.86, 1.0], [0.35, 0.85, 1.0]), ([0.1, 0.5, 1.0], [0.4, 1.1, 1.1])])
def test_what_ends_or_leads_across_is_no_wire(ends: tuple[list[float], list[float]]) -> None:
    assert find_wires(scene(np.random.default_rng(3), [(np.array(ends[0]), np.array(ends[1]))])) == ()


def test_where_nothing_or_little_was_scanned_nothing_is_found() -> None:
    assert find_wires(np.zeros((0, 3))) == () and going_on(()).shape == (0, 3)
    assert find_wires(stick(WIRES[0][0], WIRES[0][0] + [0.2, 0.0, 0.0], 0.001, 50, np.random.default_rng(4))) == ()
    with pytest.raises(InvalidInput):
        find_wires(np.zeros((4, 2)))
