"""Planned arm motions: collision-free paths to joint angles or to hand poses, timed and followed."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.obstacles import OBSTACLES, UNSEEN, Obstacles
from grape.actions.robot import Robot
from grape.actions.rocking import follow_rocking
from grape.control import DifferentialIkOptions, TrackingOptions, TrajectoryTracker
from grape.drivers import ArmDriver
from grape.errors import ActionFailed, GoalRejected, Reason, with_suggestion
from grape.geometry import interpolate
from grape.kinematics import IkSolution, inverse_all, inverse_path
from grape.messages import Array
from grape.planning import Ball, CheckerOptions, StateChecker, StaticBox
from grape.trajectory import TimingOptions, Trajectory, time_path

TIMING = TimingOptions(speed=0.95, acceleration=0.8)
# For an arm that does not know its zeros: its hand comes out 15 to 38 mm off (row G6).
UNSURE = CheckerOptions(padding_m=0.02, self_padding_m=0.005)
# A line is followed by differential inverse kinematics, which keep this from joint limits; servoing shifts it a bit.
LINE_LIMIT_RAD = DifferentialIkOptions().limit_margin_rad + 0.03
PATIENCE_S = 2.0  # with an arm that tells no joint angles
TRACKING = TrackingOptions(gain=5.0, error_max_rad=0.12, rest_s=0.1, settle_s=3.0)


@dataclass(frozen=True, kw_only=True)
class MoveArmToNamedGoal:
    """Attributes: pose: a name among the robot's arm poses, e.g. travel."""

    pose: str


