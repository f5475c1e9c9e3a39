"""Where the robot stops beside vines and nails."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.move_arm import find_postures
from grape.actions.obstacles import UNSEEN
from grape.actions.robot import build_robot
from grape.planning import StaticBox
from grape.robots import RobotDescription
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.robots.robi_jaco2 import DESCRIPTION as ROBI
from grape.tasks.dispenser.actions.scan_vine import ScanVineGoal, sweep_path
from grape.tasks.dispenser.row import ROW
from grape.tasks.dispenser.stops import (
    NAIL_STOPS,
    VINE_STOPS,
    Stop,
    first_stop,
    margins_of,
    next_stop,
    orientations,
    relative_to,
    usual_nails,
    usual_spurs,
)
from grape.tasks.dispenser.targets import HangTarget

HEIGHT = DESCRIPTION.base.height
UP = np.array([0.0, 0.0, 1.0])


def at(stop: Stop, targets: tuple[HangTarget, ...], robot: RobotDescription = DESCRIPTION) -> list[HangTarget]:
    """Targets in base_link at a stop, from those relative to the plant."""
    shift = np.array([*stop.plant_in_base(robot), 0.0])
    return [replace(t, tip=t.tip + shift) for t in targets]


def reached(robot: Any, stop: Stop, targets: tuple[HangTarget, ...]) -> int:
    """How many targets the arm reaches with some room."""
    return sum(margins_of(robot, orientations(target)).max() > 0.25 for target in at(stop, targets, robot.description))


def test_more_of_the_usual_spurs_are_reached_than_from_before_or_behind_the_vine(robot_models: Any) -> None:
    stop = first_stop(robot_models, "vine")
    spurs = usual_spurs(HEIGHT)
    assert reached(robot_models, stop, spurs) >= len(spurs) - 1
    for ahead in (0.22, -0.22):
        assert reached(robot_models, stop, spurs) > reached(robot_models, Stop(ahead_m=ahead, beside_m=0.62), spurs)


def test_a_dispenser_in_the_hand_has_room_in_the_sweep_of_a_scan(bench: Bench) -> None:
    for stop in (Stop(ahead_m=0.0, beside_m=least) for least in VINE_STOPS.beside_m):
        row_y = DESCRIPTION.base.half_width + stop.beside_m - 0.015  # parked a little too near
        path = sweep_path(ScanVineGoal(plant="v0"), DESCRIPTION.arm.T_base_link_arm_base, row_y)
        box = StaticBox(name=ROW, center=(0.25, row_y + 0.38, 0.4), half_size=(1.5, 0.5, 0.9), ignore_links=())
        bench.ctx.world.committed[UNSEEN] = (box,)
        assert find_postures(bench.ctx, path.poses, touch_boxes=(ROW,), holding=True, limit_rad=0.0)


@pytest.mark.parametrize("height", [0.7, 0.8, 0.9])
def test_nails_are_reached_although_arm_and_base_err_by_5_cm(robot_models: Any, height: float) -> None:
    stop = first_stop(robot_models, "nail", height, 0.1325)
    assert margins_of(robot_models, at(stop, usual_nails(HEIGHT, height, 0.1325))).min() > 0.5


def test_robi_reaches_vines_and_nails_from_the_same_stops(robot_models: Any) -> None:
    robi = build_robot(ROBI)
    spurs, nails = usual_spurs(ROBI.base.height), usual_nails(ROBI.base.height, 0.8, 0.1325)
    stops = first_stop(robi, "vine"), first_stop(robi, "nail", 0.8, 0.1325)
    assert stops == (first_stop(robot_models, "vine"), first_stop(robot_models, "nail", 0.8, 0.1325))
    assert reached(robi, stops[0], spurs) >= len(spurs) - 1
    assert margins_of(robi, at(stops[1], nails, ROBI)).min() > 0.5


def test_abreast_of_the_arm_a_nail_is_out_of_reach(robot_models: Any) -> None:
    assert margins_of(robot_models, at(Stop(ahead_m=0.0, beside_m=0.62), usual_nails(HEIGHT, 0.8, 0.1325))).min() == 0.0


def test_the_next_stop_reaches_what_was_found_and_lies_apart(robot_models: Any) -> None:
    here = first_stop(robot_models, "vine")
    tip = np.array([0.62, 0.05, 0.80])  # a spur at the very end of an arm
    found = HangTarget(plant="v", kind="spur", tip=tip, direction=UP, pitch=1.0)
    stop = next_stop(robot_models, here, [found], "vine")
    assert margins_of(robot_models, orientations(at(stop, (found,))[0])).max() > 0.5
    assert stop.ahead_m < here.ahead_m - 0.15, "the robot drives on, towards the spur"


def test_without_anything_found_the_next_stop_is_the_next_best_one(robot_models: Any) -> None:
    for kind, options, height, reach in (("vine", VINE_STOPS, 0.0, 0.0), ("nail", NAIL_STOPS, 0.8, 0.1325)):
        here = first_stop(robot_models, kind, height, reach)
        stop = next_stop(robot_models, here, [], kind, height, reach)
        assert np.hypot(stop.ahead_m - here.ahead_m, stop.beside_m - here.beside_m) >= options.apart_m - 1e-9


def test_targets_are_told_relative_to_the_foot() -> None:
    target = HangTarget(plant="v", kind="spur", tip=np.array([0.5, 1.0, 0.7]), direction=UP, pitch=1.0)
    assert relative_to(np.array([0.4, 0.9]), [target])[0].tip == pytest.approx([0.1, 0.1, 0.7])
