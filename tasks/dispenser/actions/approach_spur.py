"""Bring the held dispenser above a spur."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, action
from grape.actions.move_arm import move_to_pose
from grape.actions.obstacles import OBSTACLES, Obstacles
from grape.actions.retract import back_off
from grape.actions.rocking import rocking, up_in_base
from grape.drivers import ArmDriver
from grape.errors import ActionFailed, Reason
from grape.tasks.dispenser.stops import SPUR_STAND_OFF_M, orientations
from grape.tasks.dispenser.targets import HangTarget, hang_line
from grape.tasks.dispenser.ways import ways_by_ease

TURN_THE_HAND = (Reason.UNREACHABLE, Reason.NO_PLAN, Reason.IN_COLLISION, Reason.CABLE_BUDGET)


@dataclass(frozen=True, kw_only=True)
class ApproachSpurGoal:
    """What to approach, and how.

    Attributes:
        target: the deployment pose.
        stand_off_m: of the loop above the spur's tip.
        turns: how many other orientations of the hand are tried where no way leads to the first.
        rocks: how often the hand follows a target when the base has rocked under the arm on the way.
    """

    target: HangTarget
    stand_off_m: float = SPUR_STAND_OFF_M
    turns: int = 3
    rocks: int = 2


@dataclass(frozen=True, kw_only=True)
class ApproachSpurResult:
    """Attributes: approached: the deployment pose with the orientation of the hand that was reached."""

    approached: HangTarget


@action("ApproachSpur")
def approach_spur(goal: ApproachSpurGoal, ctx: Context) -> Generator[Feedback, None, ApproachSpurResult]:
    """Plans to a pitched hand pose above a spur, collision-free against the scanned vine.

    Where no way leads to the target's own orientation of the hand, it is turned about the vertical or tilted. Where the
    base has rocked since the target was seen, or does so on the way, the hand goes to where the target is now.
    """
    target = goal.target
    ctx.ledger.attempt(target.plant)
    with ctx.ledger.step("approach", target.plant), ctx.arm.lease("ApproachSpur") as arm:
        yield from back_off(ctx, arm)  # from where an attempt before has failed
        for _ in range(goal.rocks + 1):
            target = yield from _approach(goal, ctx, arm, where_now(ctx, target))
            if rocking(ctx, target.up) is None:
                break
            ctx.log.event("rocked", plant=target.plant)
    return ApproachSpurResult(approached=where_now(ctx, target))


def where_now(ctx: Context, target: HangTarget) -> HangTarget:
    """The target where it is in base_link after the base has rocked."""
    T_now_seen = rocking(ctx, target.up)
    return target if T_now_seen is None else target.moved(T_now_seen, up_in_base(ctx))


def _approach(
    goal: ApproachSpurGoal, ctx: Context, arm: ArmDriver, target: HangTarget
) -> Generator[Feedback, None, HangTarget]:
    """Moves above a target; returns it with the orientation of the hand that was reached."""
    try:
        yield from _move_above(ctx, arm, target, goal.stand_off_m)
        return target
    except ActionFailed as failure:
        if failure.reason not in TURN_THE_HAND:
            raise
        first = failure
    for turned in _turned(ctx, target)[: goal.turns]:
        try:
            yield from _move_above(ctx, arm, turned, goal.stand_off_m)
        except ActionFailed as failure:
            if failure.reason not in TURN_THE_HAND:
                raise
            continue
        ctx.log.event("hand_turned", plant=target.plant, why=str(first))
        return turned
    raise first


def _move_above(ctx: Context, arm: ArmDriver, target: HangTarget, stand_off: float) -> Generator[Feedback, None, None]:
    line = hang_line(ctx.robot, target, stand_off)
    yield from move_to_pose(ctx, arm, line, status="moving in front of target", touch=target.touched())


def _turned(ctx: Context, target: HangTarget) -> list[HangTarget]:
    """The other orientations of the hand in which the arm can do the whole motion, best first."""
    others = [way for way in orientations(target) if (way.pitch, way.azimuth) != (target.pitch, target.azimuth)]
    obstacles: Obstacles | None = ctx.world.committed.get(OBSTACLES)
    return ways_by_ease(ctx.robot, others, None if obstacles is None else obstacles.cloud)
