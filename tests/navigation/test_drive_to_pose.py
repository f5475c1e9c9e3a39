from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_package import brought

from grape import plugins
from grape.actions import core
from grape.actions.drive_to_pose import DriveGoal, drive_to_pose
from grape.actions.held_places import held_areas, note_held
from grape.drivers import Drivers
from grape.errors import ActionFailed, GoalRejected, Reason, StaleData
from grape.geodesy import Datum
from grape.geometry import pose as make_pose
from grape.geometry import rotation_z
from grape.messages import JointState, LaserScan, Odometry, Twist
from grape.navigation.grid import Footprint
from grape.navigation.path import in_frame_of
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.site import Area, Row, Site
from grape.world import World

FOOTPRINT = Footprint()
T_BASE_LASER = make_pose(translation=(0.45, 0.0, 0.20))


class Machine:
    """Clock, base, laser and pose estimate of a kinematic robot."""

    def __init__(self, scan: Callable[..., LaserScan], pose: tuple[float, float, float]) -> None:
        self.pose, self.time_s = np.array(pose), 0.0
        self.v = self.w = 0.0
        self.circles = np.array([[90.0, 90.0, 0.1]])
        self.mud = np.array([90.0, 90.0, 0.1])  # within so far (m) of a place nothing goes ahead
        self.stops = 0
        self.laser_works = self.localized = True
        self._scan, self._rng = scan, np.random.default_rng(1)

    def now(self) -> float:
        return self.time_s

    def send(self, linear_x: float, angular_z: float) -> Twist:
        self.v, self.w = linear_x, angular_z
        return Twist(stamp=self.time_s, linear=np.array([self.v, 0, 0]), angular=np.array([0, 0, self.w]))

    def stop(self) -> None:
        self.v = self.w = 0.0
        self.stops += 1

    def latest(self, max_age_s: float | None = None) -> Any:
        if not self.laser_works:
            raise StaleData("front_laser: nothing")
        if max_age_s is None:
            return JointState(stamp=0.0, name=(), position=np.zeros(0), velocity=np.zeros(0), effort=np.zeros(0))
        scan = self._scan(self.circles, self.pose, self._rng)
        object.__setattr__(scan, "stamp", self.time_s)
        return scan

    def advance(self, world: World, dt: float = 0.01) -> None:
        x, y, yaw = self.pose
        if np.hypot(x - self.mud[0], y - self.mud[1]) < self.mud[2]:
            self.v = min(self.v, 0.0)
        self.pose = np.array([x + self.v * np.cos(yaw) * dt, y + self.v * np.sin(yaw) * dt, yaw + 0.8 * self.w * dt])
        self.time_s += dt
        self.estimate(world)

    def estimate(self, world: World) -> None:
        T = make_pose(rotation_z(self.pose[2]), (self.pose[0], self.pose[1], 0.132))
        world.localized = self.localized
        world.odometry = Odometry(
            stamp=self.time_s,
            frame_id="map",
            child_frame_id="base_link",
            pose=T,
            linear=np.array([self.v, 0.0, 0.0]),
            angular=np.array([0.0, 0.0, 0.8 * self.w]),
            pose_covariance=np.zeros((6, 6)),
            twist_covariance=np.zeros((6, 6)),
        )
        world.frames.push("map", "base_link", T, self.time_s)


def site(*fences: Area) -> Site:
    row = Row(id="r0", side="right", line=np.array([[0.0, 0.0], [8.0, 0.0]]))
    ground = Area(id="h", polygon=np.array([[-4.0, -3.0], [12.0, -3.0], [12.0, 3.0], [-4.0, 3.0]]))
    return Site(
        datum=Datum(latitude_deg=42.0, longitude_deg=3.0),
        rows=(row,),
        plants=(),
        headlands=(ground,),
        fences=fences,
        start=np.array([-3.0, -0.8]),
        start_heading_rad=0.0,
    )


