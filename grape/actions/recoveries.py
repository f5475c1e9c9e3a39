"""What a tree can do about a base that does not get on: wait, back off, turn, leave a fence.

Each goes through the base's guard.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np

from grape.actions.base_senses import BaseSenses, base_pose
from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.shortest_way import footprint_of
from grape.errors import ActionFailed, GoalRejected, Reason
from grape.geometry import wrap_angle
from grape.messages import Array
from grape.navigation.fence_guard import FenceGuard
from grape.navigation.path import in_frame_of
from grape.trajectory.online import VelocityLimiter

ACCELERATION = np.array([0.5, 1.0])  # m/s^2, rad/s^2
HELD_BACK_S = 3.0  # without any motion
STUCK_S = 10.0  # with motion that is sent and does not come about
LOOK_AHEAD_M = 0.2
RADII = np.array([np.inf, 1.0, -1.0, 0.6, -0.6])  # m, of the ways out of a fence; the first is straight
BEYOND_S = 0.5  # more than a way out should take, before it is taken twice


@dataclass(frozen=True, kw_only=True)
class WaitGoal:
    """Attributes: duration_s: how long to stand."""

    duration_s: float = 5.0


@dataclass(frozen=True, kw_only=True)
class BackOffGoal:
    """How far to go straight back.

    Attributes:
        distance: m, over 0 and at most 3.
        speed: m/s, over 0 and at most 0.3.
    """

    distance: float = 0.5
    speed: float = 0.2


@dataclass(frozen=True, kw_only=True)
class BackOffResult:
    """Attributes: backed_m: how far it went, by the estimate."""

    backed_m: float


@dataclass(frozen=True, kw_only=True)
class TurnGoal:
    """How far to turn in place.

    Attributes:
        angle: rad, positive to the left, at most half a turn.
        rate: rad/s, over 0 and at most 0.8.
    """

    angle: float
    rate: float = 0.5


@dataclass(frozen=True, kw_only=True)
class TurnResult:
    """Attributes: turned_rad: how far it turned, by the estimate."""

    turned_rad: float


@dataclass(frozen=True, kw_only=True)
class LeaveFenceGoal:
    """Attributes: speed: m/s, over 0 and at most 0.3."""

    speed: float = 0.3


@action("Wait")
def wait(goal: WaitGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Stands for a while: who is in the way may go."""
    if not 0.0 <= goal.duration_s < np.inf:
        raise GoalRejected(f"a finite time from 0 s, got {goal.duration_s}")
    begun_s = ctx.clock.now()
    with ctx.base.lease("Wait") as base:
        while (waited_s := ctx.clock.now() - begun_s) < goal.duration_s:
            base.send(0.0, 0.0)
            left_s = goal.duration_s - waited_s
            yield Feedback(status=f"waiting, {left_s:.0f} s left", progress=waited_s / goal.duration_s)
    return NoResult()


@action("BackOff")
def back_off(goal: BackOffGoal, ctx: Context) -> Generator[Feedback, None, BackOffResult]:
    """Goes straight back as far as what is known of the ground behind allows; BLOCKED when something stops it."""
    if not (0.0 < goal.distance <= 3.0 and 0.0 < goal.speed <= 0.3):
        raise GoalRejected(f"a distance up to 3 m and a speed up to 0.3 m/s, both over 0, got {goal}")
    begin = base_pose(ctx)

    def backed() -> float:
        return -float(in_frame_of(base_pose(ctx), begin)[0])

    yield from _move(ctx, "BackOff", np.array([-goal.speed, 0.0]), backed, goal.distance)
    return BackOffResult(backed_m=backed())


@action("Turn")
def turn(goal: TurnGoal, ctx: Context) -> Generator[Feedback, None, TurnResult]:
    """Turns in place; BLOCKED when something stops it."""
    if not (0.0 < abs(goal.angle) <= np.pi and 0.0 < goal.rate <= 0.8):
        raise GoalRejected(f"an angle up to half a turn and a rate up to 0.8 rad/s, got {goal}")
    last, turned = base_pose(ctx)[2], 0.0
    side = float(np.sign(goal.angle))

    def so_far() -> float:
        nonlocal last, turned
        yaw = base_pose(ctx)[2]
        turned += side * float(wrap_angle(yaw - last))
        last = yaw
        return turned

    yield from _move(ctx, "Turn", np.array([0.0, side * goal.rate]), so_far, abs(goal.angle))
    return TurnResult(turned_rad=side * so_far())


