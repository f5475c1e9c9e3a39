from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.actions import core
from grape.actions.recoveries import (
    BackOffGoal,
    LeaveFenceGoal,
    TurnGoal,
    WaitGoal,
    back_off,
    leave_fence,
    turn,
    wait,
)
from grape.drivers import Drivers
from grape.errors import ActionFailed, GoalRejected, Reason, StaleData
from grape.geodesy import Datum
from grape.geometry import pose as make_pose
from grape.geometry import rotation_z, yaw_of
from grape.messages import Array, LaserScan, Odometry, PointCloud, Twist
from grape.mission.guard import guarded
from grape.navigation.grid import Footprint
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.areas import polygons_touch
from grape.site import Area, Row, Site
from grape.world import World

SITE = Site(
    datum=Datum(latitude_deg=42.0, longitude_deg=3.0),
    rows=(Row(id="r0", side="right", line=np.array([[0.0, 0.0], [8.0, 0.0]])),),
    plants=(),
    headlands=(),
    fences=(),
    start=np.array([-3.0, -2.0]),
    start_heading_rad=0.0,
)


class Bench:
    """A base that moves as it is told, a laser that sees nothing, and a cloud of what is put there.

    Args:
        fences: of the site; with them the base is behind its guard, and brakes with 1 m/s^2 and 1 rad/s^2 at most.
    """

    def __init__(self, *fences: Array) -> None:
        self.moving, self.braking = np.zeros(2), 0.01 if fences else np.inf
        self.time_s, self.pose = 0.0, np.array([-3.0, -2.0, 0.0])
        self.held = self.silent = self.cloudless = False
        self.sent: list[tuple[float, float]] = []
        self.stops = 0
        self.cloud = np.empty((0, 3))  # in base_link at the start
        none: Any = SimpleNamespace(stop=lambda: None)
        laser: Any = SimpleNamespace(latest=self.scan)
        cloud: Any = SimpleNamespace(latest=self.points)
        drivers = Drivers(
            base=self, arm=none, gripper=none, camera=none, imu=none, gnss=none,  # type: ignore[arg-type]
            scans={"front_laser": laser}, clouds={"velodyne": cloud},
        )  # fmt: skip
        self.told: list[str] = []  # zones by which the guard decided
        log: Any = SimpleNamespace(event=lambda kind, **fields: self.told.append(fields.get("zone", kind)))
        areas = tuple(Area(id=f"fence {k}", polygon=polygon) for k, polygon in enumerate(fences))
        world = World(site=replace(SITE, fences=areas))
        robot: Any = SimpleNamespace(description=replace(DESCRIPTION, arm=replace(DESCRIPTION.arm, touch=None)))
        self.ctx = core.Context(
            clock=self,
            world=world,
            drivers=guarded(drivers, robot, world, self, log) if fences else drivers,
            robot=robot,
            jobs=core.InlineJobs(),
            log=log,
            ledger=none,
            rng=np.random.default_rng(0),
        )
        self.estimate()

    def now(self) -> float:
        return self.time_s

    def send(self, linear_x: float, angular_z: float) -> Twist:
        self.sent.append((0.0, 0.0) if self.held else (linear_x, angular_z))
        v, w = self.sent[-1]
        return Twist(stamp=self.time_s, linear=np.array([v, 0.0, 0.0]), angular=np.array([0.0, 0.0, w]))

    def stop(self) -> None:
        self.stops += 1

    def scan(self, max_age_s: float | None = None) -> LaserScan:
        if self.silent:
            raise StaleData("front_laser: nothing")
        ranges = np.full(271, np.inf)
        return LaserScan(
            stamp=self.time_s, angle_min=-2.356, angle_increment=0.01745, range_min=0.1, range_max=30.0, ranges=ranges
        )

    def points(self, max_age_s: float | None = None) -> PointCloud:
        if self.cloudless:
            raise StaleData("velodyne: nothing")
        T_sensor = DESCRIPTION.T_base_link_sensor("velodyne")
        return PointCloud(stamp=self.time_s, points=self.cloud - T_sensor[:3, 3])

    def estimate(self) -> None:
        x, y, yaw = self.pose
        T = make_pose(rotation_z(yaw), (x, y, 0.132))
        self.ctx.world.localized = True
        self.ctx.world.odometry = Odometry(
            stamp=self.time_s, frame_id="map", child_frame_id="base_link", pose=T, linear=np.zeros(3),
            angular=np.zeros(3), pose_covariance=np.zeros((6, 6)), twist_covariance=np.zeros((6, 6)),
        )  # fmt: skip
        self.ctx.world.frames.push("map", "base_link", T, self.time_s)

    def run(self, generator: Any, on_beat: Callable[[float], None] = lambda now: None, limit_s: float = 40.0) -> Any:
        """The result of an action, beat by beat."""
        try:
            while self.time_s < limit_s:
                next(generator)
                on_beat(self.time_s)
                wish = np.array(self.sent[-1] if self.sent else (0.0, 0.0))
                self.moving = self.moving + np.clip(wish - self.moving, -self.braking, self.braking)
                (v, w), yaw = self.moving, self.pose[2]
                self.pose = self.pose + 0.01 * np.array([v * np.cos(yaw), v * np.sin(yaw), w])
                self.time_s += 0.01
                self.estimate()
        except StopIteration as stop:
            return stop.value
        raise AssertionError("never ended")


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_backing_off_goes_straight_back_smoothly_and_stops(bench):
    result = bench.run(back_off(BackOffGoal(distance=0.6, speed=0.2), bench.ctx))
    np.testing.assert_allclose(bench.pose, [-3.6, -2.0, 0.0], atol=0.01)
    assert result.backed_m == pytest.approx(0.6, abs=0.01)
    speeds = np.array(bench.sent)[:, 0]
    assert speeds.min() == pytest.approx(-0.2) and np.abs(np.diff(speeds)).max() <= 0.5 * 0.01 + 1e-9
    assert bench.stops == 1 and bench.ctx.base.owner is None


