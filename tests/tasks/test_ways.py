"""Orientations of the hand over a spur: room for the arm, and room for the nails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.move_arm import LINE_LIMIT_RAD, densely, find_postures
from grape.actions.robot import build_robot
from grape.control import DifferentialIkOptions
from grape.kinematics import inverse_path
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.stops import SPUR_STAND_OFF_M, Stop, margins_of, orientations
from grape.tasks.dispenser.targets import HangTarget, hang_line
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


def beside(target: HangTarget, side: float, off: float) -> np.ndarray:
    """A straight neighbour (n, 3) m, so far to the right of a hand over the spur and off its line."""
    up = target.tip + np.arange(-0.10, 0.03, 0.005)[:, None] * target.direction
    return up + target.rotation() @ [side, off, 0.0]


def test_a_neighbour_of_the_spur_between_the_nails_counts_and_the_spur_itself_does_not():
    own = UPRIGHT.tip + np.arange(-0.10, 0.0, 0.005)[:, None] * UPRIGHT.direction
    assert nail_gap(ROBOT, UPRIGHT, np.add(own, [0.006, 0.0, 0.0])) == gap(UPRIGHT)
    between = beside(UPRIGHT, 0.02, -0.025)
    assert nail_gap(ROBOT, UPRIGHT, between) < 0.0 < gap(UPRIGHT)
    assert nail_gap(ROBOT, UPRIGHT, np.vstack([own, beside(UPRIGHT, 0.0, 0.08)])) == gap(UPRIGHT), "over the spur"
    assert nail_gap(ROBOT, UPRIGHT, np.add(between, [0.0, 0.3, 0.0])) == gap(UPRIGHT)
    assert nail_gap(ROBOT, UPRIGHT, np.empty((0, 3))) == gap(UPRIGHT)


def test_the_hand_turns_away_from_a_neighbour():
    ways = orientations(UPRIGHT)
    neighbour = beside(UPRIGHT, 0.02, -0.025)
    alone, best = ways_by_ease(ROBOT, ways)[0], ways_by_ease(ROBOT, ways, neighbour)[0]
    assert is_tight(ROBOT, alone, neighbour) and not is_tight(ROBOT, best, neighbour)
    assert tight_last(ROBOT, [alone, best], neighbour) == [best, alone]


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


def test_no_joint_is_held_at_its_limit_while_the_hand_lets_go(bench: Bench) -> None:
    """At a spur of seed 725 the second joint was, as the fingers closed: the nails strayed by 15 mm onto the wood."""
    direction = np.array([0.085, -0.061, 0.994])
    spur = replace(UPRIGHT, tip=np.array([0.397, 0.99, 0.551]), direction=direction, azimuth=np.radians(-25.0))
    line = hang_line(ROBOT, spur, SPUR_STAND_OFF_M)
    steps = np.array(densely([ROBOT.in_arm_base(T) for T in line]))

    def nearest_limit(q: np.ndarray) -> float:
        path = inverse_path(ROBOT.arm, steps, q)
        assert path is not None
        return min(ROBOT.arm.limit_distance(q) for q in path)

    every, roomy = (
        [nearest_limit(q) for q in find_postures(bench.ctx, line, touch=spur.touched(), holding=True, limit_rad=least)]
        for least in (0.0, LINE_LIMIT_RAD)
    )
    assert min(every) < DifferentialIkOptions().limit_margin_rad < LINE_LIMIT_RAD <= min(roomy)
