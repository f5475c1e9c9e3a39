"""Drive the base to a pose in the map."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from grape.actions.base_senses import LOST_S, BaseSenses, Due
from grape.actions.core import Context, Feedback, action
from grape.actions.held_places import note_held
from grape.actions.shortest_way import route_options
from grape.drivers import BaseDriver
from grape.errors import ActionFailed, GoalRejected, Reason
from grape.messages import Array
from grape.navigation.follower import FollowerState, FollowerStep, LocalPlanner, Phase, PursuitOptions
from grape.navigation.grid import Costmap, Footprint
from grape.navigation.monitor import MonitorOptions, speed_factor
from grape.navigation.newcomers import PassingOptions, PassingWatch
from grape.navigation.path import Path, in_frame_of
from grape.navigation.planner import GlobalPlanner, PlannerOptions, path_blocked
from grape.navigation.progress import ProgressChecker
from grape.navigation.route import waypoints
from grape.navigation.turning import RoomToTurn, TurnRoomOptions
from grape.plugins import GLOBAL_PLANNERS, LOCAL_PLANNERS, PluginError, load, names
from grape.world import Driving

LocalPlannerName = Annotated[str, names(LOCAL_PLANNERS)]
GlobalPlannerName = Annotated[str, names(GLOBAL_PLANNERS)]
PURE_PURSUIT, LEGS = "pure_pursuit", "legs"
CONTROL_PERIOD_S = 0.05
BRAKE = (1.0, 1.6)  # m/s^2 and rad/s^2, where the pose has become uncertain
REPLAN_S = 2.0
MAX_REPLANS = 8
DETOUR_S = 6.0  # standing before a long way around is taken: who walked in may leave
KEEP_BESIDE_M = 0.6  # of the robot's sides, in which nobody may walk while it drives
STRAYING = (Phase.TURN, Phase.RETREAT, Phase.MAKE_ROOM)  # does not come nearer meanwhile


@dataclass(frozen=True, kw_only=True)
class DriveGoal:
    """Where to stand in map: x, y in metres, yaw in radians; speed in m/s, timeout_s of the whole drive.

    A base that is slower than `speed` drives as fast as it can.

    planner: a plugin of the group `grape.local_planners`; none turns where there is no room.
    global_planner: a plugin of the group `grape.global_planners`.
    """

    x: float
    y: float
    yaw: float
    speed: float = 0.8
    timeout_s: float = 240.0
    planner: LocalPlannerName = PURE_PURSUIT
    global_planner: GlobalPlannerName = LEGS


@dataclass(frozen=True, kw_only=True)
class DriveResult:
    """How far base_link ended from its goal by the estimate (m, m, rad), along the goal's heading and to its left."""

    along_m: float
    across_m: float
    yaw_rad: float
    distance_m: float
    replans: int


@action("DriveToPose")
def drive_to_pose(goal: DriveGoal, ctx: Context) -> Generator[Feedback, None, DriveResult]:
    """Drives to a pose around rows, fences and obstacles, and settles there within 2 cm, 3 cm and 1.2 degrees.

    Where it ends further aside it backs off for another approach; after the second one 8 cm aside are enough.
    """
    target = np.array([goal.x, goal.y, goal.yaw])
    if not np.isfinite(target).all() or not goal.speed > 0.0:
        raise GoalRejected(f"a finite pose and a speed above 0, got {goal}")
    planner_named(LOCAL_PLANNERS, goal.planner)
    planner_named(GLOBAL_PLANNERS, goal.global_planner)
    with ctx.base.lease("DriveToPose") as base:
        speed = min(goal.speed, ctx.robot.description.base.max_linear)
        drive = _Drive(target, replace(goal, speed=speed), ctx)
        try:
            yield from drive.localized(base)
            yield from drive.plan(base)
            while not drive.arrived:
                drive.beat(base)
                yield drive.feedback()
                if drive.wants_plan:
                    yield from drive.replan()
        finally:
            ctx.world.driving = None
        return drive.result()


