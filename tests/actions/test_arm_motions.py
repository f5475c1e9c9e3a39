"""Planned arm motions, hand paths, retracting and unwinding, on a robot on paper."""

from __future__ import annotations

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.hand_path import HandPathOptions, follow_hand_path, smooth_step, straight
from grape.actions.move_arm import (
    PATIENCE_S,
    MoveArmToNamedGoal,
    checker_for,
    find_postures,
    move_arm_to_named,
    move_to_joints,
    move_to_pose,
)
from grape.actions.obstacles import OBSTACLES, UNSEEN, Obstacles
from grape.actions.retract import RetractGoal, retract
from grape.actions.unwind import UnwindGoal, unwind
from grape.errors import GoalRejected, Reason, StaleData
from grape.geometry import interpolate, pose, pose_error, rotation_x, rotation_z, transform
from grape.kinematics import inverse_path
from grape.planning import CheckerOptions, StaticBox
from grape.robots.husky_jaco2 import DESCRIPTION

POSES = DESCRIPTION.arm.poses
LEVEL = rotation_x(np.pi / 2)  # the hand points to the left
AHEAD = pose(LEVEL, (0.47, 0.40, 0.70))


def held(bench: Bench) -> None:
    """The arm was stopped, given back, and stands."""
    assert bench.ctx.arm.owner is None and bench.arm.stops >= 1 and not bench.arm.velocity.any()


def test_arm_reaches_a_named_pose_and_is_given_back(bench: Bench) -> None:
    bench.run(move_arm_to_named(MoveArmToNamedGoal(pose="home"), bench.ctx))
    assert np.abs(bench.arm.q - POSES["home"]).max() < 0.01
    held(bench)


def test_arm_keeps_its_speed_limits_on_the_way(bench: Bench) -> None:
    speeds = []
    run = move_arm_to_named(MoveArmToNamedGoal(pose="home"), bench.ctx)
    before = bench.arm.q
    for _ in run:
        bench.advance()
        speeds.append((bench.arm.q - before) / 0.01)
        before = bench.arm.q
    assert (np.abs(speeds) <= DESCRIPTION.arm.set_point_max + 1e-9).all()
    jumps = np.abs(np.diff(np.array(speeds)[5:], axis=0)).max(axis=0) / 0.01
    assert (jumps < 2.5 * DESCRIPTION.arm.acceleration_max).all(), "the path is timed, not jumped"


def test_named_pose_is_meant_as_it_is_not_a_whole_turn_away(bench: Bench) -> None:
    named = POSES["ready_left_fore"]
    turned = named.copy()
    turned[0] += 2 * np.pi
    assert abs(turned[0] - DESCRIPTION.arm.unwound[0]) < DESCRIPTION.arm.cable_turns, "the cables would allow both"
    bench.put_arm(turned + 0.02)
    bench.run(move_arm_to_named(MoveArmToNamedGoal(pose="ready_left_fore"), bench.ctx))
    assert np.abs(bench.arm.q - named).max() < 0.01


def test_with_a_dispenser_the_spread_fingers_count(bench: Bench) -> None:
    bench.put_hand(AHEAD)
    hand = bench.hand
    beside = bench.robot.hand.nail(DESCRIPTION.gripper.open_angle) * [-1.0, 1.0, 1.0]
    bench.world.committed[OBSTACLES] = Obstacles(transform(hand, beside[None]))
    q = bench.ctx.world.joints()
    assert checker_for(bench.ctx, holding=False).is_valid(q), "closed fingers are away from there"
    loaded = checker_for(bench.ctx, holding=True)
    assert not loaded.is_valid(q) and loaded.nearest(q).link == "finger_3"
    assert checker_for(bench.ctx).is_valid(q)
    bench.fingers.angles[1:] = bench.fingers.target[1:] = DESCRIPTION.gripper.open_angle
    bench.advance()
    assert not checker_for(bench.ctx).is_valid(q), "nothing is held, and they stand open"