@pytest.fixture
def setting(scan):
    def make(pose=(-3.0, -0.8, 0.0), fences: tuple[Area, ...] = ()) -> tuple[Machine, core.Context]:
        machine = Machine(scan, pose)
        mount = SimpleNamespace(parent="base_link", T_parent_sensor=T_BASE_LASER)
        description = SimpleNamespace(
            base=DESCRIPTION.base,
            arm=DESCRIPTION.arm,
            mounts={"front_laser": mount},
            T_base_link_sensor=lambda name: T_BASE_LASER,
        )
        none: Any = SimpleNamespace(stop=lambda: None)
        drivers = Drivers(
            base=machine, arm=none, gripper=none, camera=none, imu=none, gnss=none, scans={"front_laser": machine}
        )
        log: Any = SimpleNamespace(event=lambda kind, **fields: None)
        ctx = core.Context(
            clock=machine,
            world=World(site=site(*fences)),
            drivers=drivers,
            robot=SimpleNamespace(description=description),
            jobs=core.InlineJobs(),
            log=log,
            ledger=none,
            rng=np.random.default_rng(0),
        )
        machine.estimate(ctx.world)
        return machine, ctx

    return make


def drive(machine: Machine, ctx: core.Context, goal: DriveGoal, on_beat=lambda t: None, limit_s: float = 120.0):
    """Run the action to its end; returns its result and the feedback it gave."""
    run, feedback = drive_to_pose(goal, ctx), []
    try:
        while machine.time_s < limit_s:
            feedback.append(next(run))
            on_beat(machine.time_s)
            machine.advance(ctx.world)
    except StopIteration as stop:
        return stop.value, feedback
    raise AssertionError(f"still driving after {limit_s} s: {feedback[-1]}")


