"""Local planners: from a path and the newest pose to the next body velocity.

The one here is a regulated pure pursuit whose commands are simulated against the local costmap before they are sent,
with a last phase that settles on the goal pose.

Source: Coulter, Implementation of the pure pursuit path tracking algorithm, CMU-RI-TR-92-01, 1992; Macenski et al.,
Regulated pure pursuit for robot path tracking, Autonomous Robots, 2023.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Protocol

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import wrap_angle
from grape.messages import Array
from grape.navigation.grid import Costmap, Footprint
from grape.navigation.monitor import arc_poses
from grape.navigation.path import Path, in_frame_of


class Phase(StrEnum):
    """What the follower is doing."""

    TURN = "turning in place"
    TRACK = "following the path"
    SETTLE = "settling on the goal"
    RETREAT = "backing off for another approach"
    MAKE_ROOM = "driving to where it can turn"
    REACHED = "at the goal"
    FAILED = "cannot settle on the goal"


@dataclass(frozen=True, kw_only=True)
class FollowerState:
    """What a local planner remembers between steps; a new path starts with a new state."""

    phase: Phase = Phase.TRACK
    travelled: float = 0.0  # m along the path
    command: tuple[float, float] = (0.0, 0.0)  # m/s, rad/s as last sent
    turn_gain: float = 1.0  # measured over commanded yaw rate: skidding turns less than the wheels say
    blocked_s: float = 0.0
    retreats: int = 0
    turn_to: float | None = None  # rad in map, chosen when a turn begins: turning shifts the robot, not its goal
    straight_to: tuple[float, float, float] | None = None  # x y yaw in map, where there is room for the turn wanted
    steps: int = 0  # since the path was new; picks the random numbers of planners that sample
    memory: Array | None = field(default=None, compare=False)  # what the planner thought last: controls, or a band


@dataclass(frozen=True, kw_only=True)
class FollowerStep:
    """The command to send now, and the state for the next step."""

    v: float  # m/s
    w: float  # rad/s
    state: FollowerState
    remaining: float  # m along the path
    blocked: bool = False  # an obstacle or fence forbids to move on


class LocalPlanner(Protocol):
    """Anything that drives along a path: pure pursuit here, sampling planners by plugin."""

    def step(
        self, state: FollowerState, path: Path, pose: Array, twist: Array, costmap: Costmap, dt: float
    ) -> FollowerStep:
        """The next command.

        Args:
            state: of the step before.
            path: the way to the goal, in map.
            pose: (3,) x y yaw of base_link in map.
            twist: (2,) measured v (m/s) and w (rad/s).
            costmap: local costmap in map.
            dt: s since the step before.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class PursuitOptions:
    """Limits, gains and tolerances of the pure pursuit; metres, seconds, radians."""

    speed: float = 0.8
    turn_speed: float = 0.8
    curve_speed: float = 0.5  # where the path bends
    bend: float = 0.3  # rad per metre ahead from which it counts as bending
    reverse_speed: float = 0.3
    creep_speed: float = 0.05
    acceleration: float = 0.7
    deceleration: float = 0.5
    turn_acceleration: float = 1.6
    lookahead: float = 0.45  # least
    lookahead_s: float = 0.7  # plus this times the speed
    turn_in_place: float = 0.7  # heading error from which it turns on the spot
    along: float = 0.02  # tolerances at the goal
    across: float = 0.03
    yaw: float = 0.02
    approach: float = 0.9  # before the goal, from where on it converges to the goal's line
    approach_speed: float = 0.4
    converge: float = 0.3  # distance in which it does, to 1/e critically damped
    retreat: float = 0.9  # how far back to go for another approach, the second time half as far again
    retreats: int = 2
    across_at_last: float = 0.08  # tolerance after the last of them: better a little aside than not at all
    footprint: Footprint = field(default_factory=Footprint)
    horizon_s: float = 1.2  # of the simulated motion, at least until standstill


