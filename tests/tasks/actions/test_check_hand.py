"""A dispenser that falls at any phase is noticed before the robot drives on; a look that is not needed is not made."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.core import Outcome
from grape.errors import Reason
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.check_hand import CheckHandGoal, check_hand
from grape.tasks.dispenser.actions.holds_dispenser import HoldsDispenserGoal, holds_dispenser
from grape.tasks.dispenser.conditions import IsDeployedGoal, is_deployed
from grape.tasks.dispenser.targets import HangTarget


def look(bench: Bench, feeder: bool = False, limit_s: float = 60.0) -> None:
    bench.run(check_hand(CheckHandGoal(feeder=feeder), bench.ctx), limit_s)


def carried_to(bench: Bench, task: SimpleNamespace, step: str) -> HangTarget:
    """By the account a dispenser is in the hand, which stands before the nail after a step that has failed."""
    target: HangTarget = task.put_nail(bench)
    bench.ledger.move_dispenser("feeder", "hand")
    task.at_target(bench, target, 0.14)
    with pytest.raises(RuntimeError), bench.ledger.step(step, "n0", target=target.as_record()):
        raise RuntimeError
    bench.ledger.finish("n0", Outcome.SKIPPED, "feature_lost")
    return target


def test_no_time_is_spent_where_nothing_is_open(bench: Bench) -> None:
    bench.camera.silent = True
    look(bench, feeder=True, limit_s=0.05)
    assert bench.arm.sent == 0 and bench.ledger.account()["left"] == 8


@pytest.mark.parametrize("step", ["approach", "place", "release"])
@pytest.mark.parametrize("held", [True, False])
def test_what_fell_while_a_plant_was_served_in_vain_is_lost(
    bench: Bench, task: SimpleNamespace, step: str, held: bool
) -> None:
    carried_to(bench, task, step)
    bench.scene.held = held
    look(bench)
    assert not is_deployed(IsDeployedGoal(plant="n0"), bench.ctx)
    account = bench.ledger.account()
    assert (account["on_hand"], account["lost"], account["left"]) == (int(held), int(not held), 7)
    assert bench.log.last("check")["check"] == ("grasp" if held or step == "approach" else "deployment")
    assert bench.ledger.plants()[0].outcome is Outcome.SKIPPED
    assert (bench.arm.sent == 0) == (held or step == "approach"), "what is seen nowhere is looked for from aside"


def test_what_the_plant_pulled_off_the_hand_hangs_there(bench: Bench, task: SimpleNamespace) -> None:
    target = carried_to(bench, task, "place")
    bench.scene.wings = [target.tip - np.array([side * 0.02, 0.0, 0.07]) for side in (-1.0, 1.0)]
    look(bench)
    assert bench.ledger.dispensers()["n0"] == 1 and bench.ledger.account()["lost"] == 0
    assert is_deployed(IsDeployedGoal(plant="n0"), bench.ctx)


def test_a_new_attempt_knows_that_the_plant_has_it(bench: Bench, task: SimpleNamespace) -> None:
    target = carried_to(bench, task, "place")
    bench.scene.wings = [target.tip - np.array([side * 0.02, 0.0, 0.07]) for side in (-1.0, 1.0)]
    failure = bench.failure(holds_dispenser(HoldsDispenserGoal(), bench.ctx))
    assert failure.reason is Reason.DISPENSER_FALLEN
    assert bench.ledger.dispensers()["n0"] == 1 and bench.ledger.account()["lost"] == 0


@pytest.mark.parametrize("from_nail", [(0.04, 0.0, 0.0), (0.055, 0.08, 0.0)])
def test_what_hangs_from_one_nail_before_a_plant_does_not_hang_on_the_plant(
    bench: Bench, task: SimpleNamespace, from_nail: tuple[float, float, float]
) -> None:
    target = carried_to(bench, task, "place")
    task.at_target(bench, target, 0.0)
    bench.scene.askew = from_nail
    begin = bench.hand[:3, 3].copy()
    failure = bench.failure(holds_dispenser(HoldsDispenserGoal(), bench.ctx))
    assert failure.reason is Reason.DISPENSER_FALLEN and np.linalg.norm(bench.hand[:3, 3] - begin) > 0.05
    assert bench.ledger.dispensers()["n0"] == 0 and bench.ledger.account()["on_hand"] == 1
    look(bench)
    assert bench.ledger.account()["on_hand"] == 1 and not is_deployed(IsDeployedGoal(plant="n0"), bench.ctx)


@pytest.mark.parametrize(
    ("held", "dispensers", "place"), [(True, 7, "on_hand"), (False, 7, "lost"), (False, 8, "left")]
)
def test_a_grasp_that_nobody_could_confirm_is_settled_at_the_feeder(
    bench: Bench, task: SimpleNamespace, held: bool, dispensers: int, place: str
) -> None:
    with bench.ledger.step("grasp", level=7):
        pass
    before = bench.ledger.account()
    look(bench)
    assert bench.ledger.account() == before and bench.arm.sent == 0, "without the feeder only the hand is looked at"
    if held:
        bench.fingers.angles = bench.fingers.target = np.array([1.5, *[DESCRIPTION.gripper.open_angle] * 2])
        bench.advance(20)
    else:
        task.fill_feeder(bench, dispensers)
    bench.scene.held = held
    look(bench, feeder=True)
    assert bench.ledger.account()[place] == before[place] + (place != "left")
    assert sum(number for name, number in bench.ledger.account().items() if name != "loaded") == 8


def test_a_dispenser_that_was_given_up_for_lost_and_is_held_is_in_the_hand(bench: Bench) -> None:
    for _ in range(8):
        bench.ledger.move_dispenser("feeder", "lost")
    with bench.ledger.step("grasp", level=0):
        pass
    bench.fingers.angles = bench.fingers.target = np.array([1.5, *[DESCRIPTION.gripper.open_angle] * 2])
    bench.scene.held = True
    bench.advance(20)
    look(bench)
    assert bench.ledger.account() == {"loaded": 8, "deployed": 0, "left": 0, "lost": 7, "on_hand": 1}


def test_an_arm_that_tells_no_joint_angles_changes_nothing(
    bench: Bench, task: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    carried_to(bench, task, "place")
    sense = bench._sense

    def deaf() -> None:
        sense()
        bench.world.arm = None

    monkeypatch.setattr(bench, "_sense", deaf)
    bench.advance()
    look(bench)
    assert bench.log.last("not_looked")["reason"] == "stale_data"
    assert sum(bench.ledger.account()[place] for place in ("on_hand", "deployed")) == 1


@pytest.mark.parametrize("hangs", [True, False])
def test_a_release_that_nobody_looked_at_is_looked_at(bench: Bench, task: SimpleNamespace, hangs: bool) -> None:
    target = task.put_nail(bench)
    bench.ledger.move_dispenser("feeder", "n0")
    task.at_target(bench, target, 0.14)
    with bench.ledger.step("release", "n0", target=target.as_record()):
        pass
    bench.ledger.finish("n0", Outcome.SKIPPED, "stale_data")
    if hangs:
        bench.scene.wings = [target.tip - np.array([side * 0.02, 0.0, 0.07]) for side in (-1.0, 1.0)]
    look(bench)
    assert bench.ledger.plants()[0].outcome is (Outcome.DEPLOYED if hangs else Outcome.SKIPPED)
    assert bench.ledger.account()["deployed" if hangs else "lost"] == 1


@pytest.mark.parametrize("hangs", [True, False])
def test_nothing_hangs_by_the_account_until_it_was_seen_to(bench: Bench, task: SimpleNamespace, hangs: bool) -> None:
    target = carried_to(bench, task, "place")
    for _ in check_hand(CheckHandGoal(), bench.ctx):
        bench.advance()
        bench.camera.frozen = any(kind == "check" for kind, _ in bench.log.events)  # from after the look at the hand
    assert bench.log.last("not_looked")["reason"] == "stale_data"
    assert bench.ledger.account()["on_hand"] == 1 and bench.ledger.account()["deployed"] == 0
    bench.camera.frozen = False
    bench.advance(30)
    if hangs:
        bench.scene.wings = [target.tip - np.array([side * 0.02, 0.0, 0.07]) for side in (-1.0, 1.0)]
    look(bench)
    assert bench.ledger.account()["deployed" if hangs else "lost"] == 1
    assert is_deployed(IsDeployedGoal(plant="n0"), bench.ctx) == hangs


def test_a_camera_that_is_silent_changes_nothing(bench: Bench, task: SimpleNamespace) -> None:
    carried_to(bench, task, "place")
    bench.camera.frozen = True
    look(bench)
    assert bench.ledger.account()["on_hand"] == 1 and bench.log.last("not_looked")["reason"] == "stale_data"