@pytest.mark.parametrize("angle", [2.9, -1.0])
def test_turning_counts_the_angle_also_over_the_back(bench, angle):
    bench.pose = np.array([-3.0, -2.0, 2.0])
    bench.estimate()
    result = bench.run(turn(TurnGoal(angle=angle, rate=0.5), bench.ctx))
    assert result.turned_rad == pytest.approx(angle, abs=0.02)
    assert yaw_of(bench.ctx.world.base_pose()) == pytest.approx((2.0 + angle + np.pi) % (2 * np.pi) - np.pi, abs=0.02)


def test_waiting_stands_for_its_time_and_tells_how_long(bench):
    bench.run(wait(WaitGoal(duration_s=2.0), bench.ctx))
    assert bench.time_s == pytest.approx(2.0, abs=0.02)
    assert set(bench.sent) == {(0.0, 0.0)} and bench.stops == 1


@pytest.mark.parametrize(
    "generator",
    [
        lambda ctx: wait(WaitGoal(duration_s=-1.0), ctx),
        lambda ctx: back_off(BackOffGoal(distance=5.0), ctx),
        lambda ctx: back_off(BackOffGoal(speed=0.9), ctx),
        lambda ctx: turn(TurnGoal(angle=4.0), ctx),
        lambda ctx: turn(TurnGoal(angle=0.0), ctx),
        lambda ctx: leave_fence(LeaveFenceGoal(speed=0.5), ctx),
    ],
)
def test_impossible_goals_are_rejected_before_anything_moves(bench, generator):
    with pytest.raises(GoalRejected):
        bench.run(generator(bench.ctx))
    assert bench.sent == [] and bench.stops == 0


def test_what_stands_behind_is_seen_by_the_cloud_and_not_backed_into(bench):
    z = np.linspace(0.3, 1.0, 30)
    column = np.array([(-1.1 + dx, dy) for dx in (0.0, 0.02) for dy in np.arange(-0.1, 0.11, 0.02)])
    bench.cloud = np.array([(x, y, h) for x, y in column for h in z])

    def stay(now: float) -> None:
        bench.cloud[:, 0] = -4.1 - bench.pose[0]

    with pytest.raises(ActionFailed) as failed:
        bench.run(back_off(BackOffGoal(distance=1.5), bench.ctx), stay)
    assert failed.value.reason is Reason.BLOCKED
    assert 0.2 < -3.0 - bench.pose[0] < 0.6 and bench.stops == 1