def test_robot_arrives_stops_and_tells_progress(setting):
    machine, ctx = setting()
    goal = DriveGoal(x=2.0, y=-0.835, yaw=0.0)
    result, feedback = drive(machine, ctx, goal)
    along, across, yaw = in_frame_of(machine.pose, np.array([goal.x, goal.y, goal.yaw]))
    assert abs(along) < 0.03 and abs(across) < 0.03 and abs(yaw) < 0.035
    assert abs(result.along_m - along) < 0.01
    assert machine.v == 0.0 and machine.stops == 1 and ctx.base.owner is None
    progress = [f.progress for f in feedback if f.progress is not None]
    assert progress[-1] > 0.95 and progress[len(progress) // 2] < 0.9


def test_while_it_drives_the_world_knows_its_path_obstacles_and_scan_and_afterwards_no_more(setting):
    machine, ctx = setting()
    machine.circles = np.array([[0.0, 1.6, 0.15]])
    seen = []
    drive(machine, ctx, DriveGoal(x=-0.5, y=-0.835, yaw=0.0), lambda t: seen.append((machine.pose, ctx.world.driving)))
    assert ctx.world.driving is None
    pose, driving = [each for each in seen if each[1] is not None][-1]
    np.testing.assert_allclose(driving.path.goal, [-0.5, -0.835, 0.0], atol=0.03)
    np.testing.assert_allclose(driving.scan_pose, pose, atol=0.1)
    x, y, yaw = driving.scan_pose
    hits = driving.scan @ rotation_z(yaw)[:2, :2].T + [x, y]
    assert len(hits) and np.abs(np.hypot(*(hits - [0.0, 1.6]).T) - 0.15).max() < 0.1
    obstacles = driving.surroundings.obstacles()
    assert len(obstacles) and np.hypot(*(obstacles - [0.0, 1.6]).T).max() < 0.3


@pytest.mark.parametrize("planner", ["dwa", "teb", "mppi"])
def test_robot_that_faces_away_turns_and_arrives_by_each_planner(setting, planner):
    machine, ctx = setting((-3.0, -1.4, 2.5))
    goal = DriveGoal(x=0.0, y=-0.835, yaw=0.0, planner=planner)
    drive(machine, ctx, goal)
    along, across, yaw = in_frame_of(machine.pose, np.array([goal.x, goal.y, goal.yaw]))
    assert np.hypot(along, across) < 0.05 and abs(yaw) < 0.035


def test_robot_drives_the_way_that_another_global_planner_finds(setting, tmp_path, monkeypatch):
    (tmp_path / "scenic_ways.py").write_text(
        "import numpy as np\nfrom grape.navigation import plan_route\n"
        "def aside(costmap, start, waypoints, options=None):\n"
        "    return plan_route(costmap, start, np.vstack([[-1.5, -1.8, 0.0], waypoints[-1:]]), options)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    brought(monkeypatch, plugins.GLOBAL_PLANNERS, "aside", "scenic_ways:aside")
    machine, ctx = setting()
    seen = []
    goal = DriveGoal(x=2.0, y=-0.835, yaw=0.0, global_planner="aside")
    drive(machine, ctx, goal, lambda t: seen.append(machine.pose[1]))
    assert min(seen) < -1.5 and abs(seen[-1] - goal.y) < 0.03


@pytest.mark.parametrize(
    "goal",
    [
        DriveGoal(x=np.nan, y=0.0, yaw=0.0),
        DriveGoal(x=1.0, y=-2.0, yaw=0.0, speed=0.0),
        DriveGoal(x=1.0, y=-2.0, yaw=0.0, planner="tab"),
        DriveGoal(x=1.0, y=-2.0, yaw=0.0, global_planner="lags"),
    ],
)
def test_impossible_goal_is_rejected_before_anything_moves(setting, goal):
    machine, ctx = setting()
    with pytest.raises(GoalRejected):
        drive(machine, ctx, goal)
    assert machine.stops == 0


def test_a_slow_base_drives_as_fast_as_it_can(setting):
    machine, ctx = setting()
    ctx.robot.description.base = replace(DESCRIPTION.base, max_linear=0.3)
    speeds: list[float] = []
    drive(machine, ctx, DriveGoal(x=-1.5, y=-0.8, yaw=0.0), lambda t: speeds.append(abs(machine.v)))
    assert max(speeds) == pytest.approx(0.3)


def failure(setting_result, goal: DriveGoal, on_beat=lambda t: None) -> ActionFailed:
    machine, ctx = setting_result
    with pytest.raises(ActionFailed) as failed:
        drive(machine, ctx, goal, on_beat)
    assert machine.v == 0.0 and machine.w == 0.0 and machine.stops == 1
    return failed.value


def test_goal_in_the_row_is_refused_for_its_fence(setting):
    assert failure(setting(), DriveGoal(x=3.0, y=-0.3, yaw=0.0)).reason is Reason.FENCE


def test_start_in_a_fence_is_refused(setting):
    assert failure(setting((3.0, -0.3, 0.0)), DriveGoal(x=6.0, y=-0.9, yaw=0.0)).reason is Reason.FENCE


def test_goal_behind_a_closed_fence_has_no_path(setting):
    wall = Area(id="wall", polygon=np.array([[-1.0, -9.0], [-0.8, -9.0], [-0.8, 9.0], [-1.0, 9.0]]))
    assert failure(setting(fences=(wall,)), DriveGoal(x=3.0, y=-0.9, yaw=0.0)).reason is Reason.NO_PATH


def test_robot_that_is_not_localized_does_not_drive(setting):
    machine, ctx = setting()
    machine.localized = False
    machine.estimate(ctx.world)
    assert failure((machine, ctx), DriveGoal(x=2.0, y=-0.835, yaw=0.0)).reason is Reason.NOT_LOCALIZED
    assert machine.pose[0] == -3.0


def test_robot_that_stood_for_want_of_a_pose_is_not_stuck(setting):
    machine, ctx = setting()
    sent = []

    def lose(now: float) -> None:
        machine.localized = not (3.0 < now % 20.0 < 17.0)
        sent.append((now, machine.v))

    result, _ = drive(machine, ctx, DriveGoal(x=2.0, y=-0.835, yaw=0.0), lose)
    lost = np.array([(now, v) for now, v in sent if 3.05 < now < 17.0])
    assert (lost[lost[:, 0] > 4.0, 1] == 0.0).all(), "within a second it stands"
    assert lost[0, 1] > 0.5 and np.diff(lost[:, 1]).min() > -0.06, "gently"
    assert abs(result.along_m) < 0.05 and machine.time_s > 17.0


@pytest.mark.parametrize(("lost", "reason"), [(False, Reason.STALE_DATA), (True, Reason.NOT_LOCALIZED)])
def test_laser_that_falls_silent_stops_the_base_and_ends_the_drive(setting, lost, reason):
    machine, ctx = setting()

    def break_laser(now: float) -> None:
        machine.laser_works = now < 3.0
        machine.localized = now < 3.0 or not lost
        if now > 3.3:
            assert machine.v == 0.0

    assert failure((machine, ctx), DriveGoal(x=4.0, y=-0.835, yaw=0.0), break_laser).reason is reason


def test_blocked_lane_without_a_way_around_stops_the_robot_before_the_obstacle(setting):
    side = Area(id="side", polygon=np.array([[-1.0, -1.9], [-1.0, -1.7], [8.6, -1.7], [8.6, -1.9]]))
    end = Area(id="end", polygon=np.array([[8.2, -1.9], [8.6, -1.9], [8.6, 0.3], [8.2, 0.3]]))
    machine, ctx = setting(fences=(side, end))
    nose = []

    def block(now: float) -> None:
        nose.append(machine.pose[0] + 0.495)
        if now > 2.0:
            machine.circles = across_the_lane(1.6)

    assert failure((machine, ctx), DriveGoal(x=4.0, y=-0.835, yaw=0.0), block).reason is Reason.BLOCKED
    assert 0.0 < max(nose) < 1.54


def across_the_lane(x: float) -> Any:
    """Posts (n, 3) so near to each other that nobody gets through, from the row to y = -1.7 m."""
    y = np.arange(-1.7, -0.2, 0.15)
    return np.column_stack([np.full(len(y), x), y, np.full(len(y), 0.06)])


def test_lane_that_is_blocked_before_the_drive_begins_is_no_error_of_the_site(setting):
    side = Area(id="side", polygon=np.array([[-4.0, -1.9], [-4.0, -1.7], [8.6, -1.7], [8.6, -1.9]]))
    ends = [
        Area(id=f"end {x}", polygon=np.array([[x, -1.9], [x + 0.4, -1.9], [x + 0.4, 0.3], [x, 0.3]]))
        for x in (-4.4, 8.2)
    ]
    row = Area(id="row", polygon=np.array([[-4.0, -0.2], [0.0, -0.2], [0.0, 0.2], [-4.0, 0.2]]))
    machine, ctx = setting(fences=(side, row, *ends))
    machine.circles = across_the_lane(-0.8)
    failed = failure((machine, ctx), DriveGoal(x=4.0, y=-0.835, yaw=0.0))
    assert failed.reason is Reason.BLOCKED and "what stands there" in failed.detail
    assert machine.pose[0] == -3.0


def test_person_who_leaves_is_waited_for(setting):
    machine, ctx = setting()
    nobody, person = machine.circles, np.array([[0.6, y, 0.25] for y in np.arange(-6.0, 6.0, 0.5)])

    def walk(now: float) -> None:
        machine.circles = person if 1.5 < now < 9.0 else nobody

    result, feedback = drive(machine, ctx, DriveGoal(x=3.0, y=-0.835, yaw=0.0), walk)
    assert abs(result.along_m) < 0.03
    assert any("waiting" in f.status for f in feedback)


def test_robot_stops_before_somebody_who_crosses_waits_and_goes_on(setting):
    machine, ctx = setting()
    least, speeds, waited = [], [], []
    ctx.log = SimpleNamespace(event=lambda kind, **fields: waited.append(kind))  # type: ignore[assignment]

    def cross(now: float) -> None:
        person = np.array([0.9, -3.5 + 1.2 * (now - 1.0), 0.2])
        machine.circles = person[None]
        nose = machine.pose[0] + 0.495
        least.append(np.hypot(max(0.0, person[0] - nose), max(0.0, abs(person[1] - machine.pose[1]) - 0.343)) - 0.2)
        speeds.append(machine.v)

    result, feedback = drive(machine, ctx, DriveGoal(x=3.0, y=-0.835, yaw=0.0), cross)
    assert abs(result.along_m) < 0.03 and result.replans == 0, "it did not dodge, it waited"
    assert min(least) > 0.5
    assert waited == ["waiting"]
    stood = np.array(speeds) == 0.0
    assert 100 < np.count_nonzero(stood[200:-100]) < 800, "between one and eight seconds"
    assert any(f.status.startswith("waiting for something in the way") for f in feedback)


def test_robot_goes_around_somebody_who_came_and_stays(setting):
    machine, ctx = setting()

    def come(now: float) -> None:
        machine.circles = np.array([[0.6, max(-0.9, 2.0 - 1.0 * now), 0.2]])

    result, _ = drive(machine, ctx, DriveGoal(x=3.0, y=-0.835, yaw=0.0), come)
    assert abs(result.along_m) < 0.03 and result.replans >= 1


def test_base_that_is_held_back_by_its_guard_is_blocked_and_not_stuck(setting):
    machine, ctx = setting()
    send, begun = machine.send, []

    def guarded(linear_x: float, angular_z: float) -> Twist:
        return send(0.0, 0.0) if machine.time_s > 3.0 else send(linear_x, angular_z)

    machine.send = guarded  # type: ignore[method-assign]
    failed = failure((machine, ctx), DriveGoal(x=3.0, y=-0.835, yaw=0.0), begun.append)
    assert failed.reason is Reason.BLOCKED and "in the way" in failed.detail
    assert 17.5 < begun[-1] < 19.0


def recoveries(ctx: core.Context) -> list[dict[str, Any]]:
    """Fields of the `recovery` events from now on."""
    noted: list[dict[str, Any]] = []
    ctx.log = SimpleNamespace(event=lambda kind, **fields: noted.append(fields) if kind == "recovery" else None)  # type: ignore[assignment]
    return noted


def test_next_drive_goes_round_a_place_where_wheels_slipped(setting):
    machine, ctx = setting()
    machine.mud = np.array([-0.8, -0.8, 0.6])
    goal = DriveGoal(x=2.0, y=-0.835, yaw=0.0)
    failed = failure((machine, ctx), goal)
    assert failed.reason is Reason.BLOCKED and "wheels slip" in failed.detail
    assert -1.5 < machine.pose[0] < -1.3
    machine.pose[0] -= 0.6
    machine.estimate(ctx.world)
    seen = []
    drive(machine, ctx, goal, lambda t: seen.append(machine.pose.copy()), limit_s=machine.time_s + 60.0)
    assert np.hypot(*(np.array(seen)[:, :2] - machine.mud[:2]).T).min() > 0.6
    assert np.hypot(*in_frame_of(machine.pose, np.array([goal.x, goal.y, goal.yaw]))[:2]) < 0.05


def test_where_no_other_way_is_left_the_next_drive_tries_again(setting):
    lane = Area(id="lane", polygon=np.array([[-2.5, -1.6], [9.0, -1.6], [9.0, -1.7], [-2.5, -1.7]]))
    end = Area(id="end", polygon=np.array([[8.5, -1.6], [8.6, -1.6], [8.6, 9.0], [8.5, 9.0]]))
    machine, ctx = setting(fences=(lane, end))
    machine.mud = np.array([2.0, -0.8, 0.5])
    goal = DriveGoal(x=5.0, y=-0.9, yaw=0.0)
    assert "wheels slip" in failure((machine, ctx), goal).detail
    machine.pose[0] -= 0.6
    machine.mud[2] = 0.0
    machine.estimate(ctx.world)
    drive(machine, ctx, goal, limit_s=machine.time_s + 60.0)
    assert np.hypot(*in_frame_of(machine.pose, np.array([goal.x, goal.y, goal.yaw]))[:2]) < 0.05


def test_a_place_where_wheels_slipped_is_tried_again_in_time_and_left_by_who_stands_in_it(setting):
    machine, ctx = setting()
    note_held(ctx, np.array([-3.0, -0.8, 0.0]), FOOTPRINT, backward=False)
    (ahead,) = held_areas(ctx, FOOTPRINT)
    assert np.allclose(ahead.min(axis=0), [-2.455, -1.235]) and np.allclose(ahead.max(axis=0), [-1.605, -0.365])
    note_held(ctx, np.array([-3.0, -0.8, 0.0]), FOOTPRINT, backward=True)
    assert held_areas(ctx, FOOTPRINT)[1][:, 0].max() == pytest.approx(-3.545)
    machine.pose[0] += 0.2
    machine.estimate(ctx.world)
    assert len(held_areas(ctx, FOOTPRINT)) == 1
    machine.time_s += 700.0
    assert held_areas(ctx, FOOTPRINT) == []


def test_undisturbed_drive_needs_no_recovery(setting):
    machine, ctx = setting()
    noted = recoveries(ctx)
    drive(machine, ctx, DriveGoal(x=1.0, y=-0.835, yaw=0.0))
    assert noted == []


def test_detour_around_an_obstacle_is_a_recovery(setting):
    machine, ctx = setting()
    noted = recoveries(ctx)

    def appear(now: float) -> None:
        if now > 1.5:
            machine.circles = np.array([[0.5, -1.0, 0.15]])

    result, _ = drive(machine, ctx, DriveGoal(x=3.0, y=-0.835, yaw=0.0), appear)
    detours = [event for event in noted if event["how"] == "detour"]
    assert detours and len(detours) == result.replans
    assert all(event["why"].startswith("something is in the way") and event["length_m"] > 0 for event in detours)


def test_retreat_from_beside_the_goal_is_a_recovery(setting):
    machine, ctx = setting()
    noted, goal, slipped = recoveries(ctx), DriveGoal(x=1.0, y=-0.835, yaw=0.0), []

    def slip(now: float) -> None:
        if not slipped and machine.pose[0] > goal.x - 0.05:
            slipped.append(now)
            machine.pose = machine.pose - [0.0, 0.08, 0.0]

    result, _ = drive(machine, ctx, goal, slip)
    assert abs(result.across_m) < 0.03 and slipped
    (event,) = noted
    assert event["how"] == "retreat"
    assert "cm to the right of the goal" in event["why"] and float(event["why"].split()[0]) > 3.0


def test_drive_that_takes_too_long_times_out(setting):
    goal = DriveGoal(x=4.0, y=-0.835, yaw=0.0, timeout_s=2.0)
    assert failure(setting(), goal).reason is Reason.TIMEOUT


def test_preempted_drive_stops_the_base(setting):
    machine, ctx = setting()
    run = drive_to_pose(DriveGoal(x=4.0, y=-0.835, yaw=0.0), ctx)
    for _ in range(250):
        next(run)
        machine.advance(ctx.world)
    assert machine.v > 0.3
    run.close()
    assert machine.v == 0.0 and machine.stops == 1 and ctx.base.owner is None
