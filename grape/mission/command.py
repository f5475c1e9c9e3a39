"""`grape run` and `grape resume` behind their options: signals, live display, summary."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from grape.mission.display import ProgressDisplay, summary
from grape.mission.file import load_mission
from grape.mission.launch import MissionRun, resume_mission, run_mission


class Cancellation:
    """Remembers that the user asked to stop; a second time ends the program at once."""

    def __init__(self) -> None:
        self.requested = False

    def __call__(self) -> bool:
        return self.requested

    @contextmanager
    def listening(self) -> Iterator[None]:
        """While the block runs, Ctrl-C, SIGTERM and a terminal that closes (but for `nohup`) ask instead of killing."""

        def ask(number: int, frame: object) -> None:
            if self.requested:
                raise KeyboardInterrupt
            self.requested = True

        asking = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        heard = [number for number in asking if signal.getsignal(number) is not signal.SIG_IGN]
        before = {number: signal.signal(number, ask) for number in heard}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def run_command(
    name: str, seed: int | None, out: Path | None, world: Path | None, assignments: list[str], render: bool
) -> str:
    """Run a mission as `grape run` does; returns its status.

    Raises:
        GrapeError: the input has problems.
    """
    console = Console()
    overrides = [*assignments, *([f"seed={seed}"] if seed is not None else [])]
    mission = load_mission(name, overrides, world)
    console.print(
        f"[bold]{mission.name}[/] with {mission.file.robot}, seed {mission.seed}, {len(mission.plants)} plants:"
        " building world and robot …"
    )
    cancellation = Cancellation()
    with cancellation.listening(), ProgressDisplay(console) as display:
        done = run_mission(mission, out, cancelled=cancellation, on_progress=display.show, render=render)
    return _tell(console, done)


def resume_command(folder: Path) -> str:
    """Go on with a run as `grape resume` does; returns its status.

    Raises:
        GrapeError: the folder is no run that can be resumed.
    """
    console = Console()
    console.print(
        f"resuming [bold]{escape(str(folder))}[/]: building world and robot …", highlight=False, soft_wrap=True
    )
    cancellation = Cancellation()
    with cancellation.listening(), ProgressDisplay(console) as display:
        done = resume_mission(folder, cancelled=cancellation, on_progress=display.show)
    if not done.resumed:
        console.print(f"it has ended already, by {done.result['ended_by']}: nothing was done", highlight=False)
    return _tell(console, done)


def _tell(console: Console, done: MissionRun) -> str:
    console.print(summary(done.result))
    console.print(f"run folder: {done.folder}", markup=False, highlight=False, soft_wrap=True)
    return str(done.result["status"])