def stays_off(bench: Bench, fence: Array) -> Callable[[float], None]:
    """Checks in each beat, by an algorithm of another room, that the robot does not stand on a fence."""
    front, left = DESCRIPTION.base.footprint.max(axis=0)
    body = Footprint(front=front, rear=front, half_width=left)

    def check(now: float) -> None:
        assert not polygons_touch(body.corners(bench.pose), fence), f"at {bench.pose}"

    return check


def test_backing_off_ends_before_a_fence_that_nothing_sees():
    fence = np.array([[-4.2, -9.0], [-4.1, -9.0], [-4.1, 9.0], [-4.2, 9.0]])
    bench = Bench(fence)
    with pytest.raises(ActionFailed) as failed:
        bench.run(back_off(BackOffGoal(distance=2.0, speed=0.3), bench.ctx))
    assert failed.value.reason is Reason.BLOCKED
    assert -4.1 + 0.495 < bench.pose[0] < -3.2


def test_turning_ends_before_a_corner_comes_over_a_fence_beside_the_base():
    fence = np.array([[-9.0, -1.55], [9.0, -1.55], [9.0, -1.45], [-9.0, -1.45]])
    bench = Bench(fence)
    with pytest.raises(ActionFailed) as failed:
        bench.run(turn(TurnGoal(angle=2.0, rate=0.8), bench.ctx), stays_off(bench, fence))
    assert failed.value.reason is Reason.BLOCKED and "held back" in failed.value.detail
    assert 0.05 < bench.pose[2] < 0.5 and bench.told[-1] == "fence"


@pytest.mark.parametrize("seed", range(3))
def test_no_recovery_crosses_a_fence(seed):
    rng = np.random.default_rng(seed)
    x, gap, side = rng.uniform(-0.6, 0.2), rng.uniform(0.04, 0.2), rng.choice([-1.0, 1.0])
    corners = np.array([[x, 0.343 + gap], [x - 0.3, 0.9], [x + 0.3, 0.9]])  # a wedge, beside the base or its way back
    fence = np.array([-3.0, -2.0]) + corners * [1.0, side]
    bench, ended = Bench(fence), []
    check = stays_off(bench, fence)
    check(0.0)
    for recovery in (
        turn(TurnGoal(angle=rng.choice([-1.5, 1.5]), rate=0.8), bench.ctx),
        back_off(BackOffGoal(distance=0.8, speed=0.3), bench.ctx),
    ):
        try:
            bench.run(recovery, check)
            ended.append("done")
        except ActionFailed as failed:
            ended.append(str(failed.reason))
    assert set(ended) <= {"done", "blocked"} and "fence" in bench.told, "the guard was asked for"


def test_base_that_is_held_back_gives_up_as_blocked(bench):
    bench.held = True
    with pytest.raises(ActionFailed) as failed:
        bench.run(turn(TurnGoal(angle=1.0), bench.ctx))
    assert failed.value.reason is Reason.BLOCKED and 3.0 < bench.time_s < 3.2 and bench.stops == 1


@pytest.mark.parametrize("what", ["back off", "turn"])
def test_base_that_is_sent_and_does_not_move_gives_up_as_blocked(bench, what):
    bench.braking = 0.0
    stuck = (
        back_off(BackOffGoal(distance=0.6), bench.ctx) if what == "back off" else turn(TurnGoal(angle=1.0), bench.ctx)
    )
    with pytest.raises(ActionFailed) as failed:
        bench.run(stuck)
    assert failed.value.reason is Reason.BLOCKED and "wheels slip" in failed.value.detail
    assert 10.0 < bench.time_s < 10.2 and bench.stops == 1


@pytest.mark.parametrize("speed", [0.02, 0.3])
def test_base_that_is_slow_gets_there(bench, speed):
    result = bench.run(back_off(BackOffGoal(distance=0.4, speed=speed), bench.ctx))
    assert result.backed_m == pytest.approx(0.4, abs=0.01)


def test_silent_laser_stands_and_ends_the_recovery(bench):
    def fail(now: float) -> None:
        bench.silent = now > 1.0
        if now > 1.5:
            assert bench.sent[-1] == (0.0, 0.0)

    with pytest.raises(ActionFailed) as failed:
        bench.run(back_off(BackOffGoal(distance=3.0), bench.ctx), fail)
    assert failed.value.reason is Reason.STALE_DATA


