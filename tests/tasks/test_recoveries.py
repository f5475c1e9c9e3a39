"""What the built-in tree does when work on a vine fails; its actions follow a script, its conditions are real."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from paper_robot import Bench

import grape.trees
from grape.actions.account import Outcome
from grape.actions.core import Action, Context, Feedback
from grape.bt import TreeExecutor, load_tree, node_library
from grape.errors import ActionFailed, Reason
from grape.tasks.dispenser import TASK
from grape.tasks.dispenser.targets import HangTarget

TREE = Path(grape.trees.__file__).with_name("dispenser_deployment.xml")
REAL = {"NextTarget", "FinishPlant"}
Script = dict[str, list[Reason | None]]


def spur(x: float) -> HangTarget:
    return HangTarget(
        plant="v0", kind="spur", tip=np.array([x, 0.9, 0.6]), direction=np.array([0.0, 0.0, 1.0]), pitch=1.0
    )


def result_of(action: Action[Any, Any], goal: Any, targets: tuple[HangTarget, ...]) -> Any:
    """What an action gives that does what it is asked to."""
    target = getattr(goal, "target", None)
    given = {
        "ScanVine": {"scan": None}, "FindDeploymentPoints": {"targets": targets}, "CheckFeeder": {"level": 0},
        "ApproachSpur": {"approached": target}, "ServoToSpur": {"refined": target},
        "LowerOntoTarget": {"reached": target}, "BackOff": {"backed_m": 0.6},
    }  # fmt: skip
    return action.result_type(**given.get(action.name, {}))


class Play:
    """The tree with scripted actions: each takes the next outcome of its list, and succeeds when none is left.

    Args:
        fallen_onto: the plant on which a dispenser that fell while it was brought is found hanging.
    """

    def __init__(
        self, bench: Bench, script: Script, targets: tuple[HangTarget, ...], mode: str, fallen_onto: str = ""
    ) -> None:
        self.steps: list[tuple[str, Any]] = []
        self._fallen_onto = fallen_onto
        self._script, self._targets = defaultdict(list, script), targets
        actions = [a if a.name in REAL else replace(a, function=self._stub(a)) for a in TASK.actions]
        tree = load_tree(
            TREE, node_library([*actions, *TASK.conditions]), main="ServePlant", inputs={"plant": str, "mode": str}
        )
        self._executor = TreeExecutor(tree, bench.ctx, {"plant": "v0", "mode": mode}, trace=True)
        for _ in range(400):
            if self._executor.tick() != "active":
                break

    def names(self, *among: str) -> list[str]:
        return [name for name, _ in self.steps if name in among]

    def _stub(self, action: Action[Any, Any]) -> Any:
        def follow(goal: Any, ctx: Context) -> Generator[Feedback, None, Any]:
            yield Feedback(status="as the script says")
            self.steps.append((action.name, getattr(goal, "target", None)))
            outcomes = self._script[action.name]
            failure = outcomes.pop(0) if outcomes else None
            if action.name == "DriveToPlant":
                with ctx.ledger.step("drive", "v0", moves_base=True):
                    pass
            if action.name == "CheckHand" and self._fallen_onto and self.names("ApproachSpur"):
                ctx.ledger.finish(self._fallen_onto, Outcome.DEPLOYED)
            if failure is not None:
                raise ActionFailed(failure, "as the script says")
            return result_of(action, goal, self._targets)

        return follow


LOST, SLOW = Reason.FEATURE_LOST, Reason.NOT_CONVERGED


def outcome(bench: Bench) -> tuple[Any, str]:
    task = next(task for task in bench.ledger.plants() if task.plant == "v0")
    return task.outcome, task.reason


def test_when_servoing_fails_on_every_spur_the_best_one_is_tried_open_loop(bench: Bench) -> None:
    play = Play(bench, {"ServoToSpur": [LOST, SLOW]}, (spur(0.3), spur(0.6)), "plant")
    assert play.names("ServoToSpur", "LowerOntoTarget", "CheckDeployment") == [
        "ServoToSpur", "ServoToSpur", "LowerOntoTarget", "CheckDeployment",
    ]  # fmt: skip
    lowered = next(target for name, target in play.steps if name == "LowerOntoTarget")
    assert lowered.tip[0] == 0.3 and outcome(bench)[0] == "deployed"


def test_what_the_last_look_says_counts_for_the_open_loop_too(bench: Bench) -> None:
    check = {"ServoToSpur": [LOST], "CheckDeployment": [Reason.DEPLOYMENT_NOT_CONFIRMED]}
    Play(bench, check, (spur(0.3),), "plant")
    assert outcome(bench) == ("skipped", "deployment_not_confirmed")


@pytest.mark.parametrize("reason", [Reason.DEPLOYMENT_NOT_CONFIRMED, Reason.TRACKING_ERROR])
def test_other_failures_are_not_tried_open_loop(bench: Bench, reason: Reason) -> None:
    play = Play(bench, {"HangDispenser": [reason] * 9}, (spur(0.3),), "plant")
    assert not play.names("LowerOntoTarget") and outcome(bench) == ("skipped", str(reason))


def test_open_loop_mode_is_not_tried_once_more(bench: Bench) -> None:
    play = Play(bench, {"LowerOntoTarget": [LOST] * 9}, (spur(0.3),), "plant_open_loop")
    assert play.names("LowerOntoTarget", "ServoToSpur") == ["LowerOntoTarget"]


@pytest.mark.parametrize("step", ["FindDeploymentPoints", "ApproachSpur"])
def test_the_robot_stops_anew_once_when_nothing_is_reached(bench: Bench, step: str) -> None:
    play = Play(bench, {step: [Reason.UNREACHABLE] * 9}, (spur(0.3),), "plant")
    assert play.names("DriveToPlant") == ["DriveToPlant"] * 2
    assert outcome(bench) == ("skipped", "unreachable")


def test_a_first_stop_that_serves_is_the_only_one(bench: Bench) -> None:
    play = Play(bench, {}, (spur(0.3),), "plant")
    assert play.names("DriveToPlant", "ScanVine", "CheckDeployment") == ["DriveToPlant", "ScanVine", "CheckDeployment"]
    assert outcome(bench)[0] == "deployed"


def test_a_blocked_way_is_tried_again_after_the_robot_gave_way(bench: Bench) -> None:
    play = Play(bench, {"DriveToPlant": [Reason.BLOCKED]}, (spur(0.3),), "plant")
    assert play.names("DriveToPlant", "BackOff", "Wait", "ScanVine") == [
        "DriveToPlant", "BackOff", "Wait", "DriveToPlant", "ScanVine",
    ]  # fmt: skip
    assert outcome(bench)[0] == "deployed"


def test_a_plant_whose_way_stays_blocked_is_skipped_with_that_reason(bench: Bench) -> None:
    script = {"DriveToPlant": [Reason.BLOCKED] * 9, "BackOff": [Reason.BLOCKED]}
    play = Play(bench, script, (spur(0.3),), "plant")
    assert play.names("DriveToPlant", "BackOff", "Wait") == ["DriveToPlant", "BackOff", "Wait", "DriveToPlant"]
    assert outcome(bench) == ("skipped", "blocked")


def test_a_stop_from_which_nothing_is_reached_needs_no_giving_way(bench: Bench) -> None:
    play = Play(bench, {"ApproachSpur": [Reason.UNREACHABLE] * 9}, (spur(0.3),), "plant")
    assert not play.names("BackOff", "Wait")


@pytest.mark.parametrize("look", [[], [Reason.UNREACHABLE] * 9])
def test_the_arm_is_retracted_after_the_last_look_at_the_hand(bench: Bench, look: list[Reason | None]) -> None:
    play = Play(bench, {"ApproachSpur": look}, (spur(0.3),), "plant")
    assert play.names("CheckHand", "Retract", "DriveToPlant")[-4:] == ["CheckHand", "Retract"] * 2


NOTHING, FELL = Reason.GRASP_FAILED, Reason.DISPENSER_FALLEN


def test_when_a_dispenser_falls_on_its_way_another_one_is_brought_to_the_same_spur(bench: Bench) -> None:
    play = Play(bench, {"HoldsDispenser": [NOTHING, FELL, NOTHING]}, (spur(0.3),), "plant")
    assert play.names("GraspDispenser", "ApproachSpur", "ServoToSpur", "CheckDeployment") == [
        "GraspDispenser", "ApproachSpur", "GraspDispenser", "ApproachSpur", "ServoToSpur", "CheckDeployment",
    ]  # fmt: skip
    assert outcome(bench)[0] == "deployed"


SILENT = Reason.STALE_DATA


def test_a_dispenser_that_a_silent_camera_does_not_show_is_kept_and_no_other_is_fetched(bench: Bench) -> None:
    play = Play(bench, {"HoldsDispenser": [SILENT, SILENT]}, (spur(0.3),), "plant")
    assert play.names("HoldsDispenser", "CheckFeeder", "ApproachSpur") == [
        "HoldsDispenser", "HoldsDispenser", "HoldsDispenser", "ApproachSpur", "HoldsDispenser",
    ]  # fmt: skip
    assert outcome(bench)[0] == "deployed"


def test_a_grasp_that_a_silent_camera_does_not_show_is_looked_at_again_before_the_fingers_close(bench: Bench) -> None:
    script = {"HoldsDispenser": [NOTHING, SILENT], "CheckGrasp": [SILENT]}
    play = Play(bench, script, (spur(0.3),), "plant")
    assert play.names("HoldsDispenser", "CheckFeeder", "CheckGrasp", "ApproachSpur") == [
        "HoldsDispenser", "CheckFeeder", "CheckGrasp", "HoldsDispenser", "HoldsDispenser", "ApproachSpur",
        "HoldsDispenser",
    ]  # fmt: skip
    assert outcome(bench)[0] == "deployed"


def test_a_plant_before_which_the_camera_stays_silent_is_skipped_and_nothing_dropped(bench: Bench) -> None:
    play = Play(bench, {"HoldsDispenser": [SILENT] * 99}, (spur(0.3), spur(0.6)), "plant")
    assert not play.names("CheckFeeder") and outcome(bench) == ("skipped", "stale_data")


def test_where_dispensers_keep_falling_the_plant_is_skipped(bench: Bench) -> None:
    play = Play(bench, {"HoldsDispenser": [NOTHING, FELL] * 9}, (spur(0.3), spur(0.6)), "plant")
    assert play.names("GraspDispenser") == ["GraspDispenser"] * 4 and not play.names("ServoToSpur")
    assert outcome(bench) == ("skipped", "dispenser_fallen")


def test_what_fell_onto_the_plant_and_hangs_there_needs_no_other_one(bench: Bench) -> None:
    play = Play(bench, {"HoldsDispenser": [NOTHING, FELL]}, (spur(0.3),), "plant", fallen_onto="v0")
    assert play.names("GraspDispenser") == ["GraspDispenser"] and outcome(bench)[0] == "deployed"
