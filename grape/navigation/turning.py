"""Room to turn on the spot: where it is, and a wrapper that drives any local planner there first.

A skid-steer base that turns on rough ground drifts sideways, by up to 18 cm while it turns by 40 degrees, and its
wheels do not tell. So a turn begins only where robot and drift together are free of lethal cells.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import wrap_angle
from grape.messages import Array
from grape.navigation.follower import FollowerState, FollowerStep, LocalPlanner, Phase
from grape.navigation.grid import LETHAL, Costmap, Footprint
from grape.navigation.path import Path, in_frame_of

_SPOT_RATE = 0.25  # rad/s


@dataclass(frozen=True, kw_only=True)
class TurnRoomOptions:
    """How much room a turn needs and how the robot gets there; metres, seconds, radians.

    Args:
        drift: m per rad that the base may drift while it turns, at most `most_drift`.
        small: turns up to this need the area that the footprint sweeps, larger ones the whole disc around it.
        least: m beside that disc within which a turn that has drifted so far is broken off.
        reach: how far forwards or back a place with room is looked for, every `spacing`.
        backwards: how much dearer a metre back is than one forwards.
        speed: m/s, acceleration: m/s² on the way there.
    """

    footprint: Footprint = field(default_factory=Footprint)
    drift: float = 0.18 / np.radians(40.0)
    most_drift: float = 0.25
    small: float = 0.15
    least: float = 0.08
    reach: float = 6.0
    spacing: float = 0.05
    backwards: float = 1.3
    speed: float = 0.3
    acceleration: float = 0.5

    def __post_init__(self) -> None:
        if min(self.drift, self.most_drift, self.small, self.least, self.reach) < 0 or not self.spacing > 0:
            raise InvalidInput(f"only spacing must be positive, and the others not negative, got {self}")


def may_turn(costmap: Costmap, pose: Array, angle: float, options: TurnRoomOptions | None = None) -> bool:
    """Whether the base at `pose` (3,) x y yaw may turn on the spot by `angle` (rad, left positive).

    A part of the footprint that is on a lethal cell already forbids every turn but one by 0.

    Raises:
        InvalidInput: pose or angle is not finite.
    """
    options = options or TurnRoomOptions()
    pose = np.asarray(pose, dtype=float)
    if not (np.isfinite(pose).all() and np.isfinite(angle)):
        raise InvalidInput(f"pose and angle must be finite, got {pose}, {angle}")
    if angle == 0.0:
        return True
    drift = min(options.drift * abs(angle), options.most_drift)
    if abs(angle) > options.small:
        return _disc_is_free(costmap, pose[:2], options.footprint.circumscribed + drift)
    yaws = pose[2] + angle * np.linspace(0.0, 1.0, 2 + int(abs(angle) / 0.05))
    swept = np.column_stack([np.full_like(yaws, pose[0]), np.full_like(yaws, pose[1]), yaws])
    return not costmap.blocked(swept, options.footprint.grown(drift)).any()


def room_to_turn(
    costmap: Costmap, pose: Array, angle: float, options: TurnRoomOptions | None = None, *, way: Costmap | None = None
) -> float | None:
    """How far (m, backwards negative) to drive straight until there is room for a turn; 0 here, None nowhere.

    Args:
        costmap: fences and obstacles that must not be touched.
        pose: (3,) x y yaw of base_link in map.
        angle: rad, the turn that is wanted.
        way: what must not be touched on the way there; `costmap` alone when None.

    Raises:
        InvalidInput: pose or angle is not finite.
    """
    options = options or TurnRoomOptions()
    pose = np.asarray(pose, dtype=float)
    if may_turn(costmap, pose, angle, options):
        return 0.0
    # there a little more room, so that stopping a few cm short of it is enough
    roomy = replace(options, drift=options.drift + 0.05 / abs(angle), most_drift=options.most_drift + 0.05)
    found: list[tuple[float, float]] = []
    heading = np.array([np.cos(pose[2]), np.sin(pose[2]), 0.0])
    steps = options.spacing * np.arange(1, 1 + int(options.reach / options.spacing))
    for sign, dearness in ((1.0, 1.0), (-1.0, options.backwards)):
        poses = pose + sign * steps[:, None] * heading
        touched = costmap.blocked(poses, options.footprint)
        if way is not None:
            touched |= way.blocked(poses, options.footprint)
        free = steps[: int(np.argmax(touched))] if touched.any() else steps
        for step in free:
            if found and dearness * step >= found[0][0]:
                break
            if may_turn(costmap, pose + sign * step * heading, angle, roomy):
                found = [(dearness * float(step), sign * float(step))]
                break
    return found[0][1] if found else None


def _disc_is_free(costmap: Costmap, centre: Array, radius: float) -> bool:
    """Whether no lethal cell has its centre within `radius` m of `centre` (2,)."""
    spec = costmap.spec
    low, high = spec.cells(np.array([centre - radius, centre + radius]))
    (i0, j0), (i1, j1) = np.maximum(low, 0), np.minimum(high + 1, [spec.rows, spec.columns])
    if i0 >= i1 or j0 >= j1:
        return True
    rows, columns = np.nonzero(costmap.cost[i0:i1, j0:j1] == LETHAL)
    points = spec.centres(np.column_stack([rows + i0, columns + j0]))
    return not (np.hypot(*(points - centre).T) <= radius).any()


class RoomToTurn:
    """Any local planner, but where it would turn without room, the base drives straight to where there is.

    A turn is broken off when the base drifts out of its room, as on a slope that it slides down while it skids round.

    Args:
        planner: whose turns are guarded: those of its phase TURN, and commands that turn on the spot.
        fences: costmap of what a drifting base must not touch, in map; the local costmap when None.
    """

    def __init__(
        self, planner: LocalPlanner, options: TurnRoomOptions | None = None, fences: Costmap | None = None
    ) -> None:
        self.planner, self.options, self.fences = planner, options or TurnRoomOptions(), fences

    def step(
        self, state: FollowerState, path: Path, pose: Array, twist: Array, costmap: Costmap, dt: float
    ) -> FollowerStep:
        """See `LocalPlanner.step`; `blocked` where there is no room within reach of where a turn would begin."""
        if state.phase is Phase.MAKE_ROOM:
            return self._straight(state, path, np.asarray(pose, dtype=float), costmap, dt)
        step = self.planner.step(state, path, pose, twist, costmap, dt)
        begun, left = _turn_begun(state, step, pose), self._left_without_room(state, step, pose, costmap)
        if begun == left == 0.0:
            return step
        away = room_to_turn(self.fences or costmap, pose, begun or left, self.options, way=costmap)
        if away == 0.0 or (away is None and left):
            return step
        stopped = replace(step.state, phase=Phase.TRACK, command=(0.0, 0.0), turn_to=None)
        if away is None:
            stopped = replace(stopped, blocked_s=state.blocked_s + dt)
            return replace(step, v=0.0, w=0.0, state=stopped, blocked=True)
        target = (pose[0] + away * np.cos(pose[2]), pose[1] + away * np.sin(pose[2]), float(pose[2]))
        return replace(step, v=0.0, w=0.0, state=replace(stopped, phase=Phase.MAKE_ROOM, straight_to=target))

    def _left_without_room(self, state: FollowerState, step: FollowerStep, pose: Array, costmap: Costmap) -> float:
        """rad that are left of a turn whose room the base has drifted out of; 0 when it turns in its room or not."""
        options = self.options
        if state.turn_to is None or step.state.turn_to is None:
            return 0.0
        left = float(wrap_angle(step.state.turn_to - pose[2]))
        radius = options.footprint.circumscribed + options.least
        if abs(left) <= options.small or _disc_is_free(self.fences or costmap, np.asarray(pose)[:2], radius):
            return 0.0
        return left

    def _straight(self, state: FollowerState, path: Path, pose: Array, costmap: Costmap, dt: float) -> FollowerStep:
        """On the line to the place with room; heading errors are steered out, never on the spot."""
        options, target = self.options, np.array(state.straight_to)
        along, across, yaw = in_frame_of(pose, target)
        remaining = max(0.0, path.length - state.travelled)
        if abs(along) < 0.03 and abs(state.command[0]) < 0.1:
            done = replace(state, phase=Phase.TRACK, command=(0.0, 0.0), straight_to=None, blocked_s=0.0)
            return FollowerStep(v=0.0, w=0.0, state=done, remaining=remaining)
        direction = -float(np.sign(along))
        speed = min(options.speed, np.sqrt(2.0 * options.acceleration * max(abs(along) - 0.02, 0.0)) + 0.05)
        v0, change = state.command[0], options.acceleration * dt
        v = float(np.clip(direction * speed, v0 - change, v0 + change))
        w = float(np.clip(-1.5 * yaw - 2.0 * direction * across, -0.25, 0.25)) * min(1.0, abs(v) / 0.1)
        ahead = pose + direction * np.linspace(0.05, 0.25, 5)[:, None] * [np.cos(pose[2]), np.sin(pose[2]), 0.0]
        blocked = bool(costmap.blocked(ahead, options.footprint).any())
        if blocked:
            v, w = 0.0, 0.0
        phase = Phase.TRACK if blocked else Phase.MAKE_ROOM
        blocked_s = state.blocked_s + dt if blocked else 0.0
        state = replace(state, phase=phase, command=(v, w / state.turn_gain), blocked_s=blocked_s, memory=None)
        return FollowerStep(v=v, w=w / state.turn_gain, state=state, remaining=remaining, blocked=blocked)


def _turn_begun(state: FollowerState, step: FollowerStep, pose: Array) -> float:
    """rad that the planner begins to turn on the spot with this step; 0 when it does not begin to.

    Outside of its phase TURN a planner turns on the spot when it stands and its yaw rate passes 0.25 rad/s: one that
    starts to move steers a little while it is still slow.
    """
    if step.state.phase is Phase.TURN:
        if step.state.turn_to is None or state.turn_to is not None:
            return 0.0
        return float(wrap_angle(step.state.turn_to - pose[2]))
    on_spot = abs(step.v) < 0.02 and abs(step.w) > _SPOT_RATE and step.state.phase is Phase.TRACK
    was_on_spot = abs(state.command[0]) < 0.02 and abs(state.command[1]) > _SPOT_RATE
    return float(np.copysign(0.7, step.w)) if on_spot and not was_on_spot else 0.0
