"""What an experiment measured: quantities with their sample size, interval, reference and goal, and what to look at.

An experiment proves one row of what a system is asked for. Packages bring their own through the entry point group
`grape.experiments`, whose names are the rows and whose values are `Experiment`s.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from grape.errors import InvalidInput

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
        sign, _, bound = self.goal.partition(" ")
        if self.goal and (sign not in _GOALS or not bound):
            raise InvalidInput(f"a goal is a sign and a bound, like '<= 0.10', got {self.goal!r}")

    @property
    def met(self) -> bool | None:
        """Whether the goal is met; None without a goal, False without a value."""
        if not self.goal:
            return None
        sign, _, bound = self.goal.partition(" ")
        return self.value is not None and bool(_GOALS[sign](self.value, float(bound)))


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture of the page. Attributes: title: what it shows; svg: one <svg> element."""

    title: str
    svg: str


@dataclass(frozen=True, kw_only=True)
class Proof:
    """What an experiment found. Attributes: notes: sentences a reader needs to judge the figures."""

    quantities: tuple[Quantity, ...]
    figures: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()


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


def wilson95(yes: int, n: int) -> tuple[float, float]:
    """95 % confidence interval of the rate of `yes` among `n`; (0, 1) when n is 0.

    Source: Wilson, Probable inference, the law of succession, and statistical inference, 1927.
    """
    if not 0 <= yes <= n:
        raise InvalidInput(f"0 <= yes <= n must hold, got {yes} of {n}")
    if n == 0:
        return 0.0, 1.0
    z, p = 1.959964, yes / n
    middle, half = p + z * z / (2 * n), z * (p * (1 - p) / n + z * z / (4 * n * n)) ** 0.5
    return float((middle - half) / (1 + z * z / n)), float((middle + half) / (1 + z * z / n))