def test_arm_that_is_there_already_does_not_move(bench: Bench) -> None:
    bench.run(move_arm_to_named(MoveArmToNamedGoal(pose="travel"), bench.ctx), limit_s=0.1)
    assert bench.arm.sent == 0


def test_unknown_named_pose_is_rejected_with_a_suggestion(bench: Bench) -> None:
    with pytest.raises(GoalRejected, match="did you mean 'travel'"):
        bench.run(move_arm_to_named(MoveArmToNamedGoal(pose="travle"), bench.ctx))
    assert bench.arm.sent == bench.arm.stops == 0


def test_hand_is_moved_to_the_first_pose_of_a_line_without_touching_what_was_seen(bench: Bench) -> None:
    wall = np.array([[x, 0.62, z] for x in np.arange(0.0, 1.0, 0.02) for z in np.arange(0.0, 1.2, 0.02)])
    bench.world.committed[OBSTACLES] = Obstacles(wall)
    nearer = AHEAD @ pose(None, (0.0, 0.0, 0.10))
    checker, nearest = checker_for(bench.ctx), []

    def watched():
        with bench.ctx.arm.lease("test") as arm:
            return (yield from move_to_pose(bench.ctx, arm, (nearer,), status="moving"))

    run = watched()
    with pytest.raises(StopIteration) as end:
        while True:
            next(run)
            bench.advance()
            nearest.append(checker.is_valid(bench.arm.q))
    assert end.value.value == 0
    error = pose_error(nearer, bench.hand)
    assert np.linalg.norm(error[:3]) < 0.01 and np.linalg.norm(error[3:]) < 0.03
    assert all(nearest)


@pytest.mark.parametrize(("gap_m", "unsure", "sure"), [(0.016, 0, 1), (0.03, 1, 1), (0.005, 0, 0)])
def test_an_arm_that_does_not_know_its_zeros_keeps_more_room(
    bench: Bench, gap_m: float, unsure: int, sure: int
) -> None:
    bench.put_hand(AHEAD)
    wall = np.array([[x, 0.0, z] for x in np.arange(0.0, 1.0, 0.01) for z in np.arange(0.0, 1.2, 0.01)])
    for y in np.arange(0.70, 0.50, -0.002):  # it comes nearer
        bench.world.committed[OBSTACLES] = Obstacles(wall + np.array([0.0, y, 0.0]))
        if not checker_for(bench.ctx, options=CheckerOptions(padding_m=gap_m)).is_valid(bench.world.joints()):
            break
    assert min(1, len(find_postures(bench.ctx, (bench.hand,)))) == unsure
    bench.world.encoder_offsets = np.zeros(6)
    assert min(1, len(find_postures(bench.ctx, (bench.hand,)))) == sure


def test_posture_is_chosen_from_which_the_whole_line_can_be_followed(bench: Bench) -> None:
    line = (AHEAD, AHEAD @ pose(None, (0.0, 0.0, -0.14)))

    def go():
        with bench.ctx.arm.lease("test") as arm:
            yield from move_to_pose(bench.ctx, arm, line, status="moving")
            yield from follow_hand_path(bench.ctx, arm, straight(*line, 2.0), 2.0, status="in")

    bench.run(go())
    assert np.linalg.norm(pose_error(line[1], bench.hand)[:3]) < 0.003


def test_a_line_begins_at_a_turn_from_which_the_cables_allow_all_of_it(bench: Bench) -> None:
    line = tuple(AHEAD @ pose(rotation_z(0.4 * k - 0.3)) for k in range(8))
    steps = np.array([bench.robot.in_arm_base(T) for T in line])
    bench.put_hand(line[0])
    limits, turned = DESCRIPTION.arm, bench.arm.q + 2 * np.pi * np.eye(6)[5]
    last = inverse_path(bench.robot.arm, steps, turned)[-1]
    assert turned[5] - limits.unwound[5] < limits.cable_turns < last[5] - limits.unwound[5]
    bench.put_arm(turned + 0.02)

    def go():
        with bench.ctx.arm.lease("test") as arm:
            yield from move_to_pose(bench.ctx, arm, line, status="moving")

    bench.run(go())
    path = inverse_path(bench.robot.arm, steps, bench.arm.q)
    assert (np.abs(path - limits.unwound)[:, ~np.isfinite(limits.position_max)] <= limits.cable_turns).all()


