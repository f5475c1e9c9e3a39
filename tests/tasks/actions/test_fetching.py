"""Fetching a dispenser: looking into the feeder, servoing on its markers, taking a loop, and the account of it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from paper_robot import Bench

from grape.errors import Reason
from grape.geometry import pose, pose_error, transform
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.check_feeder import FEEDER_EMPTY, CheckFeederGoal, check_feeder
from grape.tasks.dispenser.actions.check_grasp import CheckGraspGoal, check_grasp
from grape.tasks.dispenser.actions.grasp_dispenser import GraspDispenserGoal, grasp_dispenser
from grape.tasks.dispenser.actions.holds_dispenser import HoldsDispenserGoal, holds_dispenser
from grape.tasks.dispenser.actions.servo_to_feeder import ServoToFeederGoal, servo_to_feeder
from grape.tasks.dispenser.feeder import VIEW_M, hand_at_feeder

GRIPPER = DESCRIPTION.gripper
QUICK = CheckFeederGoal(timeout_s=1.0)


def over_feeder(bench: Bench, level: int = 7, height: float = VIEW_M) -> None:
    bench.put_hand(hand_at_feeder(bench.robot, level, height))


@pytest.mark.parametrize("dispensers", [8, 4, 1])
def test_the_dispenser_on_top_is_found(bench: Bench, task: SimpleNamespace, dispensers: int) -> None:
    task.fill_feeder(bench, dispensers)
    assert bench.run(check_feeder(CheckFeederGoal(), bench.ctx)).level == dispensers - 1
    account = bench.ledger.account()
    assert (account["left"], account["lost"], account["on_hand"]) == (dispensers, 8 - dispensers, 0)
    assert bench.ctx.arm.owner is None and bench.ctx.gripper.owner is None


def test_more_dispensers_than_the_ledger_knows_are_no_gain(bench: Bench, task: SimpleNamespace) -> None:
    for _ in range(3):
        bench.ledger.move_dispenser("feeder", "lost")
    task.fill_feeder(bench, 8)
    bench.run(check_feeder(CheckFeederGoal(), bench.ctx))
    assert bench.ledger.account()["left"] == 5


def test_an_empty_feeder_is_remembered(bench: Bench, task: SimpleNamespace) -> None:
    task.fill_feeder(bench, 0)
    failure = bench.failure(check_feeder(QUICK, bench.ctx))
    assert failure.reason is Reason.FEEDER_EMPTY
    assert bench.world.committed[FEEDER_EMPTY]
    assert bench.ledger.account() == {"loaded": 8, "deployed": 0, "left": 0, "lost": 8, "on_hand": 0}
    sent = bench.arm.sent
    again = bench.failure(check_feeder(QUICK, bench.ctx), limit_s=0.1)
    assert again.reason is Reason.FEEDER_EMPTY and bench.arm.sent == sent, "it does not look a second time"


def test_a_feeder_without_markers_in_view_is_unclear_not_empty(bench: Bench) -> None:
    failure = bench.failure(check_feeder(QUICK, bench.ctx))
    assert failure.reason is Reason.FEATURE_LOST
    assert not bench.world.committed.get(FEEDER_EMPTY) and bench.ledger.account()["left"] == 8
    assert "feeder" in bench.log.pictures


def test_one_wing_of_two_is_unclear_not_empty(bench: Bench, task: SimpleNamespace) -> None:
    task.fill_feeder(bench, 3)
    bench.scene.wings.pop()
    failure = bench.failure(check_feeder(QUICK, bench.ctx))
    assert failure.reason is Reason.FEATURE_LOST and "1 of 2 wings" in failure.detail
    assert bench.ledger.account()["left"] == 8


def test_a_feeder_that_the_camera_cannot_show_is_stale(bench: Bench) -> None:
    bench.camera.frozen = True
    assert bench.failure(check_feeder(QUICK, bench.ctx)).reason is Reason.STALE_DATA
    assert bench.ctx.arm.owner is None and bench.ledger.account()["left"] == 8


@pytest.mark.parametrize(("shown", "tolerance_m"), [((1, 2), 0.0015), ((1,), 0.004), ((2,), 0.004)])
def test_nails_are_led_into_the_loop_by_either_marker(
    bench: Bench, task: SimpleNamespace, shown: tuple[int, ...], tolerance_m: float
) -> None:
    task.fill_feeder(bench, 5)
    bench.scene.markers = {id: bench.scene.markers[id] for id in shown}
    over_feeder(bench)
    bench.run(servo_to_feeder(ServoToFeederGoal(level=4), bench.ctx))
    error = pose_error(hand_at_feeder(bench.robot, 4, 0.0), bench.hand)
    assert np.linalg.norm(error[:3]) < tolerance_m and np.linalg.norm(error[3:]) < 0.03
    servo = bench.log.last("servo")
    assert servo["action"] == "ServoToFeeder" and servo["error_px"] < 0.4
    assert bench.ctx.arm.owner is None and not bench.arm.velocity.any()


def test_servoing_corrects_a_feeder_that_is_not_where_kinematics_say(bench: Bench, task: SimpleNamespace) -> None:
    task.fill_feeder(bench, 8)
    shift = np.array([0.012, -0.009, 0.006])
    bench.scene.markers = {id: pose(None, shift) @ T for id, T in bench.scene.markers.items()}
    over_feeder(bench)
    bench.run(servo_to_feeder(ServoToFeederGoal(level=7), bench.ctx))
    assert bench.hand[:3, 3] - hand_at_feeder(bench.robot, 7, 0.0)[:3, 3] == pytest.approx(shift, abs=0.0015)


def test_servoing_without_markers_is_given_up(bench: Bench) -> None:
    over_feeder(bench)
    failure = bench.failure(servo_to_feeder(ServoToFeederGoal(level=7), bench.ctx))
    assert failure.reason is Reason.FEATURE_LOST
    assert bench.ctx.arm.owner is None and not bench.arm.velocity.any()


def test_servoing_that_does_not_settle_in_time_is_given_up(bench: Bench, task: SimpleNamespace) -> None:
    task.fill_feeder(bench, 8)
    over_feeder(bench)
    failure = bench.failure(servo_to_feeder(ServoToFeederGoal(level=7, timeout_s=1.0), bench.ctx))
    assert failure.reason is Reason.NOT_CONVERGED and "px" in failure.detail


def test_nails_stay_in_place_while_the_fingers_open_then_rise_drag_and_lift(bench: Bench) -> None:
    goal = GraspDispenserGoal(level=3)
    over_feeder(bench, level=3, height=0.0)
    begin, track = transform(bench.hand, bench.robot.hand.nail(GRIPPER.closed_angle) * [0, 1, 1]), []
    for feedback in grasp_dispenser(goal, bench.ctx):
        bench.advance()
        nails = bench.hand @ bench.robot.hand.T_hand_nails(float(bench.fingers.angles[1]))
        track.append((feedback.status, nails[:3, 3] - begin))
    opening, raising, dragging, lifting = (
        np.array([shift for status, shift in track if status.startswith(word)])
        for word in ("opening", "raising", "dragging", "lifting")
    )
    lift = 4 * DESCRIPTION.feeder.pitch + goal.clear_m
    assert bench.fingers.angles[1:] == pytest.approx(GRIPPER.open_angle, abs=0.01)
    assert np.abs(opening).max() < 0.001
    assert raising[-1] == pytest.approx([0.0, 0.0, goal.rise_m], abs=0.001)
    assert dragging[-1] == pytest.approx([-goal.drag_m, 0.0, goal.rise_m], abs=0.001)
    assert lifting[-1] == pytest.approx([-goal.drag_m, 0.0, goal.rise_m + lift], abs=0.001)
    assert np.abs(lifting[:, 0] + goal.drag_m).max() < 0.001, "straight up"
    assert bench.ctx.arm.owner is None and bench.ctx.gripper.owner is None


def open_fingers(bench: Bench) -> None:
    bench.fingers.angles = bench.fingers.target = np.array([1.5, GRIPPER.open_angle, GRIPPER.open_angle])
    bench.advance(20)


def test_a_dispenser_on_the_nails_is_on_the_account(bench: Bench) -> None:
    open_fingers(bench)
    bench.scene.held = True
    bench.run(check_grasp(CheckGraspGoal(), bench.ctx))
    assert bench.ledger.account() == {"loaded": 8, "deployed": 0, "left": 7, "lost": 0, "on_hand": 1}
    assert bench.log.last("check")["value"] is True and bench.log.pictures == ["grasp"]


def test_when_another_is_taken_the_one_that_hung_askew_has_fallen(bench: Bench) -> None:
    open_fingers(bench)
    bench.ledger.move_dispenser("feeder", "hand")
    bench.scene.held = True
    bench.run(check_grasp(CheckGraspGoal(), bench.ctx))
    assert bench.ledger.account() == {"loaded": 8, "deployed": 0, "left": 6, "lost": 1, "on_hand": 1}


def test_empty_nails_are_a_failed_grasp_and_cost_nothing(bench: Bench) -> None:
    open_fingers(bench)
    failure = bench.failure(check_grasp(CheckGraspGoal(), bench.ctx))
    assert failure.reason is Reason.GRASP_FAILED and "0 wings seen" in failure.detail
    assert bench.ledger.account()["left"] == 8 and bench.log.pictures == ["grasp"]


def test_nothing_held_by_the_account_needs_no_look(bench: Bench) -> None:
    bench.camera.silent = True
    failure = bench.failure(holds_dispenser(HoldsDispenserGoal(), bench.ctx), limit_s=0.1)
    assert failure.reason is Reason.GRASP_FAILED


@pytest.mark.parametrize("held", [True, False])
def test_a_grasp_that_nobody_has_seen_is_looked_at_where_a_dispenser_is_asked_for(bench: Bench, held: bool) -> None:
    open_fingers(bench)
    with bench.ledger.step("grasp", level=7):
        pass
    bench.camera.frozen = True
    assert bench.failure(holds_dispenser(HoldsDispenserGoal(), bench.ctx)).reason is Reason.STALE_DATA
    bench.camera.frozen, bench.scene.held = False, held
    bench.advance(30)
    if held:
        bench.run(holds_dispenser(HoldsDispenserGoal(), bench.ctx))
    else:
        assert bench.failure(holds_dispenser(HoldsDispenserGoal(), bench.ctx)).reason is Reason.GRASP_FAILED
    assert bench.ledger.account()["on_hand"] == held and bench.ledger.account()["left"] == 8 - held


def test_what_the_hand_holds_by_account_and_camera_is_kept(bench: Bench) -> None:
    open_fingers(bench)
    bench.ledger.move_dispenser("feeder", "hand")
    bench.scene.held = True
    bench.run(holds_dispenser(HoldsDispenserGoal(), bench.ctx))
    assert bench.ledger.account()["on_hand"] == 1


def test_what_fell_on_the_way_is_lost(bench: Bench) -> None:
    open_fingers(bench)
    bench.ledger.move_dispenser("feeder", "hand")
    failure = bench.failure(holds_dispenser(HoldsDispenserGoal(), bench.ctx))
    assert failure.reason is Reason.DISPENSER_FALLEN
    assert bench.ledger.account() == {"loaded": 8, "deployed": 0, "left": 7, "lost": 1, "on_hand": 0}
