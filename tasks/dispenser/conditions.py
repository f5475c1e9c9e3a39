"""Questions that the tree asks before it acts."""

from __future__ import annotations

from dataclasses import dataclass

from grape.actions.account import RESUMED
from grape.actions.core import Context, Outcome, condition
from grape.tasks.dispenser.actions.check_feeder import FEEDER_EMPTY
from grape.tasks.dispenser.actions.next_target import remembered


@dataclass(frozen=True, kw_only=True)
class ModeIsGoal:
    """Attributes: mode: the plant's mode. expected: the mode to compare with."""

    mode: str
    expected: str


@condition("ModeIs")
def mode_is(goal: ModeIsGoal, ctx: Context) -> bool:
    """Whether a plant is to be served in a given mode."""
    return goal.mode == goal.expected


@dataclass(frozen=True, kw_only=True)
class ReasonIsOneOfGoal:
    """Attributes: reason: code of the last failure. expected: the codes to compare with."""

    reason: str
    expected: tuple[str, ...]


@condition("ReasonIsOneOf")
def reason_is_one_of(goal: ReasonIsOneOfGoal, ctx: Context) -> bool:
    """Whether the last failure has one of some reason codes, so that trying otherwise can help."""
    return goal.reason in goal.expected


@dataclass(frozen=True, kw_only=True)
class DispensersLeftGoal:
    """No inputs: the ledger and what the last look at the feeder said."""


@condition("DispensersLeft")
def dispensers_left(goal: DispensersLeftGoal, ctx: Context) -> bool:
    """Whether the feeder or the hand still holds a dispenser, by the robot's own account."""
    places = ctx.ledger.dispensers()
    return places.get("hand", 0) > 0 or (places.get("feeder", 0) > 0 and not ctx.world.committed.get(FEEDER_EMPTY))


@dataclass(frozen=True, kw_only=True)
class PlantsLeftGoal:
    """No inputs: the ledger knows the mission's plants."""


@condition("PlantsLeft")
def plants_left(goal: PlantsLeftGoal, ctx: Context) -> bool:
    """Whether a plant of the mission has no outcome yet."""
    return any(task.outcome is None for task in ctx.ledger.plants())


@dataclass(frozen=True, kw_only=True)
class RefillAwaitsGoal:
    """No inputs: the site knows the refill points, the ledger the stock."""


@condition("RefillAwaits")
def refill_awaits(goal: RefillAwaitsGoal, ctx: Context) -> bool:
    """Whether no dispenser is left in feeder and hand, but at a refill point there are more."""
    more = bool(ctx.world.site.refills) and ctx.ledger.dispensers().get("stock", 0) > 0
    return more and not dispensers_left(DispensersLeftGoal(), ctx)


@dataclass(frozen=True, kw_only=True)
class IsDeployedGoal:
    """Attributes: plant: id in the site file."""

    plant: str


@condition("IsDeployed")
def is_deployed(goal: IsDeployedGoal, ctx: Context) -> bool:
    """Whether a plant is finished as deployed, by the robot's own account."""
    return any(task.plant == goal.plant and task.outcome is Outcome.DEPLOYED for task in ctx.ledger.plants())


@dataclass(frozen=True, kw_only=True)
class InterruptedGoal:
    """No inputs: the mission knows whether it goes on after a kill or Ctrl-C."""


@condition("Interrupted")
def interrupted(goal: InterruptedGoal, ctx: Context) -> bool:
    """Whether an earlier session of the mission was cut off, and what it left behind is not settled yet."""
    return bool(ctx.world.committed.get(RESUMED))


@dataclass(frozen=True, kw_only=True)
class RemembersTargetsGoal:
    """Attributes: plant: id in the site file."""

    plant: str


@condition("RemembersTargets")
def remembers_targets(goal: RemembersTargetsGoal, ctx: Context) -> bool:
    """Whether deployment poses of a plant were found at this very stop, before an interruption."""
    return bool(remembered(ctx, goal.plant))