@pytest.mark.parametrize("end", [0, 1])
def test_either_end_of_a_line_may_be_taken(bench: Bench, end: int) -> None:
    line = (pose(LEVEL, (0.35, 0.55, 0.7)), pose(LEVEL, (0.65, 0.55, 0.7)))
    bench.put_hand(line[end])

    def go():
        with bench.ctx.arm.lease("test") as arm:
            return (yield from move_to_pose(bench.ctx, arm, line, status="moving", either_end=True))

    assert bench.run(go()) == end


def test_pose_out_of_reach_is_refused(bench: Bench) -> None:
    def go():
        with bench.ctx.arm.lease("test") as arm:
            yield from move_to_pose(bench.ctx, arm, (pose(LEVEL, (0.5, 2.5, 0.7)),), status="moving")

    assert bench.failure(go()).reason is Reason.UNREACHABLE
    held(bench)


def test_pose_inside_an_obstacle_is_refused(bench: Bench) -> None:
    box = StaticBox(name="row", center=(0.47, 0.70, 0.70), half_size=(0.5, 0.40, 0.5), ignore_links=())
    bench.world.committed[UNSEEN] = (box,)

    def go():
        with bench.ctx.arm.lease("test") as arm:
            yield from move_to_pose(bench.ctx, arm, (AHEAD,), status="moving")

    assert bench.failure(go()).reason is Reason.UNREACHABLE


def test_arm_that_does_not_move_is_noticed_and_stopped(bench: Bench) -> None:
    bench.arm.stuck = True
    failure = bench.failure(move_arm_to_named(MoveArmToNamedGoal(pose="home"), bench.ctx))
    assert failure.reason is Reason.TRACKING_ERROR and "rad off" in failure.detail
    held(bench)


