"""Taking any action away while it runs: whatever it held is stopped and given back, and a newer owner is left alone."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.core import Outcome
from grape.errors import ActionFailed, LeaseRevoked
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.site import Area, RefillPoint
from grape.tasks.dispenser import TASK
from grape.tasks.dispenser.actions.grasp_dispenser import GraspDispenserGoal, grasp_dispenser
from grape.tasks.dispenser.actions.scan_vine import ScanVineGoal, scan_vine
from grape.tasks.dispenser.feeder import VIEW_M, hand_at_feeder

ACTIONS = {action.name: action for action in TASK.actions}
ACTUATORS = ("base", "arm", "gripper")


def nothing(bench: Bench, task: Any) -> dict[str, Any]:
    return {}


def arm_away(bench: Bench, task: Any, **goal: Any) -> dict[str, Any]:
    bench.put_arm(DESCRIPTION.arm.poses["home"])
    return goal


def wound(bench: Bench, task: Any) -> dict[str, Any]:
    bench.put_arm(DESCRIPTION.arm.poses["travel"] + [0.0, 0.0, 0.0, 0.0, 0.0, 0.8 * DESCRIPTION.arm.cable_turns])
    return {}


def lost(bench: Bench, task: Any) -> dict[str, Any]:
    bench.localized = False
    bench.advance()
    return {}


def refill_point(bench: Bench, task: Any) -> dict[str, Any]:
    point = RefillPoint(id="refill", position=bench.base.pose[:2] + np.array([2.0, 0.0]), yaw_rad=0.0)
    bench.world.site = replace(bench.site, refills=(point,))
    return {}


def down_the_row(bench: Bench, task: Any) -> dict[str, Any]:
    return {"x": float(bench.base.pose[0]) + 2.0, "y": float(bench.base.pose[1]), "yaw": 0.0}


def in_a_fence(bench: Bench, task: Any) -> dict[str, Any]:
    beside = bench.base.pose[:2] + np.array([[-9.0, 0.3], [9.0, 0.3], [9.0, 0.4], [-9.0, 0.4]])
    bench.world.site = replace(bench.site, fences=(Area(id="fence", polygon=beside),))
    return {}


def at_feeder(bench: Bench, task: Any, height: float = VIEW_M) -> dict[str, Any]:
    task.fill_feeder(bench, 8)
    bench.put_hand(hand_at_feeder(bench.robot, 7, height))
    return {"level": 7}


def holding(bench: Bench, task: Any) -> dict[str, Any]:
    bench.ledger.move_dispenser("feeder", "hand")
    bench.scene.held = True
    return {}


def before_nail(bench: Bench, task: Any, back_off: float = 0.14) -> dict[str, Any]:
    target = task.put_nail(bench)
    task.at_target(bench, target, back_off)
    return {"target": target}


def before_spur(bench: Bench, task: Any) -> dict[str, Any]:
    target = task.spur_target(bench)
    bench.scene.rods = [(target.tip - 0.08 * target.direction, target.tip, 0.005)]
    task.at_target(bench, target, 0.12)
    return {"target": target}


def scanned(bench: Bench, task: Any) -> dict[str, Any]:
    scan = bench.run(scan_vine(ScanVineGoal(plant="n0", half_length_m=0.05), bench.ctx)).scan
    return {"plant": "n0", "scan": scan}


def cut_off_grasp(bench: Bench, task: Any) -> dict[str, Any]:
    bench.put_hand(hand_at_feeder(bench.robot, 4, 0.0))
    run = grasp_dispenser(GraspDispenserGoal(level=4), bench.ctx)
    for _ in range(240):
        next(run)
        bench.advance()
    run.close()
    bench.advance(30)
    return {}


@dataclass(frozen=True)
class Case:
    """What an action needs to get going, and which actuators it holds then."""

    goal: Callable[[Bench, Any], dict[str, Any]]
    holds: tuple[str, ...] = ()


CASES = {
    "ApproachNail": Case(lambda bench, task: {"plant": "n0"}, ("arm",)),
    "ApproachSpur": Case(lambda bench, task: {"target": task.spur_target(bench)}, ("arm",)),
    "BackOff": Case(nothing, ("base",)),
    "CalibrateArm": Case(nothing, ("arm", "gripper")),
    "CheckDeployment": Case(before_nail),
    "CheckFeeder": Case(arm_away, ("arm", "gripper")),
    "CheckGrasp": Case(nothing),
    "CheckHand": Case(holding),
    "DriveToPlant": Case(lambda bench, task: {"plant": "v0"}, ("base",)),
    "DriveToRefill": Case(refill_point, ("base",)),
    "DriveToPose": Case(down_the_row, ("base",)),
    "FindDeploymentPoints": Case(scanned),
    "FinishPlant": Case(lambda bench, task: {"plant": "n0", "outcome": Outcome.SKIPPED}),
    "GraspDispenser": Case(lambda bench, task: at_feeder(bench, task, 0.0), ("arm", "gripper")),
    "HangDispenser": Case(lambda bench, task: before_nail(bench, task, 0.0), ("arm", "gripper")),
    "HoldsDispenser": Case(holding),
    "LeaveFence": Case(in_a_fence, ("base",)),
    "LowerOntoTarget": Case(before_spur, ("arm",)),
    "MoveArmToNamed": Case(lambda bench, task: {"pose": "home"}, ("arm",)),
    "NextPlant": Case(nothing),
    "NextTarget": Case(lambda bench, task: {"plant": "v0", "targets": (task.spur_target(bench),)}),
    "RecallTargets": Case(lambda bench, task: {"plant": "v0"}),
    "Retract": Case(arm_away, ("arm",)),
    "ScanVine": Case(lambda bench, task: {"plant": "n0"}, ("arm", "gripper")),
    "ServoToFeeder": Case(at_feeder, ("arm",)),
    "ServoToNail": Case(before_nail, ("arm",)),
    "ServoToSpur": Case(before_spur, ("arm",)),
    "SettleAccount": Case(holding),
    "SkipPlants": Case(lambda bench, task: {"why": "refill_timeout"}),
    "TakePicture": Case(nothing),
    "Turn": Case(lambda bench, task: {"angle": 1.0}, ("base",)),
    "Unwind": Case(wound, ("arm",)),
    "Wait": Case(nothing, ("base",)),
    "WaitForLocalization": Case(lost),
    "WaitForRefill": Case(nothing, ("base", "arm", "gripper")),
    "WithdrawHand": Case(cut_off_grasp, ("arm", "gripper")),
}
MOVING = [name for name, case in CASES.items() if case.holds]


def drivers(bench: Bench) -> dict[str, Any]:
    return {"base": bench.base, "arm": bench.arm, "gripper": bench.fingers}


def begin(bench: Bench, task: Any, name: str) -> Any:
    goal = ACTIONS[name].goal_type(**CASES[name].goal(bench, task))
    return start(bench, name, goal)


def start(bench: Bench, name: str, goal: Any) -> Any:
    for driver in drivers(bench).values():
        driver.sent = driver.stops = 0
    return ACTIONS[name](goal, bench.ctx)


def get_going(bench: Bench, name: str, run: Any, beats: int = 400) -> None:
    """Advance until every actuator that the action holds was told to move, or once when it holds none."""
    for _ in range(beats):
        next(run)
        bench.advance()
        if all(drivers(bench)[held].sent > (3 if held != "gripper" else 0) for held in CASES[name].holds):
            return
    raise AssertionError(f"{name} did not get going within {beats} beats")


def owners(bench: Bench) -> dict[str, str | None]:
    return {name: getattr(bench.ctx, name).owner for name in ACTUATORS}


def standing(bench: Bench) -> bool:
    return not bench.arm.velocity.any() and (bench.base.v, bench.base.w) == (0.0, 0.0)


def test_there_is_a_case_for_every_action() -> None:
    assert set(CASES) == set(ACTIONS)


@pytest.mark.parametrize("name", CASES)
def test_a_preempted_action_stops_and_gives_back_what_it_held(bench: Bench, task: SimpleNamespace, name: str) -> None:
    run = begin(bench, task, name)
    get_going(bench, name, run)
    held = tuple(actuator for actuator, owner in owners(bench).items() if owner is not None)
    assert held == CASES[name].holds
    stops = {actuator: driver.stops for actuator, driver in drivers(bench).items()}
    run.close()
    assert owners(bench) == dict.fromkeys(ACTUATORS)
    for actuator, driver in drivers(bench).items():
        assert driver.stops == stops[actuator] + (actuator in held), actuator
    assert standing(bench)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("beats", [0, 1, 2])
def test_preempted_before_it_got_going_it_leaves_nothing_held(
    bench: Bench, task: SimpleNamespace, name: str, beats: int
) -> None:
    run = begin(bench, task, name)
    with contextlib.suppress(ActionFailed):
        for _ in range(beats):
            if next(run, None) is None:
                break
            bench.advance()
    run.close()
    assert owners(bench) == dict.fromkeys(ACTUATORS) and standing(bench)
    if beats == 0:
        assert not any(driver.sent or driver.stops for driver in drivers(bench).values())


@pytest.mark.parametrize("name", MOVING)
def test_a_preempted_action_can_be_started_again(bench: Bench, task: SimpleNamespace, name: str) -> None:
    goal = ACTIONS[name].goal_type(**CASES[name].goal(bench, task))
    first = start(bench, name, goal)
    get_going(bench, name, first)
    first.close()
    bench.advance(10)
    again = start(bench, name, goal)
    get_going(bench, name, again)
    again.close()
    assert owners(bench) == dict.fromkeys(ACTUATORS) and standing(bench)


@pytest.mark.parametrize("name", MOVING)
def test_a_newer_lease_stops_an_action_and_keeps_what_it_took(bench: Bench, task: SimpleNamespace, name: str) -> None:
    run = begin(bench, task, name)
    get_going(bench, name, run)
    taken = CASES[name].holds[0]
    driver = drivers(bench)[taken]
    stops = driver.stops
    with getattr(bench.ctx, taken).lease("the newer one"):
        assert driver.stops == stops + 1, "stopped at once"
        sent = driver.sent
        with pytest.raises(LeaseRevoked, match="lost its lease to the newer one"):
            for _ in range(30):
                next(run)
                bench.advance()
        assert (driver.sent, driver.stops) == (sent, stops + 1), "the older one neither moves nor stops it any more"
        assert getattr(bench.ctx, taken).owner == "the newer one"
    others = {actuator: owner for actuator, owner in owners(bench).items() if actuator != taken}
    assert set(others.values()) == {None}


def test_an_actuator_that_cannot_be_stopped_does_not_keep_the_other_moving(bench: Bench, task: SimpleNamespace) -> None:
    run = begin(bench, task, "GraspDispenser")
    get_going(bench, "GraspDispenser", run)

    def broken() -> None:
        raise OSError("no answer")

    bench.fingers.stop = broken  # type: ignore[method-assign]
    bench.arm.velocity = np.ones(6)
    with pytest.raises(OSError, match="no answer"):
        run.close()
    assert not bench.arm.velocity.any() and owners(bench) == dict.fromkeys(ACTUATORS)
