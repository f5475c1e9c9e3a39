"""Driving to a refill point, waiting there, and what the account says afterwards."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_package import brought
from paper_robot import PLANTS, Bench

from grape.actions.core import Outcome
from grape.actions.shortest_way import shortest_way
from grape.drivers import NoOperator
from grape.errors import ActionFailed, Reason
from grape.mission.ledger import SqliteLedger
from grape.plugins import GLOBAL_PLANNERS
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.site import RefillPoint
from grape.tasks.dispenser.actions.check_feeder import FEEDER_EMPTY, CheckFeederGoal, check_feeder
from grape.tasks.dispenser.actions.drive_to_plant import PARKED
from grape.tasks.dispenser.actions.drive_to_refill import DriveToRefillGoal, drive_to_refill
from grape.tasks.dispenser.actions.skip_plants import SkipPlantsGoal, skip_plants
from grape.tasks.dispenser.actions.wait_for_refill import WaitForRefillGoal, wait_for_refill
from grape.tasks.dispenser.conditions import PlantsLeftGoal, RefillAwaitsGoal, plants_left, refill_awaits

EAST = RefillPoint(id="east", position=np.array([8.0, 0.0]), yaw_rad=0.0)
WEST = RefillPoint(id="west", position=np.array([-2.5, 0.0]), yaw_rad=np.pi)
NORTH = RefillPoint(id="north", position=np.array([2.0, 1.5]), yaw_rad=np.pi)  # near, but behind the row


@pytest.fixture
def empty(bench: Bench, tmp_path: Path) -> Iterator[Bench]:
    """The robot with an empty feeder, five dispensers in stock, and refill points."""
    ledger = SqliteLedger.create(tmp_path / "empty.sqlite", PLANTS, 0, stock=5)
    bench.ledger = bench.ctx.ledger = ledger
    bench.world.site = replace(bench.site, refills=(EAST, WEST, NORTH))
    yield bench
    ledger.close()


def wait(bench: Bench, **goal: Any) -> Any:
    return wait_for_refill(WaitForRefillGoal(**goal), bench.ctx)


def test_a_site_without_a_refill_point_is_told_apart(empty: Bench) -> None:
    empty.world.site = empty.site
    failure = empty.failure(drive_to_refill(DriveToRefillGoal(), empty.ctx))
    assert failure.reason is Reason.NO_REFILL_POINT and "refill" in failure.detail
    assert not empty.base.sent and empty.ledger.last_step() is None


def test_the_point_that_is_nearest_by_driving_is_taken(empty: Bench) -> None:
    def nearest(*points: RefillPoint) -> str:
        return points[shortest_way(empty.ctx, [(*point.position, point.yaw_rad) for point in points])].id

    assert nearest(WEST, NORTH, EAST) == "east", "two metres across the row are a long way around"
    in_fence = RefillPoint(id="fence", position=np.array([1.0, 0.0]), yaw_rad=0.0)
    assert nearest(in_fence, EAST) == "east"
    with pytest.raises(ActionFailed) as failed:
        nearest(in_fence)
    assert failed.value.reason is Reason.NO_PATH


def test_the_nearest_point_is_that_of_the_global_planner_that_drives_there(
    empty: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "hovering.py").write_text(
        "from grape.errors import ActionFailed, Reason\n"
        "def over_rows(costmap, start, waypoints, options=None):\n"
        "    raise ActionFailed(Reason.NO_PATH, f'not to x = {waypoints[-1][0]:.0f}')\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    brought(monkeypatch, GLOBAL_PLANNERS, "over_rows", "hovering:over_rows")
    failure = empty.failure(drive_to_refill(DriveToRefillGoal(global_planner="over_rows"), empty.ctx))
    assert (failure.reason, failure.detail) == (Reason.NO_PATH, "not to x = 2")
    assert empty.ledger.last_step() is None and not empty.base.sent


def test_the_robot_stops_at_the_refill_point_and_forgets_the_stop_before(empty: Bench) -> None:
    near = RefillPoint(id="near", position=empty.base.pose[:2] - [1.5, 0.0], yaw_rad=0.0)
    empty.world.site = replace(empty.site, refills=(near,))
    empty.world.committed[PARKED] = ("n0", "fore")
    empty.ledger.remember(PARKED, ["n0", "fore"])
    result = empty.run(drive_to_refill(DriveToRefillGoal(), empty.ctx))
    assert result.point == "near" and empty.base.pose[:2] == pytest.approx(near.position, abs=0.04)
    assert PARKED not in empty.world.committed and empty.ledger.recall(PARKED) is None
    step = empty.ledger.last_step()
    assert (step.name, step.details["refill"], step.outcome) == ("drive", "near", "done")


def test_the_robot_calls_keeps_still_and_goes_on_when_the_refill_is_confirmed(empty: Bench) -> None:
    empty.operator.waiting = [3]
    empty.world.committed[FEEDER_EMPTY] = True
    stood, q = empty.base.pose.copy(), empty.arm.q.copy()
    assert empty.run(wait(empty)).added == 3
    assert empty.operator.calls == 50
    assert empty.base.pose == pytest.approx(stood) and empty.arm.q == pytest.approx(q, abs=1e-3)
    assert FEEDER_EMPTY not in empty.world.committed
    assert empty.ledger.account() == {"loaded": 3, "deployed": 0, "left": 3, "lost": 0, "on_hand": 0}
    assert empty.log.last("refilled") == {"number": 1, "added": 3}
    assert (empty.ledger.last_step().name, empty.ledger.last_step().outcome) == ("refill", "done")
    assert {empty.ctx.base.owner, empty.ctx.arm.owner, empty.ctx.gripper.owner} == {None}


def test_an_arm_that_is_in_the_way_is_moved_first(empty: Bench) -> None:
    empty.put_arm(DESCRIPTION.arm.poses["home"])
    empty.operator.waiting = [1]
    empty.run(wait(empty))
    assert empty.arm.q == pytest.approx(DESCRIPTION.arm.poses["travel"], abs=0.02)


def test_waiting_tells_how_long_and_how_far(empty: Bench) -> None:
    run = wait(empty, timeout_s=4.0)
    told = []
    for _ in range(200):
        told.append(next(run))
        empty.advance()
    run.close()
    assert told[-1].status.startswith("waiting for a refill, ") and 0.3 < told[-1].progress < 0.6


def test_nobody_comes(empty: Bench) -> None:
    failure = empty.failure(wait(empty, timeout_s=2.0))
    assert failure.reason is Reason.REFILL_TIMEOUT and "2 s" in failure.detail
    assert empty.operator.calls > 100 and empty.ledger.account()["loaded"] == 0
    assert empty.ledger.last_step().outcome == "failed"
    empty.ctx.drivers = replace(empty.ctx.drivers, operator=NoOperator())
    assert empty.failure(wait(empty, timeout_s=0.5)).reason is Reason.REFILL_TIMEOUT


def test_an_operator_with_nothing_left_ends_the_waiting(empty: Bench) -> None:
    empty.operator.waiting = [0]
    assert empty.failure(wait(empty)).reason is Reason.FEEDER_EMPTY
    assert not refill_awaits(RefillAwaitsGoal(), empty.ctx), "and nobody drives there again"


def test_a_refill_confirmed_while_the_robot_was_dead_counts_once(empty: Bench) -> None:
    empty.operator.waiting = [2]
    for _ in range(50):
        empty.operator.call()
    calls = empty.operator.calls
    assert empty.run(wait(empty)).added == 2
    assert empty.operator.calls == calls, "he is not called again"
    assert empty.failure(wait(empty, timeout_s=1.0)).reason is Reason.REFILL_TIMEOUT, "it does not count twice"
    assert empty.ledger.account()["left"] == 2


@pytest.mark.parametrize(("said", "in_feeder", "loaded", "lost"), [(3, 3, 3, 0), (4, 2, 4, 2), (2, 4, 4, 0)])
def test_the_camera_counts_what_was_refilled(
    empty: Bench, task: SimpleNamespace, said: int, in_feeder: int, loaded: int, lost: int
) -> None:
    empty.operator.waiting = [said]
    empty.run(wait(empty))
    task.fill_feeder(empty, in_feeder)
    assert empty.run(check_feeder(CheckFeederGoal(frames=3), empty.ctx)).level == in_feeder - 1
    account = {"loaded": loaded, "deployed": 0, "left": in_feeder, "lost": lost, "on_hand": 0}
    assert empty.ledger.account() == account


def test_a_refill_awaits_while_nothing_is_left_but_the_stock(empty: Bench) -> None:
    def awaits() -> bool:
        return refill_awaits(RefillAwaitsGoal(), empty.ctx)

    assert awaits()
    empty.ledger.refill(1, 4)
    assert not awaits(), "there are some in the feeder"
    empty.world.committed[FEEDER_EMPTY] = True
    assert awaits(), "but it was seen empty"
    empty.world.site = empty.site
    assert not awaits(), "the site has no refill point"
    empty.world.site = replace(empty.site, refills=(WEST,))
    empty.ledger.refill(2, 1)
    assert not awaits(), "the stock is used up"


def test_plants_that_are_left_are_skipped_with_the_reason(empty: Bench) -> None:
    empty.ledger.finish("n0", Outcome.DEPLOYED)
    assert plants_left(PlantsLeftGoal(), empty.ctx)
    empty.run(skip_plants(SkipPlantsGoal(why="refill_timeout"), empty.ctx))
    assert not plants_left(PlantsLeftGoal(), empty.ctx)
    ends = [(task.outcome, task.reason) for task in empty.ledger.plants()]
    assert ends == [(Outcome.DEPLOYED, "")] + [(Outcome.SKIPPED, "refill_timeout")] * 2
