"""What the command line shows of a mission: a live line while it runs, a summary at the end."""

from __future__ import annotations

from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from grape.mission.progress import Progress

PLAIN_PERIOD_S = 5.0
COLOURS = {
    "succeeded": "bold green", "partial": "bold yellow", "failed": "bold red", "aborted": "bold magenta",
    "deployed": "green", "skipped": "yellow",
}  # fmt: skip


class LiveDisplay:
    """A live part of the terminal; `live` is None where the console is no terminal, which then gets plain lines."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self.live = Live(console=console, transient=True, auto_refresh=False) if console.is_terminal else None

    def __enter__(self) -> Self:
        if self.live is not None:
            self.live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self.live is not None:
            self.live.stop()


class ProgressDisplay(LiveDisplay):
    """Shows progress: one live line on a terminal, a plain line every five seconds elsewhere."""

    def __init__(self, console: Console) -> None:
        super().__init__(console)
        self._next_line_s = 0.0

    def show(self, progress: Progress) -> None:
        """Show one moment."""
        if self.live is not None:
            self.live.update(live_line(progress, self.console.width), refresh=True)
        elif progress.wall_time_s >= self._next_line_s:
            self._next_line_s = progress.wall_time_s + PLAIN_PERIOD_S
            self.console.print(Text(plain_line(progress)), highlight=False, soft_wrap=True)


def plain_line(progress: Progress) -> str:
    """`  50 %  2/4 plants done, r0n0  ServoToNail  sim 123.4 s  x1.32`."""
    return (
        f"{progress.percent:4.0f} %  {progress.done}/{progress.plants} plants done,"
        f" {progress.plant or '-':<8} {progress.phase:<22} sim {progress.sim_time_s:7.1f} s"
        f"  x{progress.real_time_factor:.2f}"
    )


def live_line(progress: Progress, width: int) -> Text:
    """The same with a bar."""
    cells = 24
    full = round(cells * progress.percent / 100)
    line = Text(overflow="ellipsis", no_wrap=True)
    line.append("█" * full, "green").append("░" * (cells - full), "dim")
    line.append(f" {progress.percent:3.0f} % ", "bold")
    line.append(f" {progress.plant or '·'} ", "cyan").append(f"{progress.phase} ")
    line.append(f" sim {progress.sim_time_s:.1f} s  ×{progress.real_time_factor:.2f} real time", "dim")
    line.truncate(max(width - 1, 20))
    return line


def summary(result: dict[str, Any]) -> Table:
    """A table of plants, and the mission's outcome as its title and caption."""
    status = str(result["status"])
    title = Text(f"{result['mission']}  seed {result['seed']}: ").append(status, COLOURS.get(status, ""))
    table = Table(title=title, caption=_caption(result), caption_justify="left", title_justify="left")
    for name in ("plant", "mode", "outcome"):
        table.add_column(name)
    for name in ("attempts", "cycle", "servo"):
        table.add_column(name, justify="right")
    table.add_column("hangs")
    table.add_column("reason")
    truth = result.get("truth") or {}
    for plant in result["plants"]:
        outcome, servo = plant["outcome"], plant["servo"]["error_px"]
        cycle = plant["cycle_s"]
        hangs = "" if not truth else "yes" if plant["id"] in truth["hanging"] else "no"
        table.add_row(
            Text(plant["id"]),
            plant["mode"],
            Text(outcome, COLOURS.get(outcome, "red")),
            str(plant["attempts"]),
            "" if cycle is None else f"{cycle:.0f} s",
            "" if servo is None else f"{servo:.1f} px",
            hangs,
            Text(plant["reason"]),
        )
    return table


def _caption(result: dict[str, Any]) -> Text:
    account, truth = result["dispensers"], result.get("truth") or {}
    rmse = result["localization"]["position_rmse_m"]
    took = f"{result['wall_time_s']:.1f} s"
    if truth:
        took = f"{result['sim_time_s']:.1f} s simulated in {took} (x{result['real_time_factor']:.2f})"
    lines = [
        f"dispensers: {account['deployed']} deployed, {account['left']} left, {account['lost']} lost"
        + (f"; the referee sees {len(truth['hanging'])} hanging" if truth else ""),
        took + (f", position error {rmse:.3f} m RMS" if rmse is not None else ""),
    ]
    return Text("\n".join([*lines, *([result["detail"]] if result.get("detail") else [])]), "table.caption")
