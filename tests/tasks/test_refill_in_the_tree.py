"""The mission's tree with actions that only move dispensers in the ledger: when it has the feeder refilled."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paper_robot import PLANTS, Bench

from grape.actions.core import Action, Context, Feedback, Status
from grape.bt import TreeExecutor, load_tree, node_library
from grape.errors import ActionFailed, Reason
from grape.mission.ledger import SqliteLedger
from grape.site import RefillPoint
from grape.tasks.dispenser import TASK
from grape.tasks.dispenser.actions.check_feeder import FEEDER_EMPTY

REAL = ("NextPlant", "FinishPlant", "SkipPlants")
TOLD = ("DriveToPlant", "DriveToRefill", "BackOff", "WaitForRefill", "SkipPlants")


class Vineyard:
    """What the fake actions do, and which of them ran."""

    def __init__(self, bench: Bench) -> None:
        self.bench, self.ran = bench, []
        self.lose: list[str] = []  # actions that lose the dispenser in hand, once each
        self.fail: dict[str, Reason] = {}
        self.servoing: list[str] = []  # what happens to the dispenser in runs of ServoToNail that fail: stays or falls
        self.fallen = False  # and nobody has looked yet
        self.refills = [1, 1, 1]

    def act(self, name: str, goal: Any) -> None:
        ledger, committed = self.bench.ledger, self.bench.world.committed
        if name in TOLD:
            self.ran.append(f"{name} {goal.plant}" if name == "DriveToPlant" else name)
        if name in self.fail:
            raise ActionFailed(self.fail[name])
        places = ledger.dispensers()
        if name == "HoldsDispenser" and not places["hand"]:
            raise ActionFailed(Reason.GRASP_FAILED)
        if name == "CheckFeeder" and not places["feeder"]:
            committed[FEEDER_EMPTY] = True
            raise ActionFailed(Reason.FEEDER_EMPTY)
        if name == "CheckGrasp":
            ledger.move_dispenser("feeder", "hand")
        if name in self.lose:
            self.lose.remove(name)
            ledger.move_dispenser("hand", "lost")
            raise ActionFailed(Reason.DISPENSER_FALLEN)
        if name == "ServoToNail" and self.servoing:
            self.fallen = self.servoing.pop(0) == "falls"
            raise ActionFailed(Reason.IN_COLLISION)
        if name == "CheckHand" and self.fallen:
            self.fallen = False
            ledger.move_dispenser("hand", "lost")
        if name == "HangDispenser":
            open_ = next(task.plant for task in ledger.plants() if task.outcome is None)
            ledger.move_dispenser("hand", open_)
        if name == "WaitForRefill":
            ledger.refill(ledger.refills() + 1, self.refills.pop(0))
            committed.pop(FEEDER_EMPTY, None)

    def library(self) -> Any:
        return node_library([*(self._fake(action) for action in TASK.actions), *TASK.conditions])

    def _fake(self, action: Action[Any, Any]) -> Action[Any, Any]:
        def run(goal: Any, ctx: Context) -> Generator[Feedback, None, Any]:
            yield Feedback()
            self.act(action.name, goal)
            if action.name in REAL:
                return (yield from action(goal, ctx))
            result = object.__new__(action.result_type)
            for field in fields(action.result_type):
                object.__setattr__(result, field.name, _anything(field.name))
            return result

        return replace(action, function=run)


def _anything(name: str) -> Any:
    return {"level": 0, "targets": (), "remaining": ()}.get(name)


Begin = Callable[..., Vineyard]


@pytest.fixture
def begin(bench: Bench, tmp_path: Path) -> Iterator[Begin]:
    ledgers: list[SqliteLedger] = []

    def build(loaded: int, stock: int, plants: Any = PLANTS[:1], point: bool = True) -> Vineyard:
        ledgers.append(SqliteLedger.create(tmp_path / f"{len(ledgers)}.sqlite", plants, loaded, stock=stock))
        bench.ledger = bench.ctx.ledger = ledgers[-1]
        where = RefillPoint(id="refill", position=np.array([-3.0, 0.0]), yaw_rad=0.0)
        bench.world.site = replace(bench.site, refills=(where,) if point else ())
        bench.world.committed.clear()
        return Vineyard(bench)

    yield build
    for ledger in ledgers:
        ledger.close()


def play(vineyard: Vineyard) -> list[tuple[str, str]]:
    """Runs the mission's tree to its end; outcome and reason of each plant."""
    tree = load_tree(TASK.trees["dispenser_deployment"], vineyard.library())
    executor = TreeExecutor(tree, vineyard.bench.ctx)
    for _ in range(5000):
        if executor.tick() is not Status.ACTIVE:
            return [(str(task.outcome), task.reason) for task in vineyard.bench.ledger.plants()]
    raise AssertionError(f"the tree does not end: {vineyard.ran[-20:]}")


