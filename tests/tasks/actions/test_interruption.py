"""Going on after a kill: the hand comes out of feeder and plant, and a look settles what became of the dispenser."""

from __future__ import annotations

from collections.abc import Generator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.account import RESUMED
from grape.actions.core import Outcome
from grape.actions.hand_path import JOINT_OFFSETS
from grape.actions.obstacles import OBSTACLES, Obstacles, remember_obstacles
from grape.actions.rocking import up_in_base
from grape.errors import Reason
from grape.geometry import pose, rotation_x, transform
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.check_deployment import CheckDeploymentGoal, check_deployment
from grape.tasks.dispenser.actions.check_hand import CheckHandGoal, check_hand
from grape.tasks.dispenser.actions.drive_to_plant import PARKED, STANDING, DriveToPlantGoal, drive_to_plant
from grape.tasks.dispenser.actions.grasp_dispenser import GraspDispenserGoal, grasp_dispenser
from grape.tasks.dispenser.actions.hang_dispenser import HangDispenserGoal, hang_dispenser
from grape.tasks.dispenser.actions.holds_dispenser import HoldsDispenserGoal, holds_dispenser
from grape.tasks.dispenser.actions.lower_onto_target import LowerOntoTargetGoal, lower_onto_target
from grape.tasks.dispenser.actions.next_target import NextTargetGoal, next_target
from grape.tasks.dispenser.actions.recall_targets import RecallTargetsGoal, recall_targets
from grape.tasks.dispenser.actions.settle_account import SettleAccountGoal, settle_account
from grape.tasks.dispenser.actions.withdraw_hand import CLEAR_M, WithdrawHandGoal, withdraw_hand
from grape.tasks.dispenser.conditions import RemembersTargetsGoal, interrupted, remembers_targets
from grape.tasks.dispenser.feeder import hand_at_feeder
from grape.tasks.dispenser.targets import AIM_DEPTH_M, RETREAT_M, HangTarget, hang_line

GRIPPER, FEEDER = DESCRIPTION.gripper, DESCRIPTION.feeder
TOP = FEEDER.levels - 1


def cut_off(bench: Bench, action: Generator[Any, None, Any], seconds: float) -> None:
    """Runs an action for a while and takes it away, as a kill does; what was only in memory is gone."""
    for _ in range(round(seconds * 100)):
        next(action)
        bench.advance()
    action.close()
    bench.world.committed.clear()
    bench.world.committed[RESUMED] = True
    bench.advance(30)


def withdraw(bench: Bench) -> None:
    bench.run(withdraw_hand(WithdrawHandGoal(), bench.ctx))


def settle(bench: Bench) -> None:
    bench.run(settle_account(SettleAccountGoal(), bench.ctx))


def fingers_open(bench: Bench) -> float:
    return float((bench.fingers.angles[1] - GRIPPER.closed_angle) / (GRIPPER.open_angle - GRIPPER.closed_angle))


def height_over_seat(bench: Bench, level: int) -> Any:
    """(3,) m from the loop's place to the nails."""
    nails = bench.hand @ bench.robot.hand.T_hand_nails(float(bench.fingers.angles[1]))
    return nails[:3, 3] - FEEDER.T_base_link_level(level)[:3, 3]


@pytest.mark.parametrize(
    ("seconds", "taken"), [(0.02, False), (0.8, False), (2.4, False), (2.8, True), (3.2, True), (4.5, True)]
)
def test_a_grasp_that_was_cut_off_is_undone_or_completed(bench: Bench, seconds: float, taken: bool) -> None:
    bench.put_hand(hand_at_feeder(bench.robot, 4, 0.0))
    cut_off(bench, grasp_dispenser(GraspDispenserGoal(level=4), bench.ctx), seconds)
    heights = [height_over_seat(bench, 4)]
    action = withdraw_hand(WithdrawHandGoal(), bench.ctx)
    for _ in action:
        bench.advance()
        heights.append(height_over_seat(bench, 4))
    offsets = np.array(heights)
    clear = (TOP - 4) * FEEDER.pitch + 0.12
    assert offsets[-1, 2] == pytest.approx(clear, abs=0.01)
    assert (fingers_open(bench) > 0.9) == taken
    lifting = offsets[offsets[:, 2] > 0.012]
    if taken:
        assert (lifting[:, 0] < -0.02).all(), "dragged out from under the level above before it is lifted"
    else:
        assert np.abs(lifting[:, :2]).max() < 0.006, "straight up"


