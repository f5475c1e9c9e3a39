"""The errors of grape: one base, and each says what was got, what is allowed and what to try."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

MOST_PROBLEMS = 100  # of one file: who has more mends the first and asks again


class GrapeError(Exception):
    """Base of every error that grape raises on purpose."""


class InvalidInput(GrapeError, ValueError):
    """A value handed to a function is outside what it accepts (NaN, wrong shape, wrong frame, out of range)."""


class DriverError(GrapeError):
    """A driver cannot do what was asked: not connected, refused, stale."""


class StaleData(DriverError):
    """The newest data of a driver is older than the caller accepts, or there is none yet."""


class LeaseRevoked(GrapeError):
    """An actuator was used through a lease that a newer lease has revoked."""


class Reason(StrEnum):
    """Reason codes of grape's own actions; the tree decides by them, the ledger and the report keep them."""

    # any action
    TIMEOUT = "timeout"
    STALE_DATA = "stale_data"
    REJECTED_GOAL = "rejected_goal"
    INTERNAL_ERROR = "internal_error"
    # driving
    NO_PATH = "no_path"
    BLOCKED = "blocked"
    NOT_LOCALIZED = "not_localized"
    FENCE = "fence"
    # arm
    UNREACHABLE = "unreachable"
    IN_COLLISION = "in_collision"
    CONTACT = "contact"
    NO_PLAN = "no_plan"
    TRACKING_ERROR = "tracking_error"
    DISTANCE_GROWS = "distance_grows"
    CABLE_BUDGET = "cable_budget"
    # servoing
    FEATURE_LOST = "feature_lost"
    NOT_CONVERGED = "not_converged"
    # dispensers
    NO_PLANT_LEFT = "no_plant_left"
    FEEDER_EMPTY = "feeder_empty"
    NO_REFILL_POINT = "no_refill_point"
    REFILL_TIMEOUT = "refill_timeout"
    GRASP_FAILED = "grasp_failed"
    DISPENSER_FALLEN = "dispenser_fallen"
    NO_DEPLOYMENT_POINT = "no_deployment_point"
    DEPLOYMENT_NOT_CONFIRMED = "deployment_not_confirmed"


class ActionFailed(GrapeError):
    """An action ends ABORTED.

    Args:
        reason: code that the tree, the ledger and the report use: a `Reason`, or a word of your own, like `too_dark`.
        detail: one sentence for a person, with the numbers that decided.
    """

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}" if detail else str(reason))
        self.reason = reason
        self.detail = detail


class GoalRejected(ActionFailed):
    """An action refuses its goal before it moves anything: it ends REJECTED."""

    def __init__(self, detail: str) -> None:
        super().__init__(Reason.REJECTED_GOAL, detail)


@dataclass(frozen=True, kw_only=True, order=True)
class Problem:
    """One thing that is wrong in a file a user wrote.

    Line and column count from 1; 0 means the place is not known. `path` is the key inside the file (`world.rows`).
    """

    file: str
    line: int = 0
    column: int = 0
    path: str = ""
    got: str
    allowed: str = ""
    suggestion: str = ""

    def __str__(self) -> str:
        place = ":".join([self.file, *(str(n) for n in (self.line, self.column) if n)])
        text = f"{place}: {self.path}: {self.got}" if self.path else f"{place}: {self.got}"
        if self.allowed:
            text += f"; allowed: {self.allowed}"
        if self.suggestion:
            text += f"; {self.suggestion}"
        return text


class FileError(GrapeError):
    """A file that users wrote has problems; all of them are listed at once, of very many the first."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(sorted(problems)[:MOST_PROBLEMS])
        super().__init__("\n".join(str(problem) for problem in self.problems))


def did_you_mean(got: str, allowed: Iterable[str]) -> str:
    """A suggestion for a misspelt name, or an empty string when nothing is close."""
    close = difflib.get_close_matches(got, list(allowed), n=1, cutoff=0.6)
    return f"did you mean {close[0]!r}?" if close else ""


def with_suggestion(sentence: str, got: str, allowed: Iterable[str]) -> str:
    """The sentence, and after it what may have been meant, where something allowed is close to what was got."""
    hint = did_you_mean(got, allowed)
    return f"{sentence}; {hint}" if hint else sentence