NAILS = (("n0", "nail"), ("v0", "nail"), ("v1", "nail"))


def test_an_empty_feeder_is_refilled_between_plants(begin: Begin) -> None:
    vineyard = begin(1, 2, NAILS)
    assert play(vineyard) == [("deployed", "")] * 3
    refill = ["DriveToRefill", "WaitForRefill"]
    assert vineyard.ran == ["DriveToPlant n0", *refill, "DriveToPlant v0", *refill, "DriveToPlant v1"]
    assert vineyard.bench.ledger.account() == {"loaded": 3, "deployed": 3, "left": 0, "lost": 0, "on_hand": 0}


def test_no_refill_when_every_plant_is_served(begin: Begin) -> None:
    vineyard = begin(3, 2, NAILS)
    assert play(vineyard) == [("deployed", "")] * 3
    assert "DriveToRefill" not in vineyard.ran


@pytest.mark.parametrize("lost_by", ["ApproachNail", "ServoToNail"])
def test_a_plant_at_which_the_last_dispenser_was_lost_is_served_after_the_refill(begin: Begin, lost_by: str) -> None:
    vineyard = begin(1, 1)
    vineyard.lose = [lost_by]
    assert play(vineyard) == [("deployed", "")]
    assert vineyard.ran == ["DriveToPlant n0", "DriveToRefill", "WaitForRefill", "DriveToPlant n0"]
    assert vineyard.bench.ledger.account() == {"loaded": 2, "deployed": 1, "left": 0, "lost": 1, "on_hand": 0}


def test_a_last_dispenser_that_fell_unnoticed_at_the_other_stop_is_replaced_by_a_refill(begin: Begin) -> None:
    vineyard = begin(1, 1)
    vineyard.servoing = ["stays", "stays", "stays", "falls"]
    assert play(vineyard) == [("deployed", "")]
    assert vineyard.ran == ["DriveToPlant n0"] * 2 + ["DriveToRefill", "WaitForRefill", "DriveToPlant n0"]
    assert vineyard.bench.ledger.account() == {"loaded": 2, "deployed": 1, "left": 0, "lost": 1, "on_hand": 0}


def test_a_refill_point_whose_way_is_blocked_is_driven_to_again_after_giving_way(begin: Begin) -> None:
    vineyard = begin(1, 1, NAILS[:2])
    vineyard.fail = {"DriveToRefill": Reason.BLOCKED}
    assert play(vineyard) == [("deployed", ""), ("skipped", "blocked")]
    assert vineyard.ran == ["DriveToPlant n0", "DriveToRefill", "BackOff", "DriveToRefill", "SkipPlants"]


def test_without_stock_or_point_a_plant_is_skipped_as_before(begin: Begin) -> None:
    for stock, point in ((0, True), (3, False)):
        vineyard = begin(1, stock, NAILS[:1], point)
        vineyard.lose = ["ServoToNail"]
        assert play(vineyard) == [("skipped", "feeder_empty")]
        assert "DriveToRefill" not in vineyard.ran


@pytest.mark.parametrize(
    ("action", "reason"), [("WaitForRefill", Reason.REFILL_TIMEOUT), ("DriveToRefill", Reason.BLOCKED)]
)
def test_when_there_is_no_refill_the_plants_that_are_left_are_skipped(
    begin: Begin, action: str, reason: Reason
) -> None:
    vineyard = begin(1, 2, NAILS)
    vineyard.fail = {action: reason}
    assert play(vineyard) == [("deployed", "")] + [("skipped", str(reason))] * 2
    assert vineyard.ran.count("DriveToRefill") == (2 if action == "DriveToRefill" else 1)


def test_a_refill_that_the_camera_does_not_see_is_asked_for_again_until_the_stock_is_used_up(begin: Begin) -> None:
    vineyard = begin(1, 2, NAILS[:1])
    vineyard.lose = ["ServoToNail", "ApproachNail", "ServoToNail"]
    assert play(vineyard) == [("skipped", "feeder_empty")]
    assert vineyard.ran.count("WaitForRefill") == 2
