"""What the arm is asked to do for row G6, each with what came of it by the simulator's truth."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from grape.actions.core import Context, Feedback
from grape.actions.hand_path import HandPathOptions, follow_hand_path, straight
from grape.actions.move_arm import (
    MoveArmToNamedGoal,
    checker_for,
    find_postures,
    move_arm_to_named,
    move_to_pose,
)
from grape.actions.robot import Robot
from grape.actions.unwind import UnwindGoal, unwind
from grape.experiments.arm_bench import Parking
from grape.experiments.arm_track import Motion, TrackedBench, bend_m, cable_share, off_line_m, turned_rad
from grape.experiments.servo_trials import Trial, small_world
from grape.geometry import pose, pose_error
from grape.messages import Array
from grape.planning import StateChecker
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.calibrate_arm import CalibrateArmGoal, calibrate_arm
from grape.tasks.dispenser.actions.scan_vine import ScanVineGoal, sweep_path
from grape.tasks.dispenser.feeder import FEEDER_BOXES, VIEW_M, hand_at_feeder
from grape.tasks.dispenser.nail_board import NailBoard, nail_target
from grape.tasks.dispenser.row import ROW, expect_row, row_distance
from grape.tasks.dispenser.targets import hang_line

NAIL, VINE = "r0n0", "r0v0"
PARKING = Parking(plant=NAIL, ahead_m=0.22)
STAND_OFF_M = 0.14
NAMED = ("home", "ready_left_fore", "ready_left_aft", "travel")
AS_IT_COMES, CALIBRATED = "as it comes", "calibrated"
DRAWN, LINES, WOUND = 4, 3, 2  # motions a seed
OUT_OF_REACH = "out of reach"
BROKEN = {"a joint stands still": 0.0, "a joint runs backwards": -1.0}  # and how much of what it is told it moves
WRONG = (OUT_OF_REACH, *BROKEN)
LENGTH_M = (0.2, 0.5)
TOO_LONG_M = 1.3  # the arm's reach is 0.9 m
MEAN_SPEED = 0.08  # m/s along a line
LINE = "following a line"


@dataclass(frozen=True, kw_only=True, eq=False)
class Place:
    """Where the hand is sent: `line` (k, 4, 4), as `move_to_pose` takes it, or a named pose of the arm."""

    name: str
    line: tuple[Array, ...] = ()
    touch_boxes: tuple[str, ...] = ()
    either_end: bool = False


def moves(seed: int) -> Trial:
    """Planned motions and straight lines, by the arm as it comes, and again when it has calibrated itself."""
    rng = np.random.default_rng([seed, 6])
    found: Trial = {"planned": [], "lines": []}
    with TrackedBench(DESCRIPTION, PARKING, small_world(seed)) as bench:
        expect_row(bench.ctx, VINE)
        places = [*_task_places(bench), *_drawn_places(bench, rng), *(Place(name=name) for name in NAMED)]
        lines = list(islice(draw_lines(bench, rng), LINES))
        for arm in (AS_IT_COMES, CALIBRATED):
            if arm == CALIBRATED:
                found["uncalibrated"] = bench.observe(calibrate_arm(CalibrateArmGoal(), bench.ctx)).reason
            found["planned"] += [{"arm": arm, **_planned(bench, place)} for place in places]
            found["lines"] += [{"arm": arm, **_line(bench, *line)} for line in lines]
    return found


def _task_places(bench: TrackedBench) -> list[Place]:
    """Above the feeder, before the nail, and where a scan begins."""
    robot, ctx = bench.robot, bench.ctx
    view = hand_at_feeder(robot, DESCRIPTION.feeder.levels - 1, VIEW_M)
    before = hang_line(robot, nail_target(ctx, NAIL, NailBoard()), STAND_OFF_M)
    sweep = sweep_path(ScanVineGoal(plant=VINE), DESCRIPTION.arm.T_base_link_arm_base, row_distance(ctx, VINE))
    return [
        Place(name="feeder", line=(view,), touch_boxes=FEEDER_BOXES),
        Place(name="nail", line=before, touch_boxes=(ROW,)),
        Place(name="scan", line=sweep.poses, touch_boxes=(ROW,), either_end=True),
    ]


def _drawn_places(bench: TrackedBench, rng: np.random.Generator) -> list[Place]:
    free = draw_free(bench.robot, checker_for(bench.ctx), rng)
    return [Place(name="drawn", line=(bench.robot.hand_pose(next(free)),)) for _ in range(DRAWN)]


def draw_free(robot: Robot, checker: StateChecker, rng: np.random.Generator) -> Iterator[Array]:
    """Joint angles (n,) rad without a collision, evenly within limits and cable budget, for ever."""
    while True:
        q = rng.uniform(*robot.planner.bounds(DESCRIPTION.arm.unwound))
        if checker.is_valid(q):
            yield q


def draw_lines(bench: TrackedBench, rng: np.random.Generator) -> Iterator[tuple[Array, Array]]:
    """Straight lines of the hand at constant orientation that the arm can follow without a collision, for ever."""
    for q in draw_free(bench.robot, checker_for(bench.ctx), rng):
        way = rng.normal(size=3)
        line = _ends(bench.robot.hand_pose(q), way, rng.uniform(*LENGTH_M))
        if find_postures(bench.ctx, line):
            yield line


def _ends(T: Array, way: Array, length_m: float) -> tuple[Array, Array]:
    return T, pose(T[:3, :3], T[:3, 3] + length_m * way / np.linalg.norm(way))


def _planned(bench: TrackedBench, place: Place) -> Trial:
    if place.line:
        motion = bench.observe(_go(bench.ctx, place))
        wanted = place.line[motion.result or 0]
    else:
        motion = bench.observe(move_arm_to_named(MoveArmToNamedGoal(pose=place.name), bench.ctx))
        wanted = bench.robot.hand_pose(DESCRIPTION.arm.poses[place.name])
    error = pose_error(bench.true_hand(), wanted)
    return {
        "place": place.name,
        "hand_mm": 1e3 * float(np.linalg.norm(error[:3])),
        "hand_deg": float(np.degrees(np.linalg.norm(error[3:]))),
        **_outcome(motion),
    }


def _outcome(motion: Motion) -> Trial:
    return {
        "converged": not motion.reason,
        "reason": motion.reason,
        "detail": motion.detail,
        "duration_s": motion.duration_s,
        "speed_share": motion.speed_share(DESCRIPTION.arm),
        "cable_share": max((cable_share(DESCRIPTION.arm, beat.q) for beat in motion.beats), default=0.0),
        "touched": motion.touched,
    }


def _go(ctx: Context, place: Place) -> Generator[Feedback, None, int]:
    with ctx.arm.lease("planned") as arm:
        return (
            yield from move_to_pose(
                ctx, arm, place.line, status=place.name, touch_boxes=place.touch_boxes, either_end=place.either_end
            )
        )


def _follow(ctx: Context, T_start: Array, T_end: Array, look_ahead: bool = True) -> Generator[Feedback, None, None]:
    """Goes to a pose, planned, and from there straight to another; `look_ahead`: only if the arm can follow."""
    duration = float(np.linalg.norm(T_end[:3, 3] - T_start[:3, 3])) / MEAN_SPEED
    with ctx.arm.lease("line") as arm:
        yield from move_to_pose(ctx, arm, (T_start, T_end) if look_ahead else (T_start,), status="to the line")
        options = HandPathOptions(legs=(duration,))
        path = straight(T_start, T_end, duration)
        yield from follow_hand_path(ctx, arm, path, duration, status=LINE, options=options)


def _line(bench: TrackedBench, T_start: Array, T_end: Array) -> Trial:
    motion = bench.observe(_follow(bench.ctx, T_start, T_end))
    beats = motion.during(LINE)
    if not beats:
        return {"followed": False, **_outcome(motion)}
    told, true = (np.array([T[:3, 3] for T in hands]) for hands in _hands(motion))
    return {
        "followed": True,
        **_outcome(motion),
        "told_off_mm": 1e3 * float(off_line_m(told, T_start[:3, 3], T_end[:3, 3]).max()),
        "told_deg": float(np.degrees(turned_rad([beat.T_told[:3, :3] for beat in beats], T_start[:3, :3]))),
        "true_bend_mm": 1e3 * bend_m(true),
        "true_deg": float(np.degrees(turned_rad([b.T_true[:3, :3] for b in beats], beats[0].T_true[:3, :3]))),
        "told_end_mm": 1e3 * float(np.linalg.norm(told[-1] - T_end[:3, 3])),
        "true_end_mm": 1e3 * float(np.linalg.norm(true[-1] - T_end[:3, 3])),
        "track_mm": _track_mm(true, T_start[:3, 3], T_end[:3, 3]),
    }


def _hands(motion: Motion) -> tuple[list[Array], list[Array]]:
    """Poses along the line as the arm told them, and as they were."""
    beats = motion.during(LINE)
    return [beat.T_told for beat in beats], [beat.T_true for beat in beats]


def _track_mm(points: Array, a: Array, b: Array) -> list[tuple[float, float]]:
    """Way along a line and distance from the parallel through the first point, mm, ten a second."""
    along = (b - a) / np.linalg.norm(b - a)
    way, off = (points - points[0]) @ along, off_line_m(points, points[0], points[0] + along)
    return [(round(1e3 * float(x), 1), round(1e3 * float(y), 2)) for x, y in zip(way[::10], off[::10], strict=True)]


def unwound(seed: int) -> Trial:
    """Unwinding, from drawn states clear of the row, a cable between half of its budget and all but 5 % of it."""
    rng, found = np.random.default_rng([seed, 66]), []
    with TrackedBench(DESCRIPTION, PARKING, small_world(seed)) as bench:
        expect_row(bench.ctx, VINE)
        free = draw_free(bench.robot, checker_for(bench.ctx), rng)
        states = list(islice((q for q in free if 0.5 < cable_share(DESCRIPTION.arm, q) < 0.95), WOUND))
    for wound in states:
        poses = {**DESCRIPTION.arm.poses, "wound": wound}
        robot = replace(DESCRIPTION, arm=replace(DESCRIPTION.arm, poses=poses))
        with TrackedBench(robot, PARKING, small_world(seed), arm_pose="wound") as bench:
            expect_row(bench.ctx, VINE)
            begin = cable_share(DESCRIPTION.arm, bench.ctx.world.joints())
            motion = bench.observe(unwind(UnwindGoal(), bench.ctx))
            left = cable_share(DESCRIPTION.arm, bench.ctx.world.joints()) * DESCRIPTION.arm.cable_turns / (2 * np.pi)
            found.append({"begin_share": begin, "turns_left": left, **_outcome(motion)})
    return {"unwound": found}


def astray(seed: int) -> Trial:
    """Lines that come to nothing, one of each kind."""
    rng, found = np.random.default_rng([seed, 666]), []
    for why in WRONG:
        with TrackedBench(DESCRIPTION, PARKING, small_world(seed)) as bench:
            expect_row(bench.ctx, VINE)
            T_start, T_end = next((_too_long if why == OUT_OF_REACH else draw_lines)(bench, rng))
            if why in BROKEN:
                halfway = 0.5 * float(np.linalg.norm((T_end - T_start)[:3, 3])) / MEAN_SPEED
                joint = int(rng.integers(len(DESCRIPTION.arm.joints)))
                bench.break_joint(joint, BROKEN[why], LINE, rng.uniform(0.2, 1.0) * halfway)
            motion = bench.observe(_follow(bench.ctx, T_start, T_end, look_ahead=why != OUT_OF_REACH))
            found.append({"why": why, **stray(motion, T_start, T_end)})
    return {"astray": found}


def _too_long(bench: TrackedBench, rng: np.random.Generator) -> Iterator[tuple[Array, Array]]:
    """Lines away from the arm's base, upwards and away from the row, for ever."""
    for T, _ in draw_lines(bench, rng):
        way = T[:3, 3] - DESCRIPTION.arm.T_base_link_arm_base[:3, 3]
        if way[1] < 0.0 < way[2]:
            yield _ends(T, way, TOO_LONG_M)


def stray(motion: Motion, T_start: Array, T_end: Array) -> Trial:
    """How a line ended, and how far from it and from its end the hand had got."""
    told, true = _hands(motion)
    if not told:
        return {"followed": False, **_outcome(motion)}
    points, along = np.array([T[:3, 3] for T in true]), T_end[:3, 3] - T_start[:3, 3]
    left = np.array([np.linalg.norm(T[:3, 3] - T_end[:3, 3]) for T in told])
    return {
        "followed": True,
        **_outcome(motion),
        "off_mm": 1e3 * float(off_line_m(points, points[0], points[0] + along).max()),
        "turned_deg": float(np.degrees(turned_rad([T[:3, :3] for T in true], true[0][:3, :3]))),
        "grown_mm": 1e3 * float(left[-1] - left.min()),
    }


def flat(trials: Sequence[Trial], key: str) -> list[dict[str, Any]]:
    """The motions of one kind over all trials."""
    return [motion for trial in trials for motion in trial.get(key, ())]