@pytest.mark.parametrize("held", [True, False])
def test_a_look_tells_whether_the_grasp_had_succeeded(bench: Bench, held: bool) -> None:
    bench.put_hand(hand_at_feeder(bench.robot, 7, 0.0))
    cut_off(bench, grasp_dispenser(GraspDispenserGoal(level=7), bench.ctx), 3.0)
    withdraw(bench)
    bench.scene.held = held
    assert interrupted(None, bench.ctx)  # type: ignore[arg-type]
    settle(bench)
    assert bench.ledger.account()["on_hand"] == held and bench.ledger.account()["left"] == 8 - held
    assert not interrupted(None, bench.ctx)  # type: ignore[arg-type]
    settle(bench)
    assert bench.ledger.account()["on_hand"] == held, "settling twice changes nothing"


def nail_in_hand(bench: Bench, task: SimpleNamespace, back_off: float = 0.0) -> HangTarget:
    target = task.put_nail(bench)
    bench.ledger.move_dispenser("feeder", "hand")
    task.at_target(bench, target, back_off)
    return target


def hang_there(bench: Bench, target: HangTarget) -> None:
    bench.scene.wings = [target.tip - np.array([side * 0.02, 0.0, 0.07]) for side in (-1.0, 1.0)]


@pytest.mark.parametrize("seconds", [0.02, 0.7, 1.5, 2.2, 3.0, 4.1])
def test_a_release_that_was_cut_off_is_completed_and_the_plant_finished(
    bench: Bench, task: SimpleNamespace, seconds: float
) -> None:
    target = nail_in_hand(bench, task)
    cut_off(bench, hang_dispenser(HangDispenserGoal(target=target), bench.ctx), seconds)
    withdraw(bench)
    assert fingers_open(bench) < 0.05
    backed_off = hang_line(bench.robot, target, 0.1)[3]
    assert bench.hand[:3, 3] == pytest.approx(backed_off[:3, 3], abs=0.012)
    hang_there(bench, target)
    settle(bench)
    assert bench.ledger.dispensers()["n0"] == 1 and bench.ledger.account()["on_hand"] == 0
    assert bench.ledger.plants()[0].outcome is Outcome.DEPLOYED
    place = bench.hand
    withdraw(bench)
    assert bench.hand[:3, 3] == pytest.approx(place[:3, 3], abs=1e-3), "a finished plant is left alone"


def test_a_release_that_was_cut_off_and_presses_is_taken_back_with_its_dispenser(
    bench: Bench, task: SimpleNamespace
) -> None:
    target = nail_in_hand(bench, task)
    cut_off(bench, hang_dispenser(HangDispenserGoal(target=target), bench.ctx), 0.9)
    narrowest = 1.0
    for _ in withdraw_hand(WithdrawHandGoal(), bench.ctx):
        bench.advance()
        narrowest = min(narrowest, fingers_open(bench))
        bench.world.felt = 0.4 if fingers_open(bench) < 0.5 else 0.1
    assert 0.4 < narrowest < 0.5 and fingers_open(bench) > 0.95
    final = target.hand_pose(bench.robot.hand.T_hand_nails(GRIPPER.open_angle))
    away = (bench.hand[:3, 3] - final[:3, 3]) @ target.approach
    assert away == pytest.approx(CLEAR_M + AIM_DEPTH_M, abs=0.01), "back over the tip, the way it came"
    place, bench.world.felt = bench.hand, 0.1
    withdraw(bench)
    assert fingers_open(bench) > 0.95 and bench.hand == pytest.approx(place, abs=1e-3), "the dispenser is not dropped"
    bench.scene.held = True
    settle(bench)
    assert bench.ledger.account()["on_hand"] == 1 and bench.ledger.account()["deployed"] == 0


def test_a_hand_that_has_left_the_plant_for_another_look_stays_where_it_is(bench: Bench, task: SimpleNamespace) -> None:
    target = nail_in_hand(bench, task)
    bench.run(hang_dispenser(HangDispenserGoal(target=target), bench.ctx))
    look = check_deployment(CheckDeploymentGoal(target=target), bench.ctx)
    while not any(kind == "plan" for kind, _ in bench.log.events):
        next(look)
        bench.advance()
    cut_off(bench, look, 2.0)
    place = bench.hand
    withdraw(bench)
    assert bench.hand[:3, 3] == pytest.approx(place[:3, 3], abs=1e-3)


