"""Orientations of the hand over a spur: room for the arm, and room for the nails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grape.actions.robot import build_robot
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.stops import Stop, margins_of, orientations
from grape.tasks.dispenser.targets import HangTarget
from grape.tasks.dispenser.ways import is_tight, nail_gap, tight_last, ways_by_ease

ROBOT = build_robot(DESCRIPTION)
PLACE = np.array([*Stop(ahead_m=0.0, beside_m=0.54).plant_in_base(DESCRIPTION), 0.6])
UPRIGHT = HangTarget(plant="v0", kind="spur", tip=PLACE, direction=np.array([0.0, 0.0, 1.0]), pitch=np.radians(55.0))


def gap(target: HangTarget) -> float:
    return nail_gap(ROBOT, target)


def leaning(direction: tuple[float, float, float]) -> HangTarget:
    return replace(UPRIGHT, direction=np.array(direction) / np.linalg.norm(direction))


def test_nails_close_beside_an_upright_spur_and_on_one_that_lies_in_the_loop():
    assert gap(UPRIGHT) > 0.004
    lies = replace(UPRIGHT, direction=UPRIGHT.rotation() @ [0.0, 1.0, 0.0])
    assert gap(lies) < 0.0
    square = replace(UPRIGHT, direction=UPRIGHT.rotation() @ [0.0, 0.0, 1.0])
    assert gap(square) > gap(UPRIGHT)


def test_half_of_what_a_spur_is_thicker_is_gone():
    assert gap(replace(UPRIGHT, diameter=0.012)) == pytest.approx(gap(UPRIGHT) - 0.002, abs=1e-9)


def test_left_is_as_right():
    a, b = leaning((0.3, 0.1, 0.9)), leaning((-0.3, 0.1, 0.9))
    assert gap(a) == pytest.approx(gap(b), abs=1e-9)


@pytest.mark.parametrize("direction", [(0.25, 0.32, 0.91), (0.0, 0.32, 0.95), (-0.2, 0.0, 0.98), (0.3, 0.2, 0.92)])
def test_of_all_ways_one_is_taken_that_leaves_the_spur_alone(direction):
    spur = leaning(direction)
    ways = orientations(spur)
    best = ways_by_ease(ROBOT, ways)
    assert min(gap(way) for way in ways) < 0.0, "some touch it"
    assert gap(best[0]) > 0.001 and margins_of(ROBOT, best[:1])[0] > 0.3
    assert len(best) == np.count_nonzero(margins_of(ROBOT, ways) > 0.0)


def test_out_of_reach_there_is_no_way():
    assert ways_by_ease(ROBOT, orientations(replace(UPRIGHT, tip=np.add(PLACE, [0.0, 3.0, 0.0])))) == []
    assert ways_by_ease(ROBOT, []) == []


def test_where_nails_would_press_comes_last_and_the_worst_at_the_end():
    worst, tight = leaning((0.0, 0.5, 0.87)), leaning((0.0, 0.2, 0.98))
    assert gap(worst) < gap(tight) < 0.001 < gap(UPRIGHT)
    assert [is_tight(ROBOT, target) for target in (worst, tight, UPRIGHT)] == [True, True, False]
    other = replace(UPRIGHT, direction=np.array([0.0, -0.3, 0.95]))
    assert tight_last(ROBOT, [worst, UPRIGHT, tight, other]) == [UPRIGHT, other, tight, worst]