@action("MoveArmToNamed")
def move_arm_to_named(goal: MoveArmToNamedGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Moves the arm, collision-free, to one of the robot's named poses at its absolute angles."""
    poses = ctx.robot.description.arm.poses
    if goal.pose not in poses:
        sentence = f"no arm pose {goal.pose!r}; it has {', '.join(poses)}"
        raise GoalRejected(with_suggestion(sentence, goal.pose, poses))
    with ctx.arm.lease("MoveArmToNamed") as arm:
        yield from move_to_joints(
            ctx, arm, (poses[goal.pose],), status=f"moving to the {goal.pose} pose", absolute=True
        )
    return NoResult()


def known_joints(ctx: Context) -> Generator[Feedback, None, Array]:
    """Joint angles (n,) rad of an arm that is to be moved; waits a moment when it has stopped to tell them.

    Raises:
        ActionFailed: STALE_DATA.
    """
    begin = ctx.clock.now()
    while ctx.world.arm is None:
        if ctx.clock.now() - begin > PATIENCE_S:
            raise ActionFailed(Reason.STALE_DATA, f"the arm has told no joint angles for {PATIENCE_S:.0f} s")
        yield Feedback(status="waiting for the arm's joints")
    return ctx.world.joints()


def move_to_pose(
    ctx: Context,
    arm: ArmDriver,
    line: Sequence[Array],
    *,
    status: str,
    touch: Sequence[Ball] = (),
    touch_boxes: Sequence[str] = (),
    either_end: bool = False,
    limit_rad: float = LINE_LIMIT_RAD,
) -> Generator[Feedback, None, int]:
    """Moves the hand to the first pose of `line`, in an arm posture from which the rest can be followed straight.

    Args:
        ctx, arm: context and leased arm.
        line: hand poses (4, 4) in base_link, one or more; the later ones are only looked ahead to.
        status: what to tell meanwhile.
        touch: balls in base_link in which the rest of the line may touch what was seen.
        touch_boxes: names of boxes that the rest of the line may enter.
        either_end: the line may also be followed from its last pose; then that one may be moved to.
        limit_rad: how far from joint limits the whole line must keep.

    Returns:
        Index in `line` of the pose that was moved to.

    Raises:
        ActionFailed: UNREACHABLE, IN_COLLISION, NO_PLAN, CABLE_BUDGET, TRACKING_ERROR or STALE_DATA.
    """
    yield from known_joints(ctx)
    follow_rocking(ctx)
    rules = (tuple(touch), tuple(touch_boxes), None, limit_rad)
    candidates = yield from ctx.jobs.run(find_postures, ctx, tuple(line), *rules)
    ends = {0: candidates}
    if either_end:
        backwards = yield from ctx.jobs.run(find_postures, ctx, tuple(reversed(line)), *rules)
        ends[len(line) - 1] = backwards
    goals = [(end, posture) for end, postures in ends.items() for posture in postures]
    if not goals:
        place = np.round(line[0][:3, 3], 2)
        raise ActionFailed(Reason.UNREACHABLE, f"{status}: no arm posture reaches {place} and the way from there")
    index = yield from move_to_joints(ctx, arm, [q for _, q in goals], status=status, absolute=True)
    return goals[index][0]


def find_postures(
    ctx: Context,
    line: tuple[Array, ...],
    touch: tuple[Ball, ...] = (),
    touch_boxes: tuple[str, ...] = (),
    holding: bool | None = None,
    limit_rad: float = LINE_LIMIT_RAD,
) -> list[Array]:
    """Joint angles, best first, that put the hand at the first pose of a line and can follow it without collision.

    They are the nearest turns from which the cables allow the whole line.

    Args:
        ctx: for robot and world.
        line: hand poses (4, 4) in base_link.
        touch: balls in base_link in which the rest of the line may touch what was seen.
        touch_boxes: names of boxes that it may enter.
        holding: whether a dispenser is in the hand at the first pose; None asks ledger and fingers.
        limit_rad: how far from joint limits the whole line must keep.
    """
    robot = ctx.robot
    margins = planning_margins(ctx)
    checker = checker_for(ctx, holding=holding, options=margins)
    on_line = checker_for(ctx, carve=touch, without=touch_boxes, holding=False, options=margins)
    start = ctx.world.joints()
    steps = densely([robot.in_arm_base(T) for T in line])
    found: list[tuple[float, Array]] = []
    solutions: tuple[IkSolution, ...] = inverse_all(robot.arm, steps[0], start)
    for solution in solutions:
        if not checker.is_valid(solution.q):
            continue
        path = inverse_path(robot.arm, np.array(steps), solution.q) if len(steps) > 1 else np.array([solution.q])
        if path is None or not all(on_line.is_valid(q) for q in path):
            continue
        if len(path) > 1 and min(robot.arm.limit_distance(q) for q in path) < limit_rad:
            continue
        worst, turned = min(robot.arm.sigma_min(q) for q in path), _within_cables(robot, path, start)
        if worst > 0.02 and turned is not None:
            found.append((worst + 0.3 * solution.score, turned))
    found.sort(key=lambda item: -item[0])
    return [q for _, q in found[:4]]


def _within_cables(robot: Robot, path: Array, start: Array) -> Array | None:
    """The begin (n,) rad of a joint path (m, n), at the turn nearest to `start` from which it keeps to the cables."""
    lower, upper = robot.planner.bounds(robot.description.arm.unwound)
    ahead = path - path[0]
    return robot.planner.nearest_turn(path[0], start, lower - ahead.min(axis=0), upper - ahead.max(axis=0))


def fingers_spread(ctx: Context) -> bool:
    """Whether a dispenser is in the hand, or the fingers stand open as if one were."""
    if ctx.ledger.dispensers().get("hand", 0) > 0:
        return True
    told, gripper = ctx.world.gripper, ctx.robot.description.gripper
    return told is not None and float(told.position[1:].min()) < 0.5 * (gripper.open_angle + gripper.closed_angle)


def planning_margins(ctx: Context) -> CheckerOptions:
    """What planned motions keep from things and between links: more, as long as the arm's zeros are not known."""
    return UNSURE if ctx.world.encoder_offsets is None else CheckerOptions()


def checker_for(
    ctx: Context,
    *,
    carve: Sequence[Ball] = (),
    without: Sequence[str] = (),
    holding: bool | None = None,
    options: CheckerOptions | None = None,
) -> StateChecker:
    """A collision checker against what was perceived, the robot's own boxes, and those that nobody has looked into.

    Args:
        ctx: for robot, world and ledger;
        carve: balls in base_link in which what was seen may be touched.
        without: names of boxes that do not count.
        holding: whether a dispenser counts as part of the arm, and fingers as spread; None asks ledger and fingers.
            Where it is there to touch the vine it is left out: it is soft.
        options: margins.
    """
    if holding is None:
        holding = fingers_spread(ctx)
    body = ctx.robot.loaded_body if holding else ctx.robot.body
    unseen: tuple[StaticBox, ...] = ctx.world.committed.get(UNSEEN, ())
    if unseen or without:
        body = body.with_boxes(tuple(box for box in (*body.boxes, *unseen) if box.name not in without))
    obstacles: Obstacles | None = ctx.world.committed.get(OBSTACLES)
    return StateChecker(body, None if obstacles is None else obstacles.field(carve), options)


def move_to_joints(
    ctx: Context,
    arm: ArmDriver,
    goals: Sequence[Array],
    *,
    status: str,
    absolute: bool = False,
) -> Generator[Feedback, None, int]:
    """Plans to the quickest of several joint goals, times the path and follows it.

    Args:
        ctx, arm: context and leased arm.
        goals: (n,) rad each; continuous joints are taken at the nearest turn that the cables allow.
        status: what to tell meanwhile.
        absolute: goals are meant as they are, so that wound cables are turned back.

    Returns:
        Index of the goal that was reached.

    Raises:
        ActionFailed: IN_COLLISION, NO_PLAN, CABLE_BUDGET, TRACKING_ERROR or STALE_DATA.
    """
    limits = ctx.robot.description.arm
    start = yield from known_joints(ctx)
    follow_rocking(ctx)
    if len(goals) == 1 and np.abs(goals[0] - start).max() < 0.01:
        return 0
    checker = checker_for(ctx, options=planning_margins(ctx))
    path = yield from ctx.jobs.run(
        ctx.robot.planner.plan, start, goals, checker, ctx.rng, cable_reference=limits.unwound, absolute=absolute
    )
    trajectory = yield from ctx.jobs.run(
        time_path,
        path.waypoints,
        limits.set_point_max,
        limits.acceleration_max,
        TIMING,
        edge_valid=checker.edge_valid_unpadded,
    )
    ctx.log.event("plan", status=status, straight=path.straight, checks=path.checks, duration_s=trajectory.duration)
    yield from follow(ctx, arm, trajectory, status=status)
    return path.goal_index


def follow(ctx: Context, arm: ArmDriver, trajectory: Trajectory, *, status: str) -> Generator[Feedback, None, None]:
    """Follows a joint trajectory at 100 Hz.

    Raises:
        ActionFailed: TRACKING_ERROR.
    """
    tracker = TrajectoryTracker(
        trajectory=trajectory, velocity_max=ctx.robot.description.arm.set_point_max, options=TRACKING
    )
    begin = ctx.clock.now()
    while not (command := tracker.step(ctx.clock.now() - begin, ctx.world.joints())).done:
        arm.send(command.velocity)
        yield Feedback(status=status, progress=command.progress)


def densely(line: list[Array], step_m: float = 0.03) -> list[Array]:
    """The poses of a line with more between them, at most `step_m` apart."""
    poses = [line[0]]
    for T_a, T_b in pairwise(line):
        count = max(1, int(np.ceil(np.linalg.norm(T_b[:3, 3] - T_a[:3, 3]) / step_m)))
        poses += [interpolate(T_a, T_b, k / count) for k in range(1, count + 1)]
    return poses