@action("LeaveFence")
def leave_fence(goal: LeaveFenceGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Drives out of a fence that the base has come to stand in, pushed or by a better estimate; nothing to do outside.

    Of straight ways, arcs and turns on the spot, forward and back, it takes the one that is out first; FENCE when none
    of them is, or when the way was not as long as it seemed.
    """
    if not 0.0 < goal.speed <= 0.3:
        raise GoalRejected(f"a speed over 0 and up to 0.3 m/s, got {goal.speed}")
    footprint = footprint_of(ctx.robot.description.base.footprint)
    fences = FenceGuard([fence.polygon for fence in ctx.world.site.fences], footprint)
    begin = base_pose(ctx)
    if not fences.stands_in(begin):
        return NoResult()
    commands = [np.array([v, w]) for v in (goal.speed, -goal.speed) for w in v / RADII]
    commands += [np.array([0.0, w]) for w in (0.3, -0.3)]
    times = [fences.way_out_s(v, w, begin) for v, w in commands]
    best = int(np.argmin(times))
    if not np.isfinite(times[best]):
        raise ActionFailed(Reason.FENCE, f"no short way out of the fence at ({begin[0]:.2f}, {begin[1]:.2f})")
    begun_s, patience_s = ctx.clock.now(), 2.0 * (times[best] + BEYOND_S)
    with ctx.base.lease("LeaveFence") as base:
        while ctx.clock.now() - begun_s < patience_s and fences.stands_in(base_pose(ctx)):
            base.send(*commands[best].tolist())  # judged by its way out, which a slow start would not show
            yield Feedback(status=f"leaving a fence, {ctx.clock.now() - begun_s:.1f} s")
    if fences.stands_in(pose := base_pose(ctx)):
        raise ActionFailed(Reason.FENCE, f"still in the fence at ({pose[0]:.2f}, {pose[1]:.2f})")
    ctx.log.event("recovery", how="leave fence", why=f"stood in one at ({begin[0]:.2f}, {begin[1]:.2f})")
    return NoResult()


def _move(
    ctx: Context, owner: str, velocity: Array, done: Callable[[], float], wanted: float
) -> Generator[Feedback, None, None]:
    """Keeps a velocity (2,) m/s, rad/s, smoothly begun and ended, until `done()` comes to `wanted`.

    Raises:
        ActionFailed: BLOCKED, when the ground ahead is occupied, or for a while the base's guard lets nothing through
            or the base does not get on; STALE_DATA, of clouds too on the way back, or NOT_LOCALIZED.
    """
    senses = BaseSenses(ctx, base_pose(ctx)[None])
    limits = ctx.robot.description.base
    limiter = VelocityLimiter(np.array([limits.max_linear, limits.max_angular]), ACCELERATION)
    speed, acceleration = np.abs(velocity).max(), ACCELERATION[int(np.abs(velocity).argmax())]
    moved_s = gained_s = ctx.clock.now()
    least = wanted
    with ctx.base.lease(owner) as base:
        while (left := wanted - done()) > 1e-3:
            now = ctx.clock.now()
            fresh = senses.fresh(now, clouds=velocity[0] < 0.0)  # the rear may be seen by them alone
            if fresh:
                senses.update()
                _refuse_occupied(senses, velocity)
            # From this speed it comes to rest in what is left.
            share = min(1.0, float(np.sqrt(2.0 * 0.7 * acceleration * left)) / speed) if fresh else 0.0
            command = limiter.step(max(share, 0.1 if fresh else 0.0) * velocity)
            sent = base.send(float(command[0]), float(command[1]))
            if sent.linear[0] or sent.angular[2]:
                moved_s = now
            else:
                limiter.reset()
            if now - moved_s > HELD_BACK_S:
                raise ActionFailed(Reason.BLOCKED, f"the base is held back, {left:.2f} short of {wanted:.2f}")
            if not fresh or left < least - 0.05 * speed:
                least, gained_s = left, now
            if now - gained_s > STUCK_S:
                detail = (
                    f"no progress for {STUCK_S:.0f} s, {left:.2f} short of {wanted:.2f}: wheels slip or something holds"
                )
                raise ActionFailed(Reason.BLOCKED, detail)
            yield Feedback(status=f"{left:.2f} left", progress=float(min(1.0, max(0.0, 1.0 - left / wanted))))


def _refuse_occupied(senses: BaseSenses, velocity: Array) -> None:
    """Scanners that look ahead do not guard the rear: for that there is the costmap, which has the clouds too."""
    if senses.local is None or velocity[0] == 0.0:
        return
    x, y, yaw = senses.pose()
    ahead = np.sign(velocity[0]) * np.linspace(0.0, LOOK_AHEAD_M, 5)
    poses = np.column_stack([x + ahead * np.cos(yaw), y + ahead * np.sin(yaw), np.full(5, yaw)])
    touched = senses.local.blocked(poses, senses.footprint)
    if touched[-1] and not touched[0]:
        raise ActionFailed(Reason.BLOCKED, f"something is within {LOOK_AHEAD_M} m behind the base")
