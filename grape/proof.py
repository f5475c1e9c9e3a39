"""What an experiment measured: quantities with their sample size, interval, reference and goal, and what to look at.

An experiment proves one row of what a system is asked for, a bench holds speeds against those of peers. Packages bring
their own through the entry point groups `grape.experiments`, whose names are the rows and whose values are
`Experiment`s, and `grape.benches`, whose values are `Bench`es.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from grape.errors import InvalidInput

MOST_SEEDS = 100_000
_SEED = re.compile(r"[0-9]{1,18}")
_GOALS = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt, "=": operator.eq}


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One measured figure.

    Attributes:
        name, unit: what it is; unit "1" for a rate or a count.
        value: None when it could not be measured.
        n: sample size.
        ci95: 95 % confidence interval; None where none is meant.
        reference: the figure to beat, as its source gives it; empty when there is none.
        goal: what is asked, like "<= 0.10"; empty when nothing is.
    """

    name: str
    unit: str
    value: float | None
    n: int
    ci95: tuple[float, float] | None = None
    reference: str = ""
    goal: str = ""

    def __post_init__(self) -> None:
        _check_goal(self.goal)

    @property
    def met(self) -> bool | None:
        """Whether the goal is met; None without a goal, False without a value."""
        return _met(self.goal, self.value)


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture of the page. Attributes: title: what it shows; svg: one <svg> element."""

    title: str
    svg: str


@dataclass(frozen=True, kw_only=True)
class Proof:
    """What an experiment found.

    Attributes:
        notes: sentences a reader needs to judge the figures.
        complete: false when it was stopped; the figures are then of what was done so far.
    """

    quantities: tuple[Quantity, ...]
    figures: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()
    complete: bool = True


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """How a row is proved.

    Attributes:
        row: its name, such as G8.
        summary: what is done, in one sentence.
        seeds: the seeds that are reported when none are asked for.
        run: (seeds, folder for its files, progress: called with a fraction and a sentence) → what it found. It goes on
            from the files it finds there, so that it can be stopped and started again.
    """

    row: str
    summary: str
    seeds: range
    run: Callable[[Sequence[int], Path, Callable[[float, str], None]], Proof]


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """How long something takes, beside a peer that does the same, both measured in one run.

    Attributes:
        quantity, unit: what takes that long; a unit of time.
        value, peer_value: ours and the peer's; a peer may be missing.
        peer: its name.
        ratio_goal: what is asked of `ratio`, like ">= 20"; empty when nothing is.
        value_goal: what is asked of `value`, likewise.
        at: the size of the problem where it varies; rows of one quantity at several sizes are a line of the page.
    """

    quantity: str
    unit: str
    value: float
    peer: str = ""
    peer_value: float | None = None
    ratio_goal: str = ""
    value_goal: str = ""
    at: float | None = None

    def __post_init__(self) -> None:
        _check_goal(self.ratio_goal)
        _check_goal(self.value_goal)

    @property
    def ratio(self) -> float | None:
        """How many times as long the peer takes."""
        return None if self.peer_value is None else self.peer_value / self.value

    @property
    def met(self) -> bool | None:
        """Whether every goal is met; None without one."""
        met = [_met(self.ratio_goal, self.ratio), _met(self.value_goal, self.value)]
        return None if met == [None, None] else False not in met


@dataclass(frozen=True, kw_only=True)
class Bench:
    """How speeds are measured.

    Attributes:
        summary: what is measured, in one sentence.
        run: (progress: called with a fraction and a sentence) → comparisons.
    """

    name: str
    summary: str
    run: Callable[[Callable[[float, str], None]], Sequence[Comparison]]


def parse_seeds(text: str) -> range:
    """Seeds as a user writes them: `A:B` is A, A + 1, … B − 1.

    Raises:
        InvalidInput: it is not two whole numbers with 0 <= A < B, or they are more than 100000 seeds.
    """
    first, colon, last = text.partition(":")
    if not _SEED.fullmatch(first) or (colon and not _SEED.fullmatch(last)):
        raise InvalidInput(f"seeds must be two whole numbers FIRST:LAST, last excluded, like 0:10; got {text!r}")
    if not colon:
        raise InvalidInput(f"seeds must be FIRST:LAST, last excluded; did you mean {first}:{int(first) + 1}?")
    if int(first) >= int(last):
        hint = f"did you mean {first}:{int(first) + 1}?" if first == last else f"did you mean {last}:{first}?"
        raise InvalidInput(f"seeds {text!r} are none, the last is excluded; {hint}")
    if int(last) - int(first) > MOST_SEEDS:
        raise InvalidInput(f"seeds {text!r} are {int(last) - int(first)}; allowed: at most {MOST_SEEDS}")
    return range(int(first), int(last))


def wilson95(yes: int, n: int) -> tuple[float, float]:
    """95 % confidence interval of the rate of `yes` among `n`; (0, 1) when n is 0.

    Raises:
        InvalidInput: `yes` is not within 0..n.

    Source: Wilson, Probable inference, the law of succession, and statistical inference, 1927.
    """
    if not 0 <= yes <= n:
        raise InvalidInput(f"0 <= yes <= n must hold, got {yes} of {n}")
    if n == 0:
        return 0.0, 1.0
    z, p = 1.959964, yes / n
    middle, half = p + z * z / (2 * n), z * (p * (1 - p) / n + z * z / (4 * n * n)) ** 0.5
    low, high = (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)
    return float(max(low, 0.0)), float(min(high, 1.0))


def median95(values: Sequence[float]) -> tuple[float, float] | None:
    """95 % confidence interval of the median, between order statistics; None below six values.

    Source: Conover, Practical nonparametric statistics, 3rd ed. 1999, section 3.2.
    """
    n, half = len(values), 0.98 * len(values) ** 0.5
    if n < 6:
        return None
    ordered = sorted(values)
    first, last = max(0, math.floor(n / 2 - half) - 1), min(n - 1, math.ceil(n / 2 + half) - 1)
    return float(ordered[first]), float(ordered[last])


def _check_goal(goal: str) -> None:
    sign, _, bound = goal.partition(" ")
    if goal and (sign not in _GOALS or not bound):
        raise InvalidInput(f"a goal is a sign and a bound, like '<= 0.10', got {goal!r}")


def _met(goal: str, value: float | None) -> bool | None:
    if not goal:
        return None
    sign, _, bound = goal.partition(" ")
    return value is not None and bool(_GOALS[sign](value, float(bound)))
