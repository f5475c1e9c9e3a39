"""Bringing a dispenser to nail or spur, servoing, letting go, and looking whether it hangs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.move_arm import checker_for
from grape.actions.obstacles import OBSTACLES, Obstacles
from grape.errors import ActionFailed, GoalRejected, Reason
from grape.geometry import pose_error
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.approach_nail import ApproachNailGoal, approach_nail
from grape.tasks.dispenser.actions.approach_spur import ApproachSpurGoal, approach_spur
from grape.tasks.dispenser.actions.check_deployment import CheckDeploymentGoal, check_deployment
from grape.tasks.dispenser.actions.hang_dispenser import HangDispenserGoal, hang_dispenser
from grape.tasks.dispenser.actions.lower_onto_target import LowerOntoTargetGoal, lower_onto_target
from grape.tasks.dispenser.actions.servo_to_nail import servo_to_nail
from grape.tasks.dispenser.actions.servo_to_spur import servo_to_spur
from grape.tasks.dispenser.servo_target import ServoToTargetGoal
from grape.tasks.dispenser.stops import margins_of, orientations
from grape.tasks.dispenser.targets import HangTarget

GRIPPER = DESCRIPTION.gripper


def nails(bench: Bench, angle: float = GRIPPER.open_angle):
    return bench.robot.hand.T_hand_nails(angle)


def in_hand(bench: Bench) -> None:
    bench.ledger.move_dispenser("feeder", "hand")
    bench.fingers.angles = bench.fingers.target = np.array(
        [GRIPPER.thumb_clear, GRIPPER.open_angle, GRIPPER.open_angle]
    )


def attempts(bench: Bench, plant: str) -> int:
    return next(task.attempts for task in bench.ledger.plants() if task.plant == plant)


def test_hand_comes_to_the_stand_off_before_the_nail(bench: Bench) -> None:
    in_hand(bench)
    target = bench.run(approach_nail(ApproachNailGoal(plant="n0"), bench.ctx)).target
    error = pose_error(target.hand_pose(nails(bench), 0.14), bench.hand)
    assert np.linalg.norm(error[:3]) < 0.01 and np.linalg.norm(error[3:]) < 0.03
    assert (target.plant, attempts(bench, "n0")) == ("n0", 1)
    assert bench.ctx.arm.owner is None


def test_a_vine_is_no_nail(bench: Bench) -> None:
    with pytest.raises(GoalRejected):
        bench.run(approach_nail(ApproachNailGoal(plant="v0"), bench.ctx))
    assert bench.arm.sent == 0 and attempts(bench, "v0") == 0, "a refused goal is no attempt"


def test_a_nail_beyond_the_arm_is_unreachable(bench: Bench) -> None:
    bench.base.pose = bench.base.pose - [0.0, 1.5, 0.0]
    bench.advance()
    assert bench.failure(approach_nail(ApproachNailGoal(plant="n0"), bench.ctx)).reason is Reason.UNREACHABLE


def test_hand_comes_above_the_spur_and_keeps_off_the_vine(bench: Bench, task: SimpleNamespace) -> None:
    in_hand(bench)
    target = task.spur_target(bench)
    cordon = np.array([[x, 0.84, 0.42] for x in np.arange(-0.3, 1.2, 0.01)])
    bench.world.committed[OBSTACLES] = Obstacles(cordon)
    bench.run(approach_spur(ApproachSpurGoal(target=target), bench.ctx))
    error = pose_error(target.hand_pose(nails(bench), 0.10), bench.hand)
    assert np.linalg.norm(error[:3]) < 0.01 and np.linalg.norm(error[3:]) < 0.03
    assert attempts(bench, "v0") == 1


def test_next_spur_is_approached_from_where_the_attempt_before_failed(bench: Bench, task: SimpleNamespace) -> None:
    in_hand(bench)
    target = task.spur_target(bench)
    task.at_target(bench, target)
    wood = target.tip + np.array([[x, 0.0, 0.0] for x in np.arange(-0.05, 0.05, 0.005)])
    bench.world.committed[OBSTACLES] = Obstacles(wood)
    assert not checker_for(bench.ctx).is_valid(bench.arm.q), "no plan can start here"
    bench.run(approach_spur(ApproachSpurGoal(target=target), bench.ctx))
    assert np.linalg.norm(pose_error(target.hand_pose(nails(bench), 0.10), bench.hand)[:3]) < 0.01


def test_the_hand_is_turned_where_no_way_leads_to_the_first_orientation(bench: Bench) -> None:
    spur = HangTarget(
        plant="v0", kind="spur", tip=np.array([0.25, 0.85, 0.65]), direction=np.array([0.0, 0.0, 1.0]), pitch=1.0
    )
    ways = orientations(spur)
    margins = margins_of(bench.robot, ways)
    abreast = ways[int(np.argmin(margins))]
    assert margins.min() == 0.0 and margins.max() > 0.3, "abreast of the arm some orientations are singular"
    approached = bench.run(approach_spur(ApproachSpurGoal(target=abreast), bench.ctx)).approached
    assert (approached.pitch, approached.azimuth) != (abreast.pitch, abreast.azimuth)
    assert np.linalg.norm(pose_error(approached.hand_pose(nails(bench), 0.10), bench.hand)[:3]) < 0.01
    assert bench.log.last("hand_turned")["plant"] == "v0"


def test_a_spur_behind_wood_is_unreachable(bench: Bench, task: SimpleNamespace) -> None:
    target = task.spur_target(bench)
    x, z = np.meshgrid(np.arange(-0.5, 1.5, 0.02), np.arange(-0.1, 1.5, 0.02))
    wall = np.column_stack([x.ravel(), np.full(x.size, 0.60), z.ravel()])
    bench.world.committed[OBSTACLES] = Obstacles(wall)
    assert bench.failure(approach_spur(ApproachSpurGoal(target=target), bench.ctx)).reason is Reason.UNREACHABLE


def test_servoing_finds_the_nail_beside_its_surveyed_place(bench: Bench, task: SimpleNamespace) -> None:
    surveyed = task.put_nail(bench)
    nail = task.put_nail(bench, (0.020, -0.012, 0.015))
    task.at_target(bench, surveyed, 0.14)
    result = bench.run(servo_to_nail(ServoToTargetGoal(target=surveyed), bench.ctx))
    assert result.refined.tip == pytest.approx(nail.tip, abs=0.002)
    error = pose_error(nail.hand_pose(nails(bench)), bench.hand)
    assert np.linalg.norm(error[:3]) < 0.002 and np.linalg.norm(error[3:]) < 0.02
    assert bench.log.last("servo")["error_px"] < 0.5 and bench.log.pictures == ["ServoToNail"]
    samples = [fields for kind, fields in bench.log.events if kind == "servo_sample"]
    assert len(samples) > 20 and len(samples[-1]["corners"]) == 8
    assert bench.ctx.arm.owner is None and not bench.arm.velocity.any()


def test_servoing_goes_back_to_its_start_when_the_markers_vanish(bench: Bench, task: SimpleNamespace) -> None:
    target = task.put_nail(bench)
    task.at_target(bench, target, 0.14)
    start = bench.hand
    run = servo_to_nail(ServoToTargetGoal(target=target), bench.ctx)
    for _ in range(150):
        next(run)
        bench.advance()
    bench.scene.markers.clear()
    assert np.linalg.norm(bench.hand[:3, 3] - start[:3, 3]) > 0.03
    assert bench.failure(run).reason is Reason.FEATURE_LOST
    assert np.linalg.norm(pose_error(bench.hand, start)) < 0.005
    assert len([kind for kind, _ in bench.log.events if kind == "servo_again"]) == 1
    assert bench.ctx.arm.owner is None and not bench.arm.velocity.any()


def test_servoing_tries_again_from_its_start_when_the_markers_come_back(bench: Bench, task: SimpleNamespace) -> None:
    target = task.put_nail(bench)
    task.at_target(bench, target, 0.14)
    markers = dict(bench.scene.markers)
    run = servo_to_nail(ServoToTargetGoal(target=target), bench.ctx)
    feedback = next(run)
    for _ in range(600):
        bench.advance()
        feedback = next(run)
        if feedback.status == "back before the target":
            bench.scene.markers.update(markers)
            break
        if bench.now() > 1.0:
            bench.scene.markers.clear()
    result = bench.run(run)
    assert result.refined.tip == pytest.approx(target.tip, abs=0.002)
    assert [fields["reason"] for kind, fields in bench.log.events if kind == "servo"] == ["feature_lost", ""]


def test_servoing_stops_when_the_camera_stops(bench: Bench, task: SimpleNamespace) -> None:
    target = task.put_nail(bench)
    task.at_target(bench, target, 0.14)
    run = servo_to_nail(ServoToTargetGoal(target=target), bench.ctx)
    for _ in range(150):
        next(run)
        bench.advance()
    bench.camera.frozen = True
    assert bench.failure(run).reason is Reason.STALE_DATA
    assert not bench.arm.velocity.any()


def test_servoing_finds_the_tip_of_a_spur_beside_where_it_was_scanned(bench: Bench, task: SimpleNamespace) -> None:
    target = task.spur_target(bench)
    shift = np.array([0.010, 0.006, -0.008])
    tip = target.tip + shift
    bench.scene.rods = [(tip - 0.08 * target.direction, tip, 0.005)]
    task.at_target(bench, target, 0.10)
    result = bench.run(servo_to_spur(ServoToTargetGoal(target=target), bench.ctx))
    assert result.refined.tip - target.tip == pytest.approx(shift, abs=0.006)
    assert result.refined.rotation() == pytest.approx(target.rotation()), "orientation is held"
    assert bench.ctx.arm.owner is None


def test_a_spur_that_is_not_there_is_lost(bench: Bench, task: SimpleNamespace) -> None:
    target = task.spur_target(bench)
    task.at_target(bench, target, 0.10)
    assert bench.failure(servo_to_spur(ServoToTargetGoal(target=target), bench.ctx)).reason is Reason.FEATURE_LOST


@pytest.mark.parametrize("back_off", [0.10, 0.0])
def test_hand_is_lowered_straight_onto_a_spur_without_looking(
    bench: Bench, task: SimpleNamespace, back_off: float
) -> None:
    target = task.spur_target(bench)
    task.at_target(bench, target, back_off)
    bench.camera.silent = True
    start = bench.now()
    result = bench.run(lower_onto_target(LowerOntoTargetGoal(target=target), bench.ctx))
    assert np.linalg.norm(pose_error(target.hand_pose(nails(bench)), bench.hand)) < 0.002
    assert bench.now() - start == pytest.approx(back_off / 0.04 + 0.2, abs=0.05)
    assert result.reached is target and bench.ctx.arm.owner is None


def test_a_hand_that_touches_while_it_is_lowered_goes_back(bench: Bench, task: SimpleNamespace) -> None:
    target = task.spur_target(bench)
    task.at_target(bench, target, 0.10)
    begin, lowest = bench.hand, 0.10
    with pytest.raises(ActionFailed) as failed:
        for _ in lower_onto_target(LowerOntoTargetGoal(target=target), bench.ctx):
            bench.advance()
            left = 0.10 - float((begin - bench.hand)[:3, 3] @ target.approach)
            lowest = min(lowest, left)
            bench.world.felt = 0.4 if left < 0.04 else 0.1
    assert failed.value.reason is Reason.CONTACT
    assert lowest > 0.03 and np.linalg.norm(pose_error(begin, bench.hand)) < 0.002, "and no farther"


@pytest.mark.parametrize("reason", [Reason.CONTACT, Reason.TRACKING_ERROR, Reason.CABLE_BUDGET])
def test_a_hand_that_fails_while_it_is_lowered_goes_back(
    bench: Bench, task: SimpleNamespace, monkeypatch: pytest.MonkeyPatch, reason: Reason
) -> None:
    target = task.spur_target(bench)
    task.at_target(bench, target, 0.10)
    begin, send = bench.hand, bench.arm.send

    def fail_once(velocity):
        if np.linalg.norm(bench.hand[:3, 3] - begin[:3, 3]) > 0.06:
            bench.arm.send = send
            raise ActionFailed(reason, "halfway down")
        return send(velocity)

    monkeypatch.setattr(bench.arm, "send", fail_once)
    assert bench.failure(lower_onto_target(LowerOntoTargetGoal(target=target), bench.ctx)).reason is reason
    assert np.linalg.norm(pose_error(begin, bench.hand)) < 0.002


def test_a_hand_that_cannot_go_back_either_tells_what_failed_first(
    bench: Bench, task: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = task.spur_target(bench)
    task.at_target(bench, target, 0.10)
    failures = iter([ActionFailed(Reason.CONTACT, "on the way"), ActionFailed(Reason.TRACKING_ERROR, "going back")])

    def fail(velocity):
        raise next(failures)

    monkeypatch.setattr(bench.arm, "send", fail)
    failure = bench.failure(lower_onto_target(LowerOntoTargetGoal(target=target), bench.ctx))
    assert (failure.reason, failure.detail) == (Reason.CONTACT, "on the way")
    assert next(failures, None) is None and bench.ctx.arm.owner is None


def test_nails_stay_in_place_while_the_fingers_close_then_back_off(bench: Bench, task: SimpleNamespace) -> None:
    target = before_a_nail(bench, task)
    begin, track = (bench.hand @ nails(bench))[:3, 3], []
    for feedback in hang_dispenser(HangDispenserGoal(target=target), bench.ctx):
        bench.advance()
        place = bench.hand @ nails(bench, float(bench.fingers.angles[1]))
        track.append((feedback.status, place[:3, 3] - begin))
    closing = np.array([shift for status, shift in track if status.startswith("closing")])
    backing = np.array([shift for status, shift in track if status.startswith("released")])
    assert bench.fingers.angles[1:] == pytest.approx(GRIPPER.closed_angle, abs=0.01)
    assert np.abs(closing).max() < 0.001
    assert backing[-1] == pytest.approx([0.0, -0.14, 0.0], abs=0.002), "back along the fingers"
    assert bench.ledger.account()["deployed"] == 1 and bench.ledger.dispensers()["n0"] == 1


@pytest.mark.parametrize(("stuck_s", "freed"), [(1.0, True), (2.2, True), (2.2, False)])
def test_a_release_that_the_arm_hinders_is_completed_as_far_as_it_goes_and_left_to_a_look(
    bench: Bench, task: SimpleNamespace, stuck_s: float, freed: bool
) -> None:
    """Stuck while the fingers close, or on the way back; free again with the first failure, or never."""
    target = before_a_nail(bench, task)
    start, begin = bench.now(), bench.hand[:3, 3]
    run = hang_dispenser(HangDispenserGoal(target=target), bench.ctx)
    for _ in run:
        bench.advance()
        hindered = any(kind == "release_hindered" for kind, _ in bench.log.events)
        bench.arm.stuck = bench.now() - start > stuck_s and not (freed and hindered)
    assert bench.log.last("release_hindered")["reason"] == "tracking_error"
    assert bench.ledger.dispensers()["n0"] == 1, "until somebody looks"
    if freed:
        assert bench.fingers.angles[1:] == pytest.approx(GRIPPER.closed_angle, abs=0.02)
        assert begin[1] - bench.hand[1, 3] > 0.10
    assert bench.ctx.arm.owner is None


def test_fingers_that_do_not_close_keep_the_dispenser_and_take_it_back(
    bench: Bench, task: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = before_a_nail(bench, task)
    begin, closing = bench.hand[:3, 3], []
    monkeypatch.setattr(bench.fingers, "send", lambda position: position)
    with pytest.raises(ActionFailed) as failed:
        for feedback in hang_dispenser(HangDispenserGoal(target=target), bench.ctx):
            bench.advance()
            if feedback.status.startswith("closing"):
                closing.append(bench.hand[:3, 3])
    assert failed.value.reason is Reason.TRACKING_ERROR and "fingers" in failed.value.detail
    assert np.linalg.norm(closing[-1] - begin) < 0.05, "the hand does not swing round fingers that stay"
    away = bench.hand[:3, 3] - closing[-1]
    assert away == pytest.approx(0.11 * target.approach, abs=0.005), "back over the tip, the way it came"
    assert bench.ledger.account()["on_hand"] == 1 and bench.ledger.dispensers()["n0"] == 0
    last = bench.ledger.last_step()
    assert last is not None and (last.name, last.outcome) == ("release", "failed")


@pytest.mark.parametrize("kind", ["nail", "spur"])
def test_nails_that_press_open_again_and_take_the_dispenser_back_over_the_tip(
    bench: Bench, task: SimpleNamespace, kind: str
) -> None:
    target = before_a_nail(bench, task)
    target = target if kind == "nail" else replace(target, kind="spur")
    task.at_target(bench, target)
    begin, seen = (bench.hand @ nails(bench))[:3, 3], []
    with pytest.raises(ActionFailed) as failed:
        for feedback in hang_dispenser(HangDispenserGoal(target=target), bench.ctx):
            bench.advance()
            angle = float(bench.fingers.angles[1])
            bench.world.felt = 0.5 if angle > 0.8 else 0.2
            seen.append((feedback.status.split()[0], angle, (bench.hand @ nails(bench, angle))[:3, 3] - begin))
    assert failed.value.reason is Reason.CONTACT and "0.50 of what it may" in failed.value.detail
    assert [s for k, (s, *_) in enumerate(seen) if k == 0 or seen[k - 1][0] != s] == ["closing", "opening", "leaving"]
    assert max(angle for _, angle, _ in seen) < 0.87, "no farther than where they press"
    assert max(np.linalg.norm(shift) for status, _, shift in seen if status != "leaving") < 0.003, "nails in place"
    assert bench.fingers.angles[1:] == pytest.approx(GRIPPER.open_angle, abs=0.02)
    assert seen[-1][2] == pytest.approx(0.11 * target.approach, abs=0.005), "back over the tip, the way it came"
    assert bench.ledger.account()["on_hand"] == 1 and bench.ledger.dispensers()["n0"] == 0


@pytest.mark.parametrize(("kind", "closing_s"), [("nail", 2.0), ("spur", 5.0)])
def test_fingers_close_slowly_beside_the_wood_of_a_spur(
    bench: Bench, task: SimpleNamespace, kind: str, closing_s: float
) -> None:
    target = replace(before_a_nail(bench, task), kind=kind)
    task.at_target(bench, target)
    start, closed = bench.now(), None
    for feedback in hang_dispenser(HangDispenserGoal(target=target), bench.ctx):
        if feedback.status.startswith("released") and closed is None:
            closed = bench.now()
        bench.advance()
    assert closed is not None, bench.log.events
    assert closed - start == pytest.approx(closing_s + 0.2, abs=0.05)


def test_fingers_that_tell_nothing_do_not_hinder_a_release(
    bench: Bench, task: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = before_a_nail(bench, task)
    told = bench.fingers.latest()
    monkeypatch.setattr(bench.fingers, "latest", lambda max_age_s=None: told)
    bench.run(hang_dispenser(HangDispenserGoal(target=target), bench.ctx))
    assert bench.ledger.dispensers()["n0"] == 1


def before_a_nail(bench: Bench, task: SimpleNamespace) -> HangTarget:
    """A nail, and the hand there with a dispenser to put on it."""
    target: HangTarget = task.put_nail(bench)
    in_hand(bench)
    task.at_target(bench, target)
    return target


def hung_at(bench: Bench, target: HangTarget) -> None:
    """A dispenser was put on the nail and the hand has backed off, fingers closed."""
    bench.ledger.move_dispenser("feeder", "hand")
    bench.ledger.move_dispenser("hand", target.plant)
    bench.fingers.angles = bench.fingers.target = np.array(
        [GRIPPER.thumb_clear, GRIPPER.closed_angle, GRIPPER.closed_angle]
    )
    T_closed = target.hand_pose(nails(bench, GRIPPER.closed_angle))
    T_closed[:3, 3] += 0.14 * T_closed[:3, 2]
    bench.put_hand(T_closed)


def check(bench: Bench, target: HangTarget):
    return check_deployment(CheckDeploymentGoal(target=target), bench.ctx)


def test_wings_at_the_nail_confirm_the_deployment(bench: Bench, task: SimpleNamespace) -> None:
    target = task.put_nail(bench)
    hung_at(bench, target)
    bench.scene.wings = [target.tip + np.array([side * 0.02, -0.01, -0.03]) for side in (-1.0, 1.0)]
    bench.run(check(bench, target))
    assert bench.ledger.dispensers()["n0"] == 1
    assert bench.log.last("check")["value"] is True and bench.log.pictures == ["deployment"]


def test_a_dispenser_that_stayed_on_the_nails_is_back_in_the_hand(bench: Bench, task: SimpleNamespace) -> None:
    target = task.put_nail(bench)
    hung_at(bench, target)
    bench.scene.held = True
    failure = bench.failure(check(bench, target))
    assert failure.reason is Reason.DEPLOYMENT_NOT_CONFIRMED
    account = bench.ledger.account()
    assert (account["on_hand"], account["lost"], account["deployed"]) == (1, 0, 0)


@pytest.mark.parametrize("away", [None, (0.35, 0.0, -0.05)])
def test_a_dispenser_that_is_not_at_its_place_is_lost(bench: Bench, task: SimpleNamespace, away) -> None:
    target = task.put_nail(bench)
    hung_at(bench, target)
    if away is not None:
        bench.scene.wings = [target.tip + np.array(away)]
    failure = bench.failure(check(bench, target))
    assert failure.reason is Reason.DEPLOYMENT_NOT_CONFIRMED and "0 wings at the target" in failure.detail
    account = bench.ledger.account()
    assert (account["on_hand"], account["lost"], account["deployed"]) == (0, 1, 0)


def test_a_dispenser_whose_wings_are_seen_only_from_aside_is_confirmed(bench: Bench, task: SimpleNamespace) -> None:
    target = task.put_nail(bench)
    hung_at(bench, target)
    begin = bench.hand[:3, 3]
    wings = [target.tip + np.array([side * 0.02, -0.01, -0.03]) for side in (-1.0, 1.0)]
    for _ in check(bench, target):
        bench.advance()
        bench.scene.wings = wings if np.linalg.norm(bench.hand[:3, 3] - begin) > 0.08 else []
    assert bench.ledger.dispensers()["n0"] == 1
    checks = [fields for kind, fields in bench.log.events if kind == "check"]
    assert [fields["value"] for fields in checks] == [True], "one verdict for both looks"


@pytest.mark.parametrize(("tip_z", "hangs"), [(0.55, True), (0.20, False)])
def test_a_dispenser_in_the_fork_hangs_and_one_on_the_ground_does_not(
    bench: Bench, task: SimpleNamespace, tip_z: float, hangs: bool
) -> None:
    target = replace(task.spur_target(bench), plant="n0", tip=np.array([0.45, 0.80, tip_z]))
    hung_at(bench, target)
    bench.scene.wings = [target.tip + np.array([side * 0.02, 0.05, -0.25]) for side in (-1.0, 1.0)]
    run = check(bench, target)
    if hangs:
        bench.run(run)
    else:
        assert "lies on the ground" in bench.failure(run).detail
    assert bench.ledger.account()["lost"] == (not hangs)


def test_a_check_without_camera_leaves_the_account_alone(bench: Bench, task: SimpleNamespace) -> None:
    target = task.put_nail(bench)
    hung_at(bench, target)
    bench.camera.frozen = True
    assert bench.failure(check(bench, target)).reason is Reason.STALE_DATA
    assert bench.ledger.dispensers()["n0"] == 1


def test_targets_of_one_plant_differ_only_where_they_should(bench: Bench, task: SimpleNamespace) -> None:
    target = task.spur_target(bench)
    moved = replace(target, tip=target.tip + 0.01)
    assert moved.hand_pose(nails(bench))[:3, 3] - target.hand_pose(nails(bench))[:3, 3] == pytest.approx([0.01] * 3)
