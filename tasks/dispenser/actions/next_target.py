"""Take the best remaining deployment pose of a plant."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, action
from grape.errors import ActionFailed, Reason
from grape.tasks.dispenser.targets import HangTarget

TARGETS = "targets"  # in the ledger: the deployment poses of this stop, from the one that is tried now


@dataclass(frozen=True, kw_only=True)
class NextTargetGoal:
    """Which list to take from.

    Attributes:
        plant: id in the site file.
        targets: deployment poses still to try, best first.
    """

    plant: str
    targets: tuple[HangTarget, ...]


@dataclass(frozen=True, kw_only=True)
class NextTargetResult:
    """The pose to try now, and those that remain after it."""

    target: HangTarget
    remaining: tuple[HangTarget, ...]


def remembered(ctx: Context, plant: str) -> tuple[HangTarget, ...]:
    """What the ledger knows of this stop's deployment poses of a plant, none when nothing was found yet."""
    records = ctx.ledger.recall(TARGETS) or ()
    return tuple(HangTarget(**record) for record in records if record["plant"] == plant)


@action("NextTarget")
def next_target(goal: NextTargetGoal, ctx: Context) -> Generator[Feedback, None, NextTargetResult]:
    """Takes the best deployment pose that was not tried yet; fails when none is left."""
    yield Feedback(status=f"{len(goal.targets)} deployment poses left")
    if not goal.targets:
        raise ActionFailed(Reason.NO_DEPLOYMENT_POINT, f"every deployment pose of {goal.plant} was tried")
    ctx.ledger.remember(TARGETS, [target.as_record() for target in goal.targets])
    return NextTargetResult(target=goal.targets[0], remaining=goal.targets[1:])
