"""How well an arm follows lines of hand poses, and the stop at which it does most."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import pose
from grape.kinematics import inverse_path
from grape.planning.placement import choose_stop, reach_margins

READY = "ready_left_fore"


def line_from(robot: Any, q: Any, way: Any, steps: int = 4) -> Any:
    """(steps, 4, 4) a straight line of the hand from the posture `q`, along `way` (3,) m of the arm's base."""
    T = robot.arm.fk(q)
    return np.array([pose(None, np.asarray(way) * k / (steps - 1)) @ T for k in range(steps)])


def test_margin_tells_singular_limited_and_far_lines_from_easy_ones(robot_models: Any) -> None:
    robot = robot_models
    q = robot.description.arm.poses[READY]
    easy = line_from(robot, q, (0.0, 0.05, 0.0))
    far = np.array([pose(None, (0.0, 1.0, 0.0)) @ T for T in easy])
    breaks = line_from(robot, q, (0.0, 1.0, 0.0), steps=20)
    reach = reach_margins(robot.arm, robot.body, np.array([easy, far]), seeds=[q])
    assert reach.margins[0] > 0.5 and reach.margins[1] == 0.0
    path = inverse_path(robot.arm, easy, reach.postures[0])
    assert path is not None, "the posture it tells follows the line"
    least = min(robot.arm.sigma_min(p) for p in path)
    assert reach.margins[0] <= least / 0.08 + 0.02, "no more than the singularity leaves"
    assert reach_margins(robot.arm, robot.body, breaks[None], seeds=[q]).margins[0] == 0.0


def test_a_hand_inside_the_base_is_out_of_reach(robot_models: Any) -> None:
    robot = robot_models
    T_base_hand = pose(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 0.15))
    line = np.array([robot.in_arm_base(T_base_hand)])
    assert reach_margins(robot.arm, robot.body, line[None]).margins[0] == 0.0


def test_lines_of_another_shape_are_refused(robot_models: Any) -> None:
    with pytest.raises(InvalidInput, match=r"\(m, k, 4, 4\)"):
        reach_margins(robot_models.arm, robot_models.body, np.eye(4)[None])


def test_the_stop_with_the_most_weighed_margin_wins_and_costs_count() -> None:
    two_ways_and_one = [np.zeros((2, 1, 4, 4)), np.zeros((1, 1, 4, 4))]
    answers = iter([[0.9, 0.1, 0.0], [0.2, 0.3, 0.8]] * 2)

    def choose(costs: Any = None) -> Any:
        return choose_stop(2, lambda s: two_ways_and_one, np.ones(2), lambda lines: np.array(next(answers)), costs)

    chosen = choose()
    assert chosen.index == 1 and chosen.margins == pytest.approx(np.array([[0.9, 0.0], [0.3, 0.8]]))
    assert chosen.scores == pytest.approx([0.45, 0.55])
    assert choose(np.array([0.0, 0.2])).index == 0
    with pytest.raises(InvalidInput):
        choose_stop(0, lambda s: [], np.array([1.0]), lambda lines: np.zeros(0))
