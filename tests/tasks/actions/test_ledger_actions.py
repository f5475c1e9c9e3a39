"""Choosing plants and targets, writing down outcomes, and the questions the tree asks."""

from __future__ import annotations

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.core import Outcome
from grape.errors import InvalidInput, Reason
from grape.tasks.dispenser.actions.check_feeder import FEEDER_EMPTY
from grape.tasks.dispenser.actions.finish_plant import FinishPlantGoal, finish_plant
from grape.tasks.dispenser.actions.next_plant import NextPlantGoal, next_plant
from grape.tasks.dispenser.actions.next_target import NextTargetGoal, next_target
from grape.tasks.dispenser.conditions import DispensersLeftGoal, ModeIsGoal, dispensers_left, mode_is
from grape.tasks.dispenser.targets import HangTarget


def spur(score: float) -> HangTarget:
    tip, up = np.array([0.4, 0.9, 0.5]), np.array([0.0, 0.0, 1.0])
    return HangTarget(plant="v0", kind="spur", tip=tip, direction=up, pitch=1.0, score=score)


def test_plants_are_served_in_their_order(bench: Bench) -> None:
    served = []
    for _ in range(3):
        plant = bench.run(next_plant(NextPlantGoal(), bench.ctx))
        served.append((plant.plant, plant.mode))
        bench.run(finish_plant(FinishPlantGoal(plant=plant.plant, outcome=Outcome.DEPLOYED), bench.ctx))
    assert served == [("n0", "nail"), ("v0", "plant"), ("v1", "plant")]
    assert bench.failure(next_plant(NextPlantGoal(), bench.ctx)).reason is Reason.NO_PLANT_LEFT


def test_a_plant_without_an_outcome_is_offered_again(bench: Bench) -> None:
    first = bench.run(next_plant(NextPlantGoal(), bench.ctx))
    assert bench.run(next_plant(NextPlantGoal(), bench.ctx)) == first
    assert bench.log.last("plant_started") == {"plant": "n0", "mode": "nail"}


def test_outcome_and_reason_are_written_down(bench: Bench) -> None:
    goal = FinishPlantGoal(plant="v0", outcome=Outcome.SKIPPED, why="unreachable")
    bench.run(finish_plant(goal, bench.ctx))
    task = bench.ledger.plants()[1]
    assert (task.outcome, task.reason) == (Outcome.SKIPPED, "unreachable")
    assert bench.log.last("plant_finished") == {"plant": "v0", "outcome": "skipped", "reason": "unreachable"}


def test_a_plant_that_is_not_in_the_mission_cannot_be_finished(bench: Bench) -> None:
    goal = FinishPlantGoal(plant="v7", outcome=Outcome.DEPLOYED)
    with pytest.raises(InvalidInput, match="'v7' is not in this mission"):
        bench.run(finish_plant(goal, bench.ctx))


def test_targets_are_taken_best_first_until_none_is_left(bench: Bench) -> None:
    left = (spur(0.9), spur(0.5))
    scores = []
    while left:
        taken = bench.run(next_target(NextTargetGoal(plant="v0", targets=left), bench.ctx))
        left = taken.remaining
        scores.append(taken.target.score)
    assert scores == [0.9, 0.5]
    failure = bench.failure(next_target(NextTargetGoal(plant="v0", targets=()), bench.ctx))
    assert failure.reason is Reason.NO_DEPLOYMENT_POINT and "v0" in failure.detail


def test_dispensers_are_left_while_feeder_or_hand_has_one(bench: Bench) -> None:
    def left() -> bool:
        return dispensers_left(DispensersLeftGoal(), bench.ctx)

    assert left()
    bench.world.committed[FEEDER_EMPTY] = True
    assert not left(), "it was seen empty, whatever the account says"
    bench.ledger.move_dispenser("feeder", "hand")
    assert left()
    bench.ledger.move_dispenser("hand", "lost")
    bench.world.committed.clear()
    for _ in range(7):
        assert left()
        bench.ledger.move_dispenser("feeder", "lost")
    assert not left()


@pytest.mark.parametrize(("mode", "answer"), [("nail", True), ("plant", False)])
def test_mode_is_compared(bench: Bench, mode: str, answer: bool) -> None:
    assert mode_is(ModeIsGoal(mode=mode, expected="nail"), bench.ctx) is answer