class PurePursuit:
    """Regulated pure pursuit with forward simulation; stateless, see `LocalPlanner`."""

    def __init__(self, options: PursuitOptions | None = None) -> None:
        self.options = options or PursuitOptions()

    def step(
        self, state: FollowerState, path: Path, pose: Array, twist: Array, costmap: Costmap, dt: float
    ) -> FollowerStep:
        """See `LocalPlanner.step`."""
        pose, twist = np.asarray(pose, dtype=float), np.asarray(twist, dtype=float)
        if not (np.isfinite(pose).all() and np.isfinite(twist).all() and dt > 0):
            raise InvalidInput(f"pose, twist must be finite and dt > 0, got {pose}, {twist}, {dt}")
        state = replace(state, turn_gain=turn_gain(state, twist, dt))
        if state.phase is Phase.TRACK:
            travelled = path.project(pose[:2], state.travelled, window=1.0)
            state = replace(state, travelled=travelled)
        wish = {
            Phase.TURN: self._turn,
            Phase.TRACK: self._track,
            Phase.SETTLE: self._settle,
            Phase.RETREAT: self._retreat,
        }.get(state.phase, self._stand)
        v, w, state = wish(state, path, pose, twist)
        return self._limited(v, w, state, path, pose, costmap, dt)

    def _turn(self, state: FollowerState, path: Path, pose: Array, twist: Array) -> tuple[float, float, FollowerState]:
        turn_to = state.turn_to
        if turn_to is None:
            turn_to = float(pose[2]) + self._heading_error(state, path, pose)
            state = replace(state, turn_to=turn_to)
        error = float(wrap_angle(turn_to - float(pose[2])))
        if abs(error) < 0.06 and abs(twist[1]) < 0.15:
            return 0.0, 0.0, replace(state, phase=Phase.TRACK, turn_to=None)
        if abs(twist[0]) > 0.05:
            return 0.0, 0.0, state
        return 0.0, self._turn_rate(error), state

    def _track(self, state: FollowerState, path: Path, pose: Array, twist: Array) -> tuple[float, float, FollowerState]:
        options = self.options
        remaining = self._remaining(state, path, pose)
        if remaining < 0.6 * options.along:
            return 0.0, 0.0, replace(state, phase=Phase.SETTLE)
        error = self._heading_error(state, path, pose)
        if abs(error) > options.turn_in_place and remaining > 0.1:
            return 0.0, 0.0, replace(state, phase=Phase.TURN, turn_to=None)
        limit = options.reverse_speed if path.reverse else options.speed
        speed = min(limit, self._stopping_speed(remaining), self._curve_limit(path, state.travelled))
        direction = -1.0 if path.reverse else 1.0
        if remaining < options.approach and self._near_line(pose, path.goal):
            return *self._converge(pose, path.goal, min(speed, options.approach_speed), direction), state
        target = path.at(state.travelled + self._lookahead(abs(twist[0])))
        return *self._pursue(pose, target, speed, direction), state

    def _settle(
        self, state: FollowerState, path: Path, pose: Array, twist: Array
    ) -> tuple[float, float, FollowerState]:
        """Stop, look, and correct: heading first, then along the line, and back off when it is too far aside."""
        options = self.options
        along, across, yaw = in_frame_of(pose, path.goal)
        if abs(state.command[0]) > 1e-6:
            return self._settle_along(state, path, pose)
        if abs(state.command[1]) > 1e-6:
            return 0.0, self._settle_turn(yaw, 0.3 * options.yaw), state
        if abs(twist[0]) > 0.01 or abs(twist[1]) > 0.02:
            return 0.0, 0.0, state
        if abs(across) > options.across and state.retreats < options.retreats:
            return 0.0, 0.0, replace(state, phase=Phase.RETREAT, retreats=state.retreats + 1)
        if abs(across) > max(options.across, options.across_at_last):
            return 0.0, 0.0, replace(state, phase=Phase.FAILED)
        if abs(yaw) > options.yaw:
            return 0.0, self._settle_turn(yaw, 0.0), state
        if abs(along) > options.along:
            return self._settle_along(state, path, pose)
        return 0.0, 0.0, replace(state, phase=Phase.REACHED)

    def _settle_turn(self, yaw: float, enough: float) -> float:
        return 0.0 if abs(yaw) <= enough else float(np.clip(-2.0 * yaw, -0.3, 0.3) - 0.03 * np.sign(yaw))

    def _settle_along(self, state: FollowerState, path: Path, pose: Array) -> tuple[float, float, FollowerState]:
        along, _, _ = in_frame_of(pose, path.goal)
        if abs(along) < 0.5 * self.options.along:
            return 0.0, 0.0, state
        direction = -float(np.sign(along))
        speed = min(0.15, self._stopping_speed(abs(along)))
        return *self._converge(pose, path.goal, speed, direction), state

    def _retreat(
        self, state: FollowerState, path: Path, pose: Array, twist: Array
    ) -> tuple[float, float, FollowerState]:
        """Back along the goal's line, so that the next approach has room to converge."""
        options = self.options
        along, _, _ = in_frame_of(pose, path.goal)
        back = options.retreat * (0.5 + 0.5 * state.retreats)
        if along < -back:
            if abs(twist[0]) > 0.05:
                return 0.0, 0.0, state
            return 0.0, 0.0, replace(state, phase=Phase.TRACK, travelled=max(0.0, path.length - options.retreat))
        speed = min(options.reverse_speed, self._stopping_speed(back + along + 0.05))
        return *self._converge(pose, path.goal, speed, -1.0), state

    def _stand(self, state: FollowerState, path: Path, pose: Array, twist: Array) -> tuple[float, float, FollowerState]:
        return 0.0, 0.0, state

    def _near_line(self, pose: Array, goal: Array) -> bool:
        """Whether the robot is so near to the goal's line, and along it, that it may converge to it."""
        _, across, yaw = in_frame_of(pose, goal)
        return bool(abs(across) < 0.25 and abs(yaw) < 0.6)

    def _converge(self, pose: Array, goal: Array, speed: float, direction: float) -> tuple[float, float]:
        """Velocity that leads onto the goal's line and its heading, forwards or backwards (direction -1).

        Unlike a pursuit it has no target that it comes too near to: heading and offset vanish together, whatever
        skidding adds on the way.
        """
        _, across, yaw = in_frame_of(pose, goal)
        length = self.options.converge
        wanted = -direction * float(np.clip(across / (2.0 * length), -0.5, 0.5))
        curvature = 2.0 * (wanted - yaw) / length
        speed = min(speed, self.options.turn_speed / max(abs(curvature), 1e-6))
        return direction * speed, speed * curvature

    def _pursue(self, pose: Array, target: Array, speed: float, direction: float) -> tuple[float, float]:
        """Velocity on the circle through `target`, forwards or backwards (direction -1)."""
        heading = pose[2] if direction > 0 else pose[2] + np.pi
        dx, dy = target[0] - pose[0], target[1] - pose[1]
        lateral = -np.sin(heading) * dx + np.cos(heading) * dy
        curvature = 2.0 * lateral / max(dx * dx + dy * dy, 0.04)
        speed = min(speed, self.options.turn_speed / max(abs(curvature), 1e-6))
        return direction * speed, speed * curvature

    def _heading_error(self, state: FollowerState, path: Path, pose: Array) -> float:
        """How far to turn (rad) to face the path a little ahead.

        The place that is faced is a full lookahead away from the robot, wherever turning has shifted it: the bearing of
        a near one would run away from the turn.
        """
        reach = self.options.lookahead
        ahead = state.travelled + reach
        target = path.at(ahead)
        while np.hypot(*(target[:2] - pose[:2])) < reach and ahead < path.length:
            ahead = min(ahead + 0.1, path.length)
            target = path.at(ahead)
        offset = target[:2] - pose[:2]
        if np.hypot(*offset) < 0.5 * reach:
            return float(wrap_angle(float(target[2] - pose[2])))
        if path.reverse:
            offset = -offset
        return float(wrap_angle(float(np.arctan2(offset[1], offset[0]) - pose[2])))

    def _turn_rate(self, error: float) -> float:
        options = self.options
        rate = np.sqrt(2.0 * 0.6 * options.turn_acceleration * abs(error))
        return float(np.sign(error) * np.clip(min(rate, 2.5 * abs(error)), 0.12, options.turn_speed))

    def _remaining(self, state: FollowerState, path: Path, pose: Array) -> float:
        """Metres to go; near the goal measured along its heading, so that passing it counts."""
        remaining = path.length - state.travelled
        if remaining > 0.6:
            return remaining
        along, _, _ = in_frame_of(pose, path.goal)
        return float(along if path.reverse else -along)

    def _stopping_speed(self, distance: float) -> float:
        """The speed from which the robot stops within `distance` m, never below creeping."""
        options = self.options
        return max(options.creep_speed, float(np.sqrt(2.0 * options.deceleration * max(distance - 0.03, 0.0))))

    def _curve_limit(self, path: Path, travelled: float) -> float:
        """Skidding wheels slip in bends: slow before and in them."""
        yaws = path.ahead(travelled, travelled + 1.0)[:, 2]
        bend = float(np.abs(wrap_angle(yaws - yaws[0])).max()) if len(yaws) else 0.0
        return self.options.curve_speed if bend > self.options.bend else np.inf

    def _lookahead(self, speed: float) -> float:
        return self.options.lookahead + self.options.lookahead_s * speed

    def _limited(
        self, v: float, w: float, state: FollowerState, path: Path, pose: Array, costmap: Costmap, dt: float
    ) -> FollowerStep:
        """The wish within accelerations, slowed until the simulated motion is free, corrected for skidding."""
        options = self.options
        wanted = abs(v) > 1e-6 or abs(w) > 1e-6
        factor = self._free_factor(v, w, pose, costmap) if wanted else 1.0
        v, w = factor * v, factor * w
        v0, w0 = state.command[0], state.command[1] * state.turn_gain
        braking = abs(v) < abs(v0) or v * v0 < 0
        change = (2.0 * options.deceleration if braking else options.acceleration) * dt
        v = float(np.clip(v, v0 - change, v0 + change))
        w = float(np.clip(w, w0 - options.turn_acceleration * dt, w0 + options.turn_acceleration * dt))
        blocked = wanted and factor == 0.0
        command = (v, w / state.turn_gain)
        state = replace(state, command=command, blocked_s=state.blocked_s + dt if blocked else 0.0)
        remaining = max(0.0, path.length - state.travelled)
        return FollowerStep(v=command[0], w=command[1], state=state, remaining=remaining, blocked=blocked)

    def _free_factor(self, v: float, w: float, pose: Array, costmap: Costmap) -> float:
        """The largest of 1, 1/2, 1/4 by which the motion can go on without touching anything; 0 when none can."""
        footprint = self._kept_free(pose, costmap)
        for factor in (1.0, 0.5, 0.25):
            if not self._touches(factor * v, factor * w, pose, costmap, footprint):
                return factor
        return 0.0

    def _kept_free(self, pose: Array, costmap: Costmap) -> Footprint:
        """What must not come into contact while the robot moves on from `pose`."""
        return self.options.footprint

    def _touches(self, v: float, w: float, pose: Array, costmap: Costmap, footprint: Footprint) -> bool:
        options = self.options
        horizon = max(options.horizon_s if abs(v) > 0.2 else 0.5, abs(v) / options.deceleration)
        moves = arc_poses(v, w, np.linspace(0.0, horizon, 1 + max(3, int(horizon / 0.15))))
        c, s = np.cos(pose[2]), np.sin(pose[2])
        poses = np.column_stack(
            [
                pose[0] + c * moves[:, 0] - s * moves[:, 1],
                pose[1] + s * moves[:, 0] + c * moves[:, 1],
                pose[2] + moves[:, 2],
            ]
        )
        return bool(costmap.blocked(poses, footprint).any())


def turn_gain(state: FollowerState, twist: Array, dt: float) -> float:
    """The running estimate of measured over commanded yaw rate, learnt while the robot turns."""
    commanded = state.command[1]
    if abs(commanded) < 0.2:
        return state.turn_gain
    ratio = float(np.clip(twist[1] / commanded, 0.3, 1.6))
    return state.turn_gain + min(1.0, 0.8 * dt) * (ratio - state.turn_gain)