def test_a_hand_that_looks_again_from_near_the_plant_stays_where_it_is(bench: Bench, task: SimpleNamespace) -> None:
    target = nail_in_hand(bench, task)
    bench.run(hang_dispenser(HangDispenserGoal(target=target), bench.ctx))
    bench.put_hand(bench.hand @ pose(rotation_x(-0.6), (0.0, -0.05, -0.06)))
    place = bench.hand
    withdraw(bench)
    assert bench.hand[:3, 3] == pytest.approx(place[:3, 3], abs=1e-3), "it has left the plant before"


@pytest.mark.parametrize("part", ["arm", "fingers"])
def test_what_cannot_complete_a_release_leaves_the_rest_to_the_look(
    bench: Bench, task: SimpleNamespace, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = nail_in_hand(bench, task)
    cut_off(bench, hang_dispenser(HangDispenserGoal(target=target), bench.ctx), 2.2 if part == "arm" else 0.4)
    bench.arm.stuck = part == "arm"
    if part == "fingers":
        monkeypatch.setattr(bench.fingers, "send", lambda position: position)
    withdraw(bench)
    assert bench.log.last("release_hindered")["reason"] == "tracking_error"
    settle(bench)
    assert not interrupted(None, bench.ctx), "the mission goes on"  # type: ignore[arg-type]


def test_a_release_of_which_nothing_is_seen_is_lost_once(bench: Bench, task: SimpleNamespace) -> None:
    target = nail_in_hand(bench, task)
    cut_off(bench, hang_dispenser(HangDispenserGoal(target=target), bench.ctx), 3.0)
    withdraw(bench)
    for _ in range(2):
        settle(bench)
        assert bench.ledger.account() == {"loaded": 8, "deployed": 0, "left": 7, "lost": 1, "on_hand": 0}
    assert bench.ledger.plants()[0].outcome is None, "the plant is still to be served"


@pytest.mark.parametrize(
    ("held", "hangs", "place"), [(True, False, "on_hand"), (False, True, "deployed"), (False, False, "lost")]
)
def test_servoing_that_was_cut_off_is_left_and_looked_at(
    bench: Bench, task: SimpleNamespace, held: bool, hangs: bool, place: str
) -> None:
    target = nail_in_hand(bench, task, 0.08)
    cut_off(bench, lower_onto_target(LowerOntoTargetGoal(target=target), bench.ctx), 1.8)
    withdraw(bench)
    final = target.hand_pose(bench.robot.hand.T_hand_nails(GRIPPER.open_angle))
    away = (bench.hand[:3, 3] - final[:3, 3]) @ target.approach
    assert away == pytest.approx(CLEAR_M + AIM_DEPTH_M, abs=0.01) and fingers_open(bench) > 0.95
    bench.scene.held = held
    if hangs:
        hang_there(bench, target)
    settle(bench)
    assert bench.ledger.account()[place] == 1 and bench.ledger.account()["left"] == 7
    assert (bench.ledger.plants()[0].outcome is Outcome.DEPLOYED) == hangs


@pytest.mark.parametrize("hangs", [True, False])
@pytest.mark.parametrize("done", ["looking", "booked"])
def test_a_look_at_a_plant_that_was_cut_off_is_made_again(
    bench: Bench, task: SimpleNamespace, hangs: bool, done: str
) -> None:
    """Cut off while it looks, or when the account has it on the plant that is not finished yet."""
    target = nail_in_hand(bench, task, 0.14)
    with pytest.raises(RuntimeError), bench.ledger.step("place", "n0", target=target.as_record()):
        raise RuntimeError
    if done == "looking":
        run = check_hand(CheckHandGoal(), bench.ctx)
        while not any(kind == "check" for kind, _ in bench.log.events):
            next(run)
            bench.advance()
        cut_off(bench, run, 0.05)
    else:
        bench.ledger.move_dispenser("hand", "n0")
    if hangs:
        hang_there(bench, target)
    bench.camera.frozen = True
    withdraw(bench)
    assert bench.failure(settle_account(SettleAccountGoal(), bench.ctx)).reason is Reason.STALE_DATA
    bench.camera.frozen = False
    bench.advance(30)
    withdraw(bench)
    settle(bench)
    assert bench.ledger.account()["deployed" if hangs else "lost"] == 1 and bench.ledger.account()["on_hand"] == 0
    assert (bench.ledger.plants()[0].outcome is Outcome.DEPLOYED) == hangs
    assert bench.log.last("settled")["hangs"] == hangs


def test_a_dispenser_that_was_carried_and_is_gone_is_lost(bench: Bench) -> None:
    bench.ledger.move_dispenser("feeder", "hand")
    with bench.ledger.step("approach", "n0"):
        pass
    settle(bench)
    assert bench.ledger.account()["lost"] == 1


def test_what_was_known_of_the_stop_is_known_again(bench: Bench, task: SimpleNamespace) -> None:
    target = task.spur_target(bench)
    seen = Obstacles(np.array([[0.4, 0.9, 0.5], [0.5, 0.9, 0.5]]), up=up_in_base(bench.ctx))
    bench.ledger.remember("parked", ["v0", 0.1, 0.55])
    bench.ledger.remember(JOINT_OFFSETS, [0.01, 0.0, -0.02, 0.0, 0.0, 0.0])
    remember_obstacles(bench.ctx, seen)
    bench.run(next_target(NextTargetGoal(plant="v0", targets=(target, target)), bench.ctx))
    bench.world.committed.clear()
    bench.world.committed[RESUMED] = True
    withdraw(bench)
    recalled = bench.world.committed[OBSTACLES]
    assert recalled.cloud == pytest.approx(seen.cloud) and recalled.up == pytest.approx(seen.up)
    assert bench.world.committed[JOINT_OFFSETS] == pytest.approx([0.01, 0.0, -0.02, 0.0, 0.0, 0.0])
    assert remembers_targets(RemembersTargetsGoal(plant="v0"), bench.ctx)
    assert not remembers_targets(RemembersTargetsGoal(plant="v1"), bench.ctx)
    targets = bench.run(recall_targets(RecallTargetsGoal(plant="v0"), bench.ctx)).targets
    assert len(targets) == 2 and transform(np.eye(4), targets[0].tip) == pytest.approx(target.tip)
    place = bench.base.pose
    bench.run(drive_to_plant(DriveToPlantGoal(plant="v0"), bench.ctx))
    assert (bench.base.pose == place).all(), "the base stays where it stands"
    assert STANDING not in bench.world.committed


def test_a_mission_that_was_not_interrupted_keeps_what_it_knows_of_the_stop(
    bench: Bench, task: SimpleNamespace
) -> None:
    target = nail_in_hand(bench, task)
    followed = Obstacles(np.array([[0.4, 1.9, 0.57]]), up=up_in_base(bench.ctx))
    remember_obstacles(bench.ctx, Obstacles(followed.cloud - [0.0, 0.0, 0.07]))
    bench.ledger.remember(PARKED, ["n0", 0.3, 0.62])
    known = {PARKED: ("n0", 0.3, 0.62), OBSTACLES: followed}
    bench.world.committed.update(known)
    with pytest.raises(RuntimeError), bench.ledger.step("place", "n0", target=target.as_record()):
        raise RuntimeError
    bench.scene.askew = (0.04, 0.0, 0.0)
    assert bench.failure(holds_dispenser(HoldsDispenserGoal(), bench.ctx)).reason is Reason.DISPENSER_FALLEN
    assert bench.arm.sent > 0, "the hand was withdrawn"
    assert bench.world.committed == known and bench.world.committed[OBSTACLES] is followed


def test_nothing_is_moved_when_nothing_was_begun(bench: Bench) -> None:
    withdraw(bench)
    settle(bench)
    assert bench.arm.sent == 0 and bench.ledger.account()["left"] == 8


def test_the_hand_backs_off_as_far_as_a_release_does(bench: Bench, task: SimpleNamespace) -> None:
    line = hang_line(bench.robot, task.put_nail(bench), 0.1)
    assert np.linalg.norm(line[3][:3, 3] - line[2][:3, 3]) == pytest.approx(RETREAT_M)