def test_arm_that_stops_short_of_its_goal_is_given_up(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    advance, goal = bench.arm.advance, POSES["travel"] + [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]

    def jam(now: float, dt: float) -> None:
        bench.arm.stuck = abs(goal[0] - bench.arm.q[0]) < 0.05
        advance(now, dt)

    monkeypatch.setattr(bench.arm, "advance", jam)

    def go():
        with bench.ctx.arm.lease("test") as arm:
            yield from move_to_joints(bench.ctx, arm, (goal,), status="moving")

    failure = bench.failure(go(), limit_s=10.0)
    assert failure.reason is Reason.TRACKING_ERROR
    held(bench)


@pytest.mark.parametrize("silent_s", [0.5, 9.0])
def test_an_arm_without_joint_angles_is_waited_for_and_not_moved(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, silent_s: float
) -> None:
    begin, sense = bench.now(), bench._sense

    def deaf() -> None:
        sense()
        if bench.now() - begin < silent_s:
            bench.world.arm = None

    monkeypatch.setattr(bench, "_sense", deaf)
    bench.advance()
    run = move_arm_to_named(MoveArmToNamedGoal(pose="home"), bench.ctx)
    if silent_s < PATIENCE_S:
        bench.run(run)
        assert np.abs(bench.arm.q - POSES["home"]).max() < 0.01
    else:
        assert bench.failure(run).reason is Reason.STALE_DATA
        assert bench.arm.sent == 0 and bench.now() - begin < PATIENCE_S + 0.1
    held(bench)


def test_joint_angles_that_stop_in_a_motion_end_it(bench: Bench) -> None:
    run = move_arm_to_named(MoveArmToNamedGoal(pose="home"), bench.ctx)
    for _ in range(50):
        next(run)
        bench.advance()
    bench.world.arm = None
    with pytest.raises(StaleData):
        next(run)
    held(bench)


def test_a_held_dispenser_counts_in_planning(bench: Bench) -> None:
    assert checker_for(bench.ctx).is_valid(POSES["travel"])
    bench.ledger.move_dispenser("feeder", "hand")
    loaded, bare = checker_for(bench.ctx), checker_for(bench.ctx, holding=False)
    nails = bench.robot.hand_pose(POSES["home"]) @ bench.robot.hand.T_hand_nails(DESCRIPTION.gripper.open_angle)
    point = transform(nails, np.array([[0.0, 0.07, 0.0]]))
    bench.world.committed[OBSTACLES] = Obstacles(np.repeat(point, 3, axis=0) + 1e-4 * np.arange(3)[:, None])
    loaded, bare = checker_for(bench.ctx), checker_for(bench.ctx, holding=False)
    assert bare.is_valid(POSES["home"]) and not loaded.is_valid(POSES["home"])


def test_hand_follows_a_straight_path_in_its_time(bench: Bench) -> None:
    bench.put_hand(AHEAD)
    T_end = AHEAD @ pose(rotation_x(0.2), (0.05, 0.0, -0.10))
    start, track = bench.now(), []

    def go():
        with bench.ctx.arm.lease("test") as arm:
            motion = follow_hand_path(bench.ctx, arm, straight(AHEAD, T_end, 2.0), 2.0, status="in")
            for feedback in motion:
                track.append((bench.now() - start, bench.hand))
                yield feedback

    bench.run(go())
    assert 2.0 <= bench.now() - start <= 2.5
    assert np.linalg.norm(pose_error(T_end, bench.hand)) < 0.002
    off = [np.linalg.norm(pose_error(straight(AHEAD, T_end, 2.0)(min(t, 2.0)), T)[:3]) for t, T in track]
    assert max(off) < 0.004


def test_fingers_move_along_with_the_hand(bench: Bench) -> None:
    bench.put_hand(AHEAD)

    def go():
        with bench.ctx.arm.lease("test") as arm, bench.ctx.gripper.lease("test") as fingers:
            yield from follow_hand_path(
                bench.ctx, arm, lambda t: AHEAD, 1.5, status="opening", gripper=fingers,
                fingers_at=lambda t: np.array([1.5, 1.05 - 0.5 * t, 1.05 - 0.5 * t]),
            )  # fmt: skip

    bench.run(go())
    assert bench.fingers.angles[1:] == pytest.approx(0.30, abs=0.01)
    assert bench.ctx.gripper.owner is None and bench.fingers.stops == 1


@pytest.mark.parametrize(
    ("beyond", "turn", "reason"),
    [(-0.2, 0.8, Reason.CABLE_BUDGET), (-0.2, -0.8, None), (0.4, 0.8, Reason.CABLE_BUDGET), (0.4, -0.8, None)],
)
def test_a_hand_path_that_winds_a_cable_beyond_its_budget_is_ended(
    bench: Bench, beyond: float, turn: float, reason: Reason | None
) -> None:
    arm = DESCRIPTION.arm
    budget = arm.unwound[5] + arm.cable_turns
    bench.put_hand(AHEAD)
    bench.arm.q[5] = budget + beyond
    bench.advance(20)
    begin, side = bench.hand, float(np.sign(arm_turn(bench)))
    most = [float(bench.arm.q[5])]

    def go():
        with bench.ctx.arm.lease("test") as leased:
            path = lambda t: begin @ pose(rotation_z(side * turn * t / 2.0))  # noqa: E731
            for feedback in follow_hand_path(bench.ctx, leased, path, 2.0, status="turning"):
                most.append(float(bench.arm.q[5]))
                yield feedback

    if reason is None:
        bench.run(go())
        assert most[-1] == pytest.approx(budget + beyond + turn, abs=0.02)
    else:
        assert bench.failure(go()).reason is reason
        assert max(most) < budget + max(beyond, 0.0) + 0.15
        held(bench)


def arm_turn(bench: Bench) -> float:
    """rad about the hand's z by which a little more of the last joint turns it."""
    q = bench.arm.q.copy()
    turned = bench.robot.hand_pose(q + np.array([0, 0, 0, 0, 0, 0.01]))
    return float((bench.robot.hand_pose(q)[:3, :3].T @ turned[:3, :3])[1, 0])


def test_hand_path_with_a_stuck_arm_is_given_up(bench: Bench) -> None:
    bench.put_hand(AHEAD)
    bench.arm.stuck = True

    def go():
        with bench.ctx.arm.lease("test") as arm:
            path = straight(AHEAD, AHEAD @ pose(None, (0.0, 0.0, -0.2)), 2.0)
            yield from follow_hand_path(bench.ctx, arm, path, 2.0, status="moving in")

    start = bench.now()
    failure = bench.failure(go())
    assert failure.reason is Reason.TRACKING_ERROR and "mm" in failure.detail
    assert bench.now() - start < 1.5
    held(bench)


@pytest.mark.parametrize(("legs", "reason"), [((1.0, 2.0), None), ((2.0,), Reason.DISTANCE_GROWS)])
def test_on_each_leg_the_hand_must_come_nearer_to_its_end(
    bench: Bench, legs: tuple[float, ...], reason: Reason | None
) -> None:
    bench.put_hand(AHEAD)
    forth = straight(AHEAD, AHEAD @ pose(None, (0.0, 0.0, -0.1)), 1.0)
    farthest = [0.0]

    def go():
        with bench.ctx.arm.lease("test") as arm:
            motion = follow_hand_path(
                bench.ctx, arm, lambda t: forth(min(t, 2.0 - t)), 2.0, status="to and fro",
                options=HandPathOptions(legs=legs),
            )  # fmt: skip
            for feedback in motion:
                farthest.append(float(np.linalg.norm(bench.hand[:3, 3] - AHEAD[:3, 3])))
                yield feedback

    if reason is None:
        bench.run(go())
        assert max(farthest) > 0.09 and farthest[-1] < 0.003
    else:
        assert bench.failure(go()).reason is reason
        assert max(farthest) < 0.035, "after the first 2.5 cm it is not far"
        held(bench)


def test_hand_that_trails_may_overshoot_the_end_of_its_last_leg(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.put_hand(AHEAD)
    end, moving, past = AHEAD @ pose(None, (0.0, 0.0, -0.1)), np.zeros(6), [0.0]
    advance = bench.arm.advance

    def trail(now: float, dt: float) -> None:
        nonlocal moving
        wanted = bench.arm.velocity
        moving = moving + (wanted - moving) * dt / 0.13
        bench.arm.velocity = moving
        advance(now, dt)
        bench.arm.velocity = wanted

    def steady(t: float) -> np.ndarray:
        return interpolate(AHEAD, end, min(t / 0.8, 1.0))

    def go():
        with bench.ctx.arm.lease("test") as arm:
            motion = follow_hand_path(
                bench.ctx, arm, steady, 0.8, status="fast", options=HandPathOptions(legs=(0.8,), settle_s=1.0)
            )
            for feedback in motion:
                past.append(float((bench.hand[:3, 3] - end[:3, 3]) @ -AHEAD[:3, 2]))
                yield feedback

    monkeypatch.setattr(bench.arm, "advance", trail)
    bench.run(go())
    assert max(past) > 0.009 and abs(past[-1]) < 0.003


def test_smooth_step_starts_and_ends_at_rest() -> None:
    assert (smooth_step(-1.0), smooth_step(0.0), smooth_step(0.5), smooth_step(1.0), smooth_step(2.0)) == (
        0,
        0,
        0.5,
        1,
        1,
    )
    assert smooth_step(0.01) < 1e-4 and 1 - smooth_step(0.99) < 1e-4


def test_retract_backs_off_sideways_where_something_is_behind_the_hand(bench: Bench) -> None:
    bench.put_hand(AHEAD)
    nails = AHEAD @ bench.robot.hand.T_hand_nails(DESCRIPTION.gripper.closed_angle)
    branch = nails[:3, 3] + np.array([[x, 0.0, 0.0] for x in np.arange(-0.2, 0.2, 0.005)])
    wall = [AHEAD[:3, 3] + [x, -0.16, z] for x in np.arange(-0.1, 0.1, 0.01) for z in np.arange(-0.1, 0.1, 0.01)]
    bench.world.committed[OBSTACLES] = Obstacles(np.vstack([branch, wall]))
    start, run = bench.hand, retract(RetractGoal(), bench.ctx)
    backing = [bench.hand for feedback in run if bench.advance() or feedback.status == "backing off"]
    way = backing[-1][:3, 3] - start[:3, 3]
    assert abs(way[1]) < 0.02 and way[2] > 0.08, "up, not into the wall"
    assert np.abs(bench.arm.q - POSES["travel"]).max() < 0.01


def test_retract_backs_off_what_is_near_before_it_plans(bench: Bench) -> None:
    bench.put_hand(AHEAD)
    nails = AHEAD @ bench.robot.hand.T_hand_nails(DESCRIPTION.gripper.closed_angle)
    branch = nails[:3, 3] + np.array([[x, 0.0, 0.0] for x in np.arange(-0.2, 0.2, 0.005)])
    bench.world.committed[OBSTACLES] = Obstacles(branch)
    assert not checker_for(bench.ctx).is_valid(bench.arm.q), "the hand is in the branch"
    start, path = bench.hand, []
    run = retract(RetractGoal(), bench.ctx)
    for feedback in run:
        bench.advance()
        path.append((feedback.status, bench.hand))
    backing = [T for status, T in path if status == "backing off"]
    along = (backing[-1][:3, 3] - start[:3, 3]) @ start[:3, 2]
    assert along == pytest.approx(0.10, abs=0.005), "straight back along the fingers"
    assert np.abs(bench.arm.q - POSES["travel"]).max() < 0.01
    held(bench)


def test_retract_from_free_space_goes_straight_to_the_travel_pose(bench: Bench) -> None:
    bench.put_arm(POSES["ready_left_fore"])
    statuses = [bench.advance() or feedback.status for feedback in retract(RetractGoal(), bench.ctx)]
    assert "backing off" not in statuses
    assert np.abs(bench.arm.q - POSES["travel"]).max() < 0.01


def test_unwind_turns_back_a_wound_cable(bench: Bench) -> None:
    wound = POSES["travel"].copy()
    wound[5] += 0.8 * DESCRIPTION.arm.cable_turns
    bench.put_arm(wound)
    bench.run(unwind(UnwindGoal(), bench.ctx))
    assert np.abs(bench.arm.q - POSES["travel"]).max() < 0.01, "the absolute angle, not the nearest equal one"
    held(bench)


def test_unwind_leaves_an_arm_alone_whose_cables_have_room(bench: Bench) -> None:
    turned = POSES["travel"].copy()
    turned[5] += 0.3 * DESCRIPTION.arm.cable_turns
    bench.put_arm(turned)
    bench.run(unwind(UnwindGoal(), bench.ctx), limit_s=0.1)
    assert bench.arm.sent == 0


def test_no_motion_ends_farther_from_unwound_than_the_cables_allow(bench: Bench) -> None:
    far = POSES["travel"].copy()
    far[5] += 0.95 * DESCRIPTION.arm.cable_turns
    bench.put_arm(far)
    wanted = bench.robot.hand_pose(POSES["travel"])

    def go():
        with bench.ctx.arm.lease("test") as arm:
            yield from move_to_pose(bench.ctx, arm, (wanted,), status="moving")

    bench.run(go())
    assert (np.abs(bench.arm.q - DESCRIPTION.arm.unwound) < DESCRIPTION.arm.cable_turns + 0.01).all()


def test_a_path_of_no_duration_is_its_end() -> None:
    assert straight(AHEAD, AHEAD, 0.0)(0.0) == pytest.approx(AHEAD)
