"""A vineyard of posts and trunks and a skid-steer base in it, kinematic and seeded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from grape.geometry import pose as make_pose
from grape.geometry import rotation_z
from grape.messages import Array, LaserScan
from grape.navigation.beams import beams_from_scan, scan_points
from grape.navigation.costmap import ObstacleLayer, PolygonLayer, layered_costmap
from grape.navigation.follower import FollowerState, Phase, PurePursuit, PursuitOptions
from grape.navigation.grid import Footprint, GridSpec
from grape.navigation.monitor import speed_factor
from grape.navigation.planner import PlannerOptions, path_blocked, plan_route
from grape.navigation.route import row_zones, waypoints

T_BASE_LASER = make_pose(translation=(0.45, 0.0, 0.20))


@dataclass(frozen=True)
class Line:
    """A row."""

    id: str
    line: Array


@dataclass
class Vineyard:
    """Rows along x and the circles (n, 3) x y radius that stand in them."""

    rows: tuple[Line, ...]
    circles: Array
    plants: Array  # (rows, vines, 2)

    @staticmethod
    def seeded(seed: int, rows: int = 3, vines: int = 8) -> Vineyard:
        rng = np.random.default_rng(seed)
        x = 1.15 * np.arange(vines)
        plants = np.stack([np.column_stack([x, np.full(vines, 2.6 * r)]) for r in range(rows)])
        trunks = plants.reshape(-1, 2) + rng.normal(0, 0.04, (rows * vines, 2))
        radii = rng.uniform(0.03, 0.06, len(trunks))
        posts = np.array([[px, 2.6 * r] for r in range(rows) for px in (-0.6, 4.0, 8.6)])
        canes = plants.reshape(-1, 2) + rng.uniform(-0.3, 0.3, (rows * vines, 2)) * [1, 0.9]
        circles = np.vstack(
            [
                np.column_stack([trunks, radii]),
                np.column_stack([posts, np.full(len(posts), 0.05)]),
                np.column_stack([canes, np.full(len(canes), 0.01)]),
            ]
        )
        lines = tuple(Line(f"r{r}", np.array([[0.0, 2.6 * r], [x[-1], 2.6 * r]])) for r in range(rows))
        return Vineyard(lines, circles, plants)


def scan_of(circles: Array, pose: Array, rng: np.random.Generator, sigma: float = 0.015) -> LaserScan:
    """What a 270 degree scanner on the robot at `pose` (3,) sees of circles (n, 3)."""
    angles = np.radians(np.arange(-135.0, 135.01, 0.75))
    T = make_pose(rotation_z(pose[2]), (pose[0], pose[1], 0.0)) @ T_BASE_LASER
    d = np.column_stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])])
    offset = circles[:, :2] - T[:2, 3]
    along = d @ offset.T
    gap2 = (offset**2).sum(axis=1) - along**2
    inside = circles[:, 2] ** 2 - gap2
    r = np.where((inside > 0) & (along > 0), along - np.sqrt(np.maximum(inside, 0)), np.inf).min(axis=1)
    r = r + rng.normal(0, sigma, len(r))
    return LaserScan(
        stamp=0.0,
        angle_min=float(angles[0]),
        angle_increment=float(np.radians(0.75)),
        range_min=0.1,
        range_max=30.0,
        ranges=np.where(r > 30, np.inf, r),
    )


@dataclass
class Robot:
    """True state, slip, pose error and everything that was noted on the way."""

    pose: Array
    rng: np.random.Generator
    turn_ratio: float = 0.75
    v: float = 0.0
    w: float = 0.0
    time_s: float = 0.0
    pose_sigma: float = 0.01
    error: Array = field(default_factory=lambda: np.zeros(3))
    slip: Array = field(default_factory=lambda: np.zeros(2))
    track: list[Array] = field(default_factory=list)
    commands: list[tuple[float, float]] = field(default_factory=list)

    def drive(self, v: float, w: float, dt: float) -> None:
        """Follow a command with lag, slip and a turn ratio that the controller does not know."""
        self.commands.append((v, w))
        n = 5
        for _ in range(n):
            h = dt / n
            self.slip = 0.99 * self.slip + self.rng.normal(0, 0.005, 2)
            self.v += np.clip(v - self.v, -1.0 * h, 1.0 * h)
            self.w += np.clip(w * self.turn_ratio - self.w, -2.0 * h, 2.0 * h)
            speed, rate = self.v * (1 + self.slip[0]), self.w * (1 + self.slip[1]) + 0.3 * self.slip[1] * self.v
            yaw = self.pose[2]
            self.pose = self.pose + h * np.array([speed * np.cos(yaw), speed * np.sin(yaw), rate])
        self.error = 0.95 * self.error + np.sqrt(1 - 0.95**2) * self.rng.normal(0, [1, 1, 0.4]) * self.pose_sigma
        self.time_s += dt
        self.track.append(self.pose.copy())

    def estimate(self) -> Array:
        return self.pose + self.error


def go(
    yard: Vineyard,
    robot: Robot,
    goal: Array,
    *,
    extra: tuple[Array, ...] = (),
    limit_s: float = 90.0,
    options: PursuitOptions | None = None,
) -> Phase:
    """Plan with waypoints, drive with costmap and monitor, replan when the path is blocked; returns the last phase."""
    dt, follower = 0.05, PurePursuit(options)
    zones = PolygonLayer([*row_zones(yard.rows), *extra])
    spec = GridSpec.around(np.vstack([line.line for line in yard.rows]), 4.0)
    obstacles = ObstacleLayer(GridSpec.window(robot.pose, 10.0))
    global_map = layered_costmap(spec, [zones])
    path = plan_route(global_map, robot.estimate(), waypoints(yard.rows, robot.estimate(), goal), PlannerOptions())
    state, end_s, replan_s, beat = FollowerState(), robot.time_s + limit_s, 0.0, 0
    while robot.time_s < end_s:
        estimate = robot.estimate()
        if beat % 2 == 0:
            scan = scan_of(yard.circles, robot.pose, robot.rng)
            T_map_base = make_pose(rotation_z(estimate[2]), (estimate[0], estimate[1], 0.0))
            obstacles.move_to(estimate[:2])
            obstacles.integrate(beams_from_scan(scan, T_map_base, T_BASE_LASER))
            local = layered_costmap(obstacles.spec, [obstacles, zones])
            points = scan_points(scan, T_BASE_LASER)[:, :2]
        step = follower.step(state, path, estimate, np.array([robot.v, robot.w]), local, dt)
        state = step.state
        if state.phase in (Phase.REACHED, Phase.FAILED):
            break
        factor = speed_factor(step.v, step.w, points)
        if factor == 0.0:
            state = replace(state, command=(0.0, 0.0))
        in_way = path_blocked(local, path, state.travelled + 0.3, state.travelled + 4.0, Footprint())
        if in_way and robot.time_s > replan_s:
            replan_s = robot.time_s + 2.0
            world = layered_costmap(spec, [zones, obstacles])
            path = plan_route(world, estimate, waypoints(yard.rows, estimate, goal), PlannerOptions())
            state = FollowerState(command=state.command, turn_gain=state.turn_gain)
        robot.drive(factor * step.v, factor * step.w, dt)
        beat += 1
    return state.phase


@pytest.fixture
def vineyard() -> Callable[..., Vineyard]:
    return Vineyard.seeded


@pytest.fixture
def robot() -> Callable[..., Robot]:
    return Robot


@pytest.fixture
def drive_to() -> Callable[..., Phase]:
    return go


@pytest.fixture
def scan() -> Callable[..., LaserScan]:
    return scan_of


@pytest.fixture
def footprint() -> Footprint:
    return Footprint()
