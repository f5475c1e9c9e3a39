"""What DWA, TEB and MPPI have in common: they follow the path, the rest is that of the pure pursuit.

Turning towards the path, settling on the goal and backing off for another approach need no search, so they are one and
the same for all (Nav2 has a rotation shim and a goal checker for it). A `TrackingPlanner` searches in between.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import wrap_angle
from grape.messages import Array
from grape.navigation.follower import FollowerState, FollowerStep, Phase, PurePursuit, PursuitOptions, turn_gain
from grape.navigation.grid import Costmap, Footprint
from grape.navigation.path import Path, in_frame_of

_PATIENCE_S = 1.0  # with something behind that forbids to back off
_ASTRAY_M = 0.1  # from here on the way back to the path is driven as slowly as a bend


@dataclass(frozen=True, kw_only=True)
class Situation:
    """What a search starts from. On a path that is driven backwards it is turned round, so that v > 0 goes along it."""

    pose: Array  # (3,) x y yaw in map
    velocity: Array  # (2,) m/s, rad/s, as last commanded and answered
    ahead: Array  # (n >= 2, 5) x, y, heading of travel (rad), m along from the first one, wanted speed (m/s)
    field: Array  # (rows, columns) float32 m to the nearest lethal cell
    frame: Array  # (3,) x_min, y_min, resolution of the field
    discs: Array  # (k + 1,) m, centres of the discs that cover the footprint, then their radius
    dt: float  # s until the next command


@dataclass(frozen=True, kw_only=True)
class Wish:
    """A command, and what to remember for the next search."""

    v: float  # m/s along the path
    w: float  # rad/s
    memory: Array | None = None
    blocked: bool = False


class TrackingPlanner(PurePursuit):
    """A local planner whose way along the path is found by `search`; see `LocalPlanner` for its use.

    Args:
        options: limits of the base, and how it turns and settles.
        reach: m of path that a search sees.
        hand_over: m before the goal where settling begins.
        margin: m that the footprint is kept from lethal cells, for errors of the pose; where it is nearer already, the
            footprint itself is.
    """

    def __init__(
        self,
        options: PursuitOptions | None = None,
        *,
        reach: float = 3.0,
        hand_over: float = 0.35,
        margin: float = 0.03,
    ) -> None:
        super().__init__(options)
        self._reach, self._hand_over, self._margin = reach, hand_over, margin

    @abstractmethod
    def search(self, situation: Situation, memory: Array | None, steps: int) -> Wish:
        """The best command now.

        Args:
            situation: where the base is, what it may touch and where it should go.
            memory: of the last search on this path, None at first.
            steps: how many there were; picks the random numbers.
        """

    def step(
        self, state: FollowerState, path: Path, pose: Array, twist: Array, costmap: Costmap, dt: float
    ) -> FollowerStep:
        """See `LocalPlanner.step`."""
        pose, twist = np.asarray(pose, dtype=float), np.asarray(twist, dtype=float)
        if state.phase is Phase.RETREAT and state.blocked_s > _PATIENCE_S:
            state = replace(state, phase=Phase.FAILED, command=(0.0, 0.0))
        if state.phase is not Phase.TRACK or not self._searches(state, path, pose):
            return super().step(replace(state, memory=None), path, pose, twist, costmap, dt)
        if not (np.isfinite(twist).all() and dt > 0):
            raise InvalidInput(f"twist must be finite and dt > 0, got {twist}, {dt}")
        travelled = path.project(pose[:2], state.travelled, window=1.0)
        state = replace(state, turn_gain=turn_gain(state, twist, dt), travelled=travelled, steps=state.steps + 1)
        wish = self.search(self._situation(state, path, pose, costmap, dt), state.memory, state.steps)
        return self._sent(wish, state, path, pose, costmap, dt)

    def _searches(self, state: FollowerState, path: Path, pose: Array) -> bool:
        if not np.isfinite(pose).all():
            return False
        far = path.length - state.travelled > self._hand_over
        # going around something faces away from the path for a while: only a first look stops for less
        most = self.options.turn_in_place if state.steps == 0 else max(self.options.turn_in_place, 1.3)
        return far and abs(self._heading_error(state, path, pose)) <= most

    def _situation(self, state: FollowerState, path: Path, pose: Array, costmap: Costmap, dt: float) -> Situation:
        turned = np.pi if path.reverse else 0.0
        until = state.travelled + self._reach
        own = self.options.footprint
        centres, radius = own.discs()
        spec = costmap.spec
        sign = -1.0 if path.reverse else 1.0
        return Situation(
            pose=np.array([pose[0], pose[1], pose[2] + turned]),
            velocity=np.array([sign * state.command[0], state.command[1] * state.turn_gain]),
            ahead=self._ahead(path, state.travelled, until, turned, pose),
            field=costmap.distance,
            frame=np.array([spec.x_min, spec.y_min, spec.resolution]),
            discs=np.append(sign * centres, radius + self._margin),
            dt=dt,
        )

    def _ahead(self, path: Path, since: float, until: float, turned: float, pose: Array) -> Array:
        """The piece of path ahead, at most to the goal, with the speeds that goal, bends and being astray allow."""
        options = self.options
        since = min(since, path.length - 0.05)  # a leap of the estimate may have led to the goal: two poses at least
        along = np.arange(since, min(until, path.length) + 0.025, 0.05)
        k = np.clip(np.searchsorted(path.distance, along, side="right") - 1, 0, len(path.poses) - 2)
        share = (along - path.distance[k]) / (path.distance[k + 1] - path.distance[k])
        poses = path.poses[k] + share[:, None] * (path.poses[k + 1] - path.poses[k])
        poses[:, 2] = wrap_angle(path.poses[k, 2] + turned)
        stopping = np.sqrt(2.0 * options.deceleration * np.maximum(path.length - along - 0.03, 0.0))
        speed = np.minimum(options.reverse_speed if path.reverse else options.speed, stopping)
        speed = np.minimum(speed, _bend_limit(poses[:, 2], options))
        _, across, yaw = in_frame_of(pose, np.array([*poses[0, :2], path.at(since)[2]]))
        if abs(across) > _ASTRAY_M or abs(yaw) > options.bend:
            speed = np.minimum(speed, options.curve_speed)
        return np.ascontiguousarray(np.column_stack([poses, along - since, np.maximum(speed, options.creep_speed)]))

    def _sent(
        self, wish: Wish, state: FollowerState, path: Path, pose: Array, costmap: Costmap, dt: float
    ) -> FollowerStep:
        """The wish within accelerations, slowed until the robot can stop before it touches anything."""
        options = self.options
        sign = -1.0 if path.reverse else 1.0
        v = float(np.clip(sign * wish.v, -options.reverse_speed, options.speed))
        w = float(np.clip(wish.w, -options.turn_speed, options.turn_speed))
        v0, w0 = state.command[0], state.command[1] * state.turn_gain
        brake = 2.0 * options.deceleration * dt
        blocked = wish.blocked
        change = brake if abs(v) < abs(v0) or v * v0 < 0 else options.acceleration * dt
        turn = options.turn_acceleration * dt
        v, w = float(np.clip(v, v0 - change, v0 + change)), float(np.clip(w, w0 - turn, w0 + turn))
        if self._stops_too_late(v, w, pose, costmap, dt):
            blocked = True
            v = float(np.clip(0.0, v0 - brake, v0 + brake))
            # along the arc that was free so far: who stops turning away meanwhile drives on towards what is beside
            w = w0 * v / v0 if abs(v0) > 0.02 else float(np.clip(0.0, w0 - turn, w0 + turn))
        command = (v, w / state.turn_gain)
        state = replace(state, command=command, memory=wish.memory, blocked_s=state.blocked_s + dt if blocked else 0.0)
        return FollowerStep(
            v=v, w=command[1], state=state, remaining=max(0.0, path.length - state.travelled), blocked=blocked
        )

    def _stops_too_late(self, v: float, w: float, pose: Array, costmap: Costmap, dt: float) -> bool:
        """Whether braking after two more periods touches something that is not touched now."""
        options = self.options
        times = np.linspace(0.0, 1.0, 6)
        distance = v * (2.0 * dt + 0.5 * abs(v) / (2.0 * options.deceleration)) * times
        yaw = w * (2.0 * dt + 0.5 * abs(v) / (2.0 * options.deceleration)) * times
        heading = pose[2] + 0.5 * yaw
        poses = np.column_stack(
            [pose[0] + distance * np.cos(heading), pose[1] + distance * np.sin(heading), pose[2] + yaw]
        )
        touched = costmap.blocked(poses, self._kept_free(pose, costmap))
        return bool(touched.any() and not touched[0])

    def _kept_free(self, pose: Array, costmap: Costmap) -> Footprint:
        grown = self.options.footprint.grown(self._margin)
        return self.options.footprint if costmap.blocked(pose, grown)[0] else grown


def _bend_limit(yaws: Array, options: PursuitOptions) -> Array:
    """(n,) m/s, the curve speed where the path turns by more than the bend within the next metre."""
    reach = min(20, len(yaws) - 1)
    turned = np.abs(wrap_angle(yaws[np.minimum(np.arange(len(yaws)) + reach, len(yaws) - 1)] - yaws))
    return np.where(turned > options.bend, options.curve_speed, np.inf)
