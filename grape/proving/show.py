"""What the measuring commands show in the terminal: one live line while they work, and figures as they are read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from grape.clock import MonotonicClock

PLAIN_PERIOD_S = 5.0


@contextmanager
def live_progress(console: Console) -> Iterator[Callable[[float, str], None]]:
    """A function that shows a fraction and a sentence: a live bar on a terminal, elsewhere a line now and then."""
    if not console.is_terminal:
        yield _plain(console)
        return
    columns = (BarColumn(24), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=console, transient=True) as bars:
        bar = bars.add_task("starting", total=1.0)
        yield lambda fraction, sentence: bars.update(bar, completed=fraction, description=sentence)


def _plain(console: Console) -> Callable[[float, str], None]:
    clock, next_line_s = MonotonicClock(), 0.0

    def show(fraction: float, sentence: str) -> None:
        nonlocal next_line_s
        if clock.now() >= next_line_s:
            next_line_s = clock.now() + PLAIN_PERIOD_S
            console.print(f"{100 * fraction:4.0f} %  {sentence}", markup=False, highlight=False, soft_wrap=True)

    return show


def figure(value: float | None, unit: str = "1") -> str:
    """A value as a person reads it: four digits, with its unit."""
    if value is None:
        return "–"
    text = f"{value:.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
    return text if unit == "1" else f"{text} {unit}"


def verdict(met: bool | None) -> Text:
    """Whether a goal is met, in colour."""
    if met is None:
        return Text("")
    return Text("yes", "green") if met else Text("no", "bold red")