def planner_named(group: str, name: str) -> Any:
    """The planner that a goal names.

    Raises:
        GoalRejected: none of that name can be loaded.
    """
    try:
        return load(group, name)
    except PluginError as error:
        raise GoalRejected(str(error)) from error


class _Drive:
    """One drive: sensing, planning and following in their own periods."""

    def __init__(self, target: Array, goal: DriveGoal, ctx: Context) -> None:
        self._ctx, self._goal, self._target = ctx, goal, target
        self._senses = BaseSenses(ctx, target[None])
        footprint = self._senses.footprint
        self._plan_route: GlobalPlanner = planner_named(GLOBAL_PLANNERS, goal.global_planner)
        self._planner = PlannerOptions(footprint=footprint)
        self._monitor = MonitorOptions(footprint=footprint)
        self._follower = _follower(goal, footprint, self._senses.surroundings.fences())
        self._state = FollowerState()
        self._path: Path | None = None
        self._command = (0.0, 0.0)
        self._held_back = False  # the base's own guard let nothing of the last command through
        self._due, self._replan_s = Due(), 0.0
        self._begun_s = ctx.clock.now()
        self._progress = ProgressChecker(begun_s=self._begun_s)
        self._passing = PassingWatch(options=PassingOptions(beside=footprint.half_width + KEEP_BESIDE_M))
        self._last: Array | None = None
        self._driven = 0.0
        self._replans = 0
        self._blocked_by = ""
        self._in_way = ""
        self.wants_plan = False

    @property
    def arrived(self) -> bool:
        return self._state.phase is Phase.REACHED

    def localized(self, base: BaseDriver) -> Generator[Feedback, None, None]:
        """Wait a moment for a pose that is good enough to drive by."""
        ctx = self._ctx
        while not ctx.world.localized or ctx.world.odometry is None:
            base.send(0.0, 0.0)
            if ctx.clock.now() - self._begun_s > LOST_S:
                raise ActionFailed(Reason.NOT_LOCALIZED, "the pose estimate is not good enough to drive by")
            yield Feedback(status="waiting for a pose")
        pose = self._senses.pose()
        if self._senses.surroundings.in_fence(self._target):
            raise ActionFailed(Reason.FENCE, f"the goal ({self._goal.x:.2f}, {self._goal.y:.2f}) touches a fence")
        if self._senses.surroundings.in_fence(pose):
            raise ActionFailed(Reason.FENCE, f"the robot stands in a fence at ({pose[0]:.2f}, {pose[1]:.2f})")

    def plan(self, base: BaseDriver) -> Generator[Feedback, None, None]:
        """The first path; obstacles in view count already.

        Raises:
            ActionFailed: NO_PATH by the site file, BLOCKED when obstacles close the way that it leaves open.
        """
        yield from self._senses.look_around(base)
        costs, *way = self._plan_arguments()
        try:
            self._path = yield from self._ctx.jobs.run(self._plan_route, costs, *way)
        except ActionFailed as closed:
            if self._senses.surroundings.dare():  # no way round where the base was held before: try again there
                yield from self.plan(base)
                return
            yield from self._ctx.jobs.run(self._plan_route, self._senses.surroundings.fences(), *way)
            raise ActionFailed(Reason.BLOCKED, f"with what stands there, {closed.detail}") from closed
        self._start_path()

    def replan(self) -> Generator[Feedback, None, None]:
        """Another path around what is in the way; when there is none, the old one is kept and the robot waits."""
        self.wants_plan = False
        self._replan_s = self._ctx.clock.now() + REPLAN_S
        try:
            path = yield from self._ctx.jobs.run(self._plan_route, *self._plan_arguments())
        except ActionFailed as failure:
            self._blocked_by = failure.detail
            return
        left = self._way_left()
        if path.length > 1.5 * left + 2.0 and self._progress.blocked_for(self._ctx.clock.now()) < DETOUR_S:
            return
        self._path = path
        self._replans += 1
        if self._replans > MAX_REPLANS:
            raise ActionFailed(Reason.BLOCKED, f"{MAX_REPLANS} detours did not lead past what is in the way")
        self._ctx.log.event("recovery", how="detour", why=self._in_way, length_m=path.length)
        self._start_path()

    def beat(self, base: BaseDriver) -> None:
        """One beat: the follower's command, or slowing down for want of fresh data."""
        now = self._ctx.clock.now()
        if now - self._begun_s > self._goal.timeout_s:
            raise ActionFailed(Reason.TIMEOUT, f"not there after {self._goal.timeout_s:.0f} s")
        if not self._senses.fresh(now):
            self._slow_down(now)
            self._progress.pause(now)
            base.send(*self._command)
            return
        self._senses.update()
        self._show()
        if self._due.ask("control", now, CONTROL_PERIOD_S):
            self._control(now)
        sent = base.send(*self._command)
        self._held_back = any(self._command) and not (sent.linear[0] or sent.angular[2])

    def _slow_down(self, now: float) -> None:
        """Stop where sensors are silent; uncertain of the pose alone, brake on the same arc: loops lie on the deck."""
        v, w = self._command
        share = 0.0
        if not self._senses.silent:
            if not self._due.ask("control", now, CONTROL_PERIOD_S):
                return
            braking_s = max(abs(v) / BRAKE[0], abs(w) / BRAKE[1])
            share = max(0.0, 1.0 - CONTROL_PERIOD_S / max(braking_s, CONTROL_PERIOD_S))
        self._command = (share * v, share * w)
        self._state = replace(self._state, command=self._command)

    def feedback(self) -> Feedback:
        """What a person wants to know of the drive."""
        path, now = self._path, self._ctx.clock.now()
        if path is None:
            return Feedback(status="planning")
        left = max(0.0, path.length - self._state.travelled)
        if not self._ctx.world.localized:
            return Feedback(status=f"standing until the pose is certain again, {left:.1f} m to go")
        status = f"{self._state.phase}, {left:.1f} m to go"
        if self._blocked_now(now):
            status = f"waiting for something in the way, for {self._progress.blocked_for(now):.0f} s"
        return Feedback(status=status, progress=float(min(1.0, self._driven / max(self._driven + left, 0.01))))

    def result(self) -> DriveResult:
        """Where the robot stands, by its own estimate."""
        along, across, yaw = in_frame_of(self._senses.pose(), self._target)
        return DriveResult(
            along_m=float(along),
            across_m=float(across),
            yaw_rad=float(yaw),
            distance_m=self._driven,
            replans=self._replans,
        )

    def _blocked_now(self, now: float) -> bool:
        return self._progress.blocked_for(now) > 0.5

    def _control(self, now: float) -> None:
        odometry, pose, local = self._ctx.world.odometry, self._senses.pose(), self._senses.local
        assert odometry is not None and self._path is not None and local is not None
        if self._senses.surroundings.in_fence(pose):
            raise ActionFailed(Reason.FENCE, f"the robot came into a fence at ({pose[0]:.2f}, {pose[1]:.2f})")
        if self._somebody_walks(now):
            self._command = (0.0, 0.0)
            self._state = replace(self._state, command=self._command)
            self._note_progress(now, pose, blocked=True)
            return
        twist = np.array([odometry.linear[0], odometry.angular[2]])
        step = self._follower.step(self._state, self._path, pose, twist, local, CONTROL_PERIOD_S)
        if step.state.retreats > self._state.retreats:
            across = 100 * in_frame_of(pose, self._target)[1]
            why = f"{abs(across):.1f} cm to the {'left' if across > 0 else 'right'} of the goal"
            self._ctx.log.event("recovery", how="retreat", why=why)
        factor = self._take(step)
        self._note_progress(now, pose, blocked=step.blocked or factor == 0.0 or self._held_back)
        self._ask_for_plan(now)

    def _take(self, step: FollowerStep) -> float:
        """Make a step's command the one to send, slowed before raw points in the way; returns the factor."""
        factor = speed_factor(step.v, step.w, self._senses.points, self._monitor)
        gain = step.state.turn_gain if factor == 1.0 else self._state.turn_gain
        self._command = (factor * step.v, factor * step.w)
        command = self._command if factor == 0.0 else step.state.command
        self._state = replace(step.state, turn_gain=gain, command=command)
        return factor

    def _somebody_walks(self, now: float) -> bool:
        """Whether to stand because somebody walks near the path ahead, or did a moment ago."""
        assert self._path is not None
        place = self._passing.update(now, self._senses.arrived, self._path, self._state.travelled)
        if place is not None:
            self._ctx.log.event("waiting", why="somebody walks near the path", place=place)
        return self._passing.holds(now)

    def _note_progress(self, now: float, pose: Array, *, blocked: bool) -> None:
        if self._last is not None:
            self._driven += float(np.hypot(*(pose[:2] - self._last[:2])))
        self._last = pose
        if self._state.phase is Phase.FAILED:
            raise ActionFailed(Reason.BLOCKED, "cannot settle on the goal within its tolerances")
        progress, phase = self._progress, self._state.phase
        left = float(np.hypot(*(pose[:2] - self._target[:2]))) + abs(in_frame_of(pose, self._target)[2])
        way = self._way_left() + 0.1 * left
        progress.update(now, way, pose, blocked=blocked, excused=phase in STRAYING)
        if phase is Phase.TRACK and progress.stuck(now):
            patience = progress.options.stuck_s
            note_held(self._ctx, pose, self._senses.footprint, backward=self._command[0] < 0.0)
            raise ActionFailed(Reason.BLOCKED, f"no progress for {patience:.0f} s: wheels slip or something holds")
        if progress.still(now):
            raise ActionFailed(Reason.BLOCKED, f"the base has stood for {progress.options.still_s:.0f} s: {phase}")
        if progress.given_up(now):
            raise ActionFailed(Reason.BLOCKED, self._blocked_by or "an obstacle or fence is in the way and stays")

    def _ask_for_plan(self, now: float) -> None:
        """Want another path when this one is blocked, now and then."""
        path, local, ahead = self._path, self._senses.local, self._state.travelled
        assert path is not None and local is not None
        in_way = path_blocked(local, path, ahead + 0.3, ahead + 4.0, self._planner.footprint)
        blocked = self._blocked_now(now)
        if (in_way or blocked) and now >= self._replan_s and self._way_left() > 0.5:
            self.wants_plan = True
            standing = f"for {self._progress.blocked_for(now):.1f} s" if blocked else "ahead"
            self._in_way = f"something is in the way {standing}"

    def _way_left(self) -> float:
        return self._path.length - self._state.travelled if self._path is not None else 0.0

    def _start_path(self) -> None:
        self._state = FollowerState(
            command=self._state.command, turn_gain=self._state.turn_gain, retreats=self._state.retreats
        )
        self._progress.restart(self._ctx.clock.now())

    def _show(self) -> None:
        """What the drive goes by, for who watches it."""
        senses = self._senses
        assert self._path is not None
        self._ctx.world.driving = Driving(
            path=self._path, surroundings=senses.surroundings, scan=senses.points, scan_pose=senses.scan_pose
        )

    def _plan_arguments(self) -> tuple[Any, ...]:
        pose = self._senses.pose()
        options = route_options(self._ctx.robot.description)
        stops = waypoints(self._ctx.world.site.rows, pose, self._target, options)
        return self._senses.surroundings.overall(), pose, stops, self._planner


def _follower(goal: DriveGoal, footprint: Footprint, fences: Costmap) -> LocalPlanner:
    """The local planner that a goal names; it turns only where there is room."""
    planner: LocalPlanner = planner_named(LOCAL_PLANNERS, goal.planner)(
        PursuitOptions(speed=goal.speed, footprint=footprint)
    )
    return RoomToTurn(planner, TurnRoomOptions(footprint=footprint), fences)