@pytest.mark.parametrize("from_s", [0.0, 1.0])
def test_nothing_backs_off_blind_while_the_sensor_that_sees_the_rear_is_silent(bench, from_s):
    def fall_silent(now: float) -> None:
        bench.cloudless = now >= from_s
        if now > from_s + 0.5:
            assert bench.sent[-1] == (0.0, 0.0)

    fall_silent(0.0)
    with pytest.raises(ActionFailed) as failed:
        bench.run(back_off(BackOffGoal(distance=3.0), bench.ctx), fall_silent)
    assert failed.value.reason is Reason.STALE_DATA and "velodyne" in failed.value.detail
    assert bench.pose[0] > -3.0 - 0.2 * from_s - 0.1


def test_a_turn_goes_on_without_the_sensor_that_sees_the_rear(bench):
    bench.cloudless = True
    bench.run(turn(TurnGoal(angle=1.0), bench.ctx))


def test_a_robot_without_clouds_backs_off_by_its_scans(bench):
    bench.ctx.drivers = replace(bench.ctx.drivers, clouds={})
    assert bench.run(back_off(BackOffGoal(distance=0.6), bench.ctx)).backed_m == pytest.approx(0.6, abs=0.01)


def test_preempted_recovery_stops_the_base(bench):
    run = turn(TurnGoal(angle=2.0), bench.ctx)
    for _ in range(50):
        next(run)
    assert bench.sent[-1][1] > 0.0
    run.close()
    assert bench.stops == 1 and bench.ctx.base.owner is None


def test_without_a_pose_nothing_moves(bench):
    bench.ctx.world.odometry = None
    with pytest.raises(ActionFailed) as failed:
        bench.run(back_off(BackOffGoal(), bench.ctx))
    assert failed.value.reason is Reason.NOT_LOCALIZED and bench.sent == []


def on_fence(bench: Bench, fence: Array) -> bool:
    front, left = DESCRIPTION.base.footprint.max(axis=0)
    return polygons_touch(Footprint(front=front, rear=front, half_width=left).corners(bench.pose), fence)


@pytest.mark.parametrize(
    "pose", [(-3.0, -2.0, 0.0), (-3.0, -2.0, np.pi), (-2.87, -2.0, 0.5 * np.pi), (-3.0, -2.0, 0.3)]
)
def test_robot_that_was_pushed_over_a_fence_leaves_it_and_comes_no_deeper(pose):
    fence = np.array([[-2.55, -9.0], [-2.45, -9.0], [-2.45, 9.0], [-2.55, 9.0]])
    bench = Bench(fence)
    bench.pose = np.array(pose)
    bench.estimate()
    stood_in = [on_fence(bench, fence)]
    bench.run(leave_fence(LeaveFenceGoal(), bench.ctx), lambda now: stood_in.append(on_fence(bench, fence)))
    assert stood_in[0] and not on_fence(bench, fence)
    assert sorted(stood_in, reverse=True) == stood_in, "once out it stays out"
    assert np.hypot(*(bench.pose[:2] - pose[:2])) < 1.2 and bench.stops == 1


def test_robot_outside_of_all_fences_has_none_to_leave():
    bench = Bench(np.array([[-2.4, -9.0], [-2.3, -9.0], [-2.3, 9.0], [-2.4, 9.0]]))
    assert list(leave_fence(LeaveFenceGoal(), bench.ctx)) == [] and bench.sent == []


def test_robot_deep_in_a_fence_says_so_and_stands():
    bench = Bench(np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]]))
    with pytest.raises(ActionFailed) as failed:
        bench.run(leave_fence(LeaveFenceGoal(), bench.ctx))
    assert failed.value.reason is Reason.FENCE and bench.sent == []


def test_guard_lets_a_base_come_to_rest_whose_pose_has_become_uncertain_and_then_holds_it():
    bench = Bench(np.array([[5.0, 5.0], [6.0, 5.0], [6.0, 6.0]]))
    passed = []
    for k in range(250):
        bench.time_s = 0.01 * k
        bench.estimate()
        bench.ctx.world.localized = bench.time_s < 1.0
        passed.append(bench.ctx.drivers.base.send(0.4, 0.0).linear[0])
    assert passed[190] == 0.4 and passed[202:] == [0.0] * 48 and bench.told == ["pose"]
