"""Drive the base to a pose in the map."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grape.actions.core import Context, Feedback, action
from grape.actions.shortest_way import footprint_of, route_options, site_surroundings
from grape.drivers import BaseDriver
from grape.errors import ActionFailed, GoalRejected, Reason, StaleData
from grape.frames import FrameError
from grape.geometry import planar_of
from grape.messages import Array
from grape.navigation.beams import scan_points
from grape.navigation.follower import FollowerState, LocalPlanner, Phase, PursuitOptions
from grape.navigation.grid import Costmap
from grape.navigation.monitor import MonitorOptions, speed_factor
from grape.navigation.path import Path, in_frame_of
from grape.navigation.planner import PlannerOptions, path_blocked, plan_route
from grape.navigation.route import waypoints
from grape.navigation.turning import RoomToTurn, TurnRoomOptions
from grape.plugins import LOCAL_PLANNERS, find, load
from grape.world import Driving

PURE_PURSUIT = "pure_pursuit"
CONTROL_PERIOD_S = 0.05
SCAN_PERIOD_S = 0.10
CLOUD_PERIOD_S = 0.30
MAP_PERIOD_S = 0.20
MAX_AGE_S = 0.30  # of pose and scan
PATIENCE_S = 1.0  # with stale data, standing
LOST_S = 45.0  # standing until the pose is good enough again: a receiver without integer fix gets it back within 30 s
BLOCKED_S = 15.0  # with something in the way that does not go
REPLAN_S = 2.0
MAX_REPLANS = 8
DETOUR_S = 6.0  # standing before a long way around is taken: who walked in may leave
STUCK_S = 12.0  # without coming nearer
STRAYING = (Phase.TURN, Phase.RETREAT, Phase.MAKE_ROOM)  # does not come nearer meanwhile


@dataclass(frozen=True, kw_only=True)
class DriveGoal:
    """Where to stand in map: x, y in metres, yaw in radians; speed in m/s, timeout_s of the whole drive.

    planner: a plugin of the group `grape.local_planners`; all but the pure pursuit turn only where there is room.
    """

    x: float
    y: float
    yaw: float
    speed: float = 0.8
    timeout_s: float = 240.0
    planner: str = PURE_PURSUIT


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
    """Drives to a pose around rows, fences and obstacles, and settles there within 2 cm, 3 cm and 1.2 degrees."""
    target = np.array([goal.x, goal.y, goal.yaw])
    if not np.isfinite(target).all() or not 0.0 < goal.speed <= ctx.robot.description.base.max_linear:
        raise GoalRejected(f"a finite pose and a speed up to {ctx.robot.description.base.max_linear} m/s, got {goal}")
    if goal.planner not in (known := find(LOCAL_PLANNERS)):
        raise GoalRejected(f"no local planner {goal.planner!r}; there are {', '.join(sorted(known))}")
    with ctx.base.lease("DriveToPose") as base:
        drive = _Drive(target, goal, ctx)
        try:
            yield from drive.localized(base)
            yield from drive.plan(base)
            while not drive.arrived:
                drive.beat(base)
                yield drive.feedback()
                if drive.wants_plan:
                    yield from drive.replan(base)
        finally:
            ctx.world.driving = None
        return drive.result()


class _Drive:
    """One drive: sensing, planning and following in their own periods."""

    def __init__(self, target: Array, goal: DriveGoal, ctx: Context) -> None:
        self._ctx, self._goal, self._target = ctx, goal, target
        base = ctx.robot.description.base
        footprint = footprint_of(base.footprint)
        self._surroundings = site_surroundings(ctx.world.site, target[None], base)
        self._planner = PlannerOptions(footprint=footprint)
        self._monitor = MonitorOptions(footprint=footprint)
        self._follower: LocalPlanner = load(LOCAL_PLANNERS, goal.planner)(
            PursuitOptions(speed=goal.speed, footprint=footprint)
        )
        if goal.planner != PURE_PURSUIT:
            room = TurnRoomOptions(footprint=footprint)
            self._follower = RoomToTurn(self._follower, room, self._surroundings.fences())
        self._state = FollowerState()
        self._path: Path | None = None
        self._local: Costmap | None = None
        self._points, self._scan_pose = np.empty((0, 2)), np.zeros(3)
        self._command = (0.0, 0.0)
        self._due: dict[str, float] = {}
        self._begun_s = ctx.clock.now()
        self._fresh_s = self._free_s = self._nearer_s = self._begun_s
        self._nearest = np.inf
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
        pose = self._pose()
        if self._surroundings.in_fence(self._target):
            raise ActionFailed(Reason.FENCE, f"the goal ({self._goal.x:.2f}, {self._goal.y:.2f}) touches a fence")
        if self._surroundings.in_fence(pose):
            raise ActionFailed(Reason.FENCE, f"the robot stands in a fence at ({pose[0]:.2f}, {pose[1]:.2f})")

    def plan(self, base: BaseDriver) -> Generator[Feedback, None, None]:
        """The first path; obstacles in view count already.

        Raises:
            ActionFailed: NO_PATH.
        """
        self._sense(force=True)
        yield Feedback(status="looking around")
        yield from self._wait_scans(base)
        self._path = yield from self._ctx.jobs.run(plan_route, *self._plan_arguments())
        self._start_path()

    def replan(self, base: BaseDriver) -> Generator[Feedback, None, None]:
        """Another path around what is in the way; when there is none, the old one is kept and the robot waits."""
        self.wants_plan = False
        self._due["replan"] = self._ctx.clock.now() + REPLAN_S
        try:
            path = yield from self._ctx.jobs.run(plan_route, *self._plan_arguments())
        except ActionFailed as failure:
            self._blocked_by = failure.detail
            return
        left = self._path.length - self._state.travelled if self._path is not None else 0.0
        if path.length > 1.5 * left + 2.0 and self._ctx.clock.now() - self._free_s < DETOUR_S:
            return
        self._path = path
        self._replans += 1
        if self._replans > MAX_REPLANS:
            raise ActionFailed(Reason.BLOCKED, f"{MAX_REPLANS} detours did not lead past what is in the way")
        self._ctx.log.event("recovery", how="detour", why=self._in_way, length_m=path.length)
        self._start_path()

    def beat(self, base: BaseDriver) -> None:
        """One beat: fresh data or standstill, then the follower's command."""
        now = self._ctx.clock.now()
        if now - self._begun_s > self._goal.timeout_s:
            raise ActionFailed(Reason.TIMEOUT, f"not there after {self._goal.timeout_s:.0f} s")
        if not self._fresh(now):
            self._command = (0.0, 0.0)
            self._state = replace(self._state, command=self._command)
            base.send(*self._command)
            return
        self._sense()
        if self._is_due("control", CONTROL_PERIOD_S):
            self._control(now)
        base.send(*self._command)

    def feedback(self) -> Feedback:
        """What a person wants to know of the drive."""
        path = self._path
        if path is None:
            return Feedback(status="planning")
        left = max(0.0, path.length - self._state.travelled)
        if not self._ctx.world.localized:
            return Feedback(status=f"standing until the pose is certain again, {left:.1f} m to go")
        status = "waiting: the way is blocked" if self._blocked_now else f"{self._state.phase}, {left:.1f} m to go"
        return Feedback(status=status, progress=float(min(1.0, self._driven / max(self._driven + left, 0.01))))

    def result(self) -> DriveResult:
        """Where the robot stands, by its own estimate."""
        along, across, yaw = in_frame_of(self._pose(), self._target)
        return DriveResult(
            along_m=float(along),
            across_m=float(across),
            yaw_rad=float(yaw),
            distance_m=self._driven,
            replans=self._replans,
        )

    @property
    def _blocked_now(self) -> bool:
        return self._ctx.clock.now() - self._free_s > 0.5

    def _control(self, now: float) -> None:
        odometry, pose = self._ctx.world.odometry, self._pose()
        assert odometry is not None and self._path is not None and self._local is not None
        if self._surroundings.in_fence(pose):
            raise ActionFailed(Reason.FENCE, f"the robot came into a fence at ({pose[0]:.2f}, {pose[1]:.2f})")
        twist = np.array([odometry.linear[0], odometry.angular[2]])
        step = self._follower.step(self._state, self._path, pose, twist, self._local, CONTROL_PERIOD_S)
        if step.state.retreats > self._state.retreats:
            across = 100 * in_frame_of(pose, self._target)[1]
            why = f"{abs(across):.1f} cm to the {'left' if across > 0 else 'right'} of the goal"
            self._ctx.log.event("recovery", how="retreat", why=why)
        factor = speed_factor(step.v, step.w, self._points, self._monitor)
        gain = step.state.turn_gain if factor == 1.0 else self._state.turn_gain
        self._command = (factor * step.v, factor * step.w)
        command = self._command if factor == 0.0 else step.state.command
        self._state = replace(step.state, turn_gain=gain, command=command)
        self._note_progress(now, pose, step.blocked or factor == 0.0)

    def _note_progress(self, now: float, pose: Array, blocked: bool) -> None:
        if self._last is not None:
            self._driven += float(np.hypot(*(pose[:2] - self._last[:2])))
        self._last = pose
        if self._state.phase is Phase.FAILED:
            raise ActionFailed(Reason.BLOCKED, "cannot settle on the goal within its tolerances")
        left = float(np.hypot(*(pose[:2] - self._target[:2]))) + abs(in_frame_of(pose, self._target)[2])
        path_left = self._path.length - self._state.travelled if self._path is not None else 0.0
        if path_left + 0.1 * left < self._nearest - 0.02 or self._state.phase in STRAYING:
            self._nearest, self._nearer_s = path_left + 0.1 * left, now
        if not blocked:
            self._free_s = now
            if now - self._nearer_s > STUCK_S and self._state.phase is Phase.TRACK:
                raise ActionFailed(Reason.BLOCKED, f"no progress for {STUCK_S:.0f} s: wheels slip or something holds")
        elif now - self._free_s > BLOCKED_S:
            raise ActionFailed(Reason.BLOCKED, self._blocked_by or "an obstacle or fence is in the way and stays")
        ahead = self._state.travelled
        in_way = (
            self._path is not None
            and self._local is not None
            and path_blocked(self._local, self._path, ahead + 0.3, ahead + 4.0, self._planner.footprint)
        )
        if (in_way or self._blocked_now) and now >= self._due.get("replan", 0.0) and path_left > 0.5:
            self.wants_plan = True
            standing = f"for {now - self._free_s:.1f} s" if self._blocked_now else "ahead"
            self._in_way = f"something is in the way {standing}"

    def _start_path(self) -> None:
        self._state = FollowerState(
            command=self._state.command, turn_gain=self._state.turn_gain, retreats=self._state.retreats
        )
        self._nearest, self._nearer_s = np.inf, self._ctx.clock.now()

    def _plan_arguments(self) -> tuple[Any, ...]:
        pose = self._pose()
        options = route_options(self._ctx.robot.description)
        stops = waypoints(self._ctx.world.site.rows, pose, self._target, options)
        return self._surroundings.overall(), pose, stops, self._planner

    def _pose(self) -> Array:
        return planar_of(self._ctx.world.base_pose())

    def _fresh(self, now: float) -> bool:
        """Whether pose and scans are young enough.

        Raises:
            ActionFailed: STALE_DATA or NOT_LOCALIZED, when they stay too old.
        """
        odometry = self._ctx.world.odometry
        old = ""
        if odometry is None or now - odometry.stamp > MAX_AGE_S:
            old = "pose estimate"
        for name, driver in self._ctx.drivers.scans.items():
            if self._on_base(name):
                try:
                    driver.latest(MAX_AGE_S)
                except StaleData:
                    old = name
        lost = not self._ctx.world.localized
        if not old and not lost:
            self._fresh_s = now
            return True
        if now - self._fresh_s > (LOST_S if lost else PATIENCE_S):
            if lost:
                raise ActionFailed(Reason.NOT_LOCALIZED, "the pose estimate became too uncertain to drive by")
            raise ActionFailed(Reason.STALE_DATA, f"{old} is older than {MAX_AGE_S} s")
        return False

    def _wait_scans(self, base: BaseDriver) -> Generator[Feedback, None, None]:
        """Stand for a few scans, so that the first plan knows what is in view."""
        until = self._ctx.clock.now() + 3.2 * SCAN_PERIOD_S
        while self._ctx.clock.now() < until:
            base.send(0.0, 0.0)
            self._fresh(self._ctx.clock.now())
            self._sense()
            yield Feedback(status="looking around")

    def _sense(self, force: bool = False) -> None:
        """Newest scans and clouds into the obstacle layers, and the local costmap from them."""
        drivers, description = self._ctx.drivers, self._ctx.robot.description
        if self._is_due("scan", SCAN_PERIOD_S) or force:
            points = [np.empty((0, 2))]
            for name, driver in drivers.scans.items():
                if self._on_base(name):
                    T_base_sensor = description.T_base_link_sensor(name)
                    scan = self._latest(driver)
                    if scan is None:
                        continue
                    self._surroundings.add_scan(name, scan, self._pose_at(scan.stamp), T_base_sensor)
                    points.append(scan_points(scan, T_base_sensor)[:, :2])
                    self._scan_pose = planar_of(self._pose_at(scan.stamp))
            self._points = np.vstack(points)
        if self._is_due("cloud", CLOUD_PERIOD_S) or force:
            for name, driver_ in drivers.clouds.items():
                cloud = self._latest(driver_)
                if self._on_base(name) and cloud is not None:
                    T_base_sensor = description.T_base_link_sensor(name)
                    self._surroundings.add_cloud(name, cloud, self._pose_at(cloud.stamp), T_base_sensor)
        if self._is_due("map", MAP_PERIOD_S) or force:
            self._local = self._surroundings.local(self._pose()[:2])
        if self._path is not None:
            self._ctx.world.driving = Driving(
                path=self._path, surroundings=self._surroundings, scan=self._points, scan_pose=self._scan_pose
            )

    @staticmethod
    def _latest(driver: Any) -> Any:
        """The newest message, or None when it is too old: `_fresh` deals with that."""
        try:
            return driver.latest(MAX_AGE_S)
        except StaleData:
            return None

    def _on_base(self, name: str) -> bool:
        mount = self._ctx.robot.description.mounts.get(name)
        return mount is not None and mount.parent == "base_link"

    def _pose_at(self, stamp: float) -> Array:
        try:
            return self._ctx.world.frames.lookup("map", "base_link", stamp)
        except FrameError:
            return self._ctx.world.base_pose()

    def _is_due(self, name: str, period_s: float) -> bool:
        now = self._ctx.clock.now()
        if now + 1e-9 < self._due.get(name, -np.inf):
            return False
        self._due[name] = now + period_s
        return True
