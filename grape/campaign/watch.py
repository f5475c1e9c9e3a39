"""Run the jobs of a campaign and show how it stands."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from grape.campaign.engines import Engine
from grape.campaign.plan import Job
from grape.mission.display import LiveDisplay

POLL_S = 0.25


@dataclass(kw_only=True)
class Standing:
    """How a campaign stands.

    Attributes:
        done: jobs with a result, read or run.
        broken: jobs that ended without one.
        hanging, plants: of the missions that are done, by the referee.
        doubtful: plants that do not hang, or about which robot and referee disagree.
    """

    jobs: Sequence[Job]
    done: list[Job] = field(default_factory=list)
    broken: list[Job] = field(default_factory=list)
    running: list[Job] = field(default_factory=list)
    hanging: int = 0
    plants: int = 0
    doubtful: int = 0

    def take(self, job: Job) -> bool:
        """Count a job that is finished; false when it has no result."""
        result = job.result()
        if result is None:
            return False
        self.done.append(job)
        truth = (result["truth"] or {}).get("plants", {})
        for plant in result["plants"]:
            hangs = bool(truth.get(plant["id"], {}).get("hanging"))
            self.plants += 1
            self.hanging += hangs
            self.doubtful += not hangs or plant["outcome"] != "deployed"
        return True

    @property
    def line(self) -> str:
        """In one line."""
        text = f"{len(self.done)} of {len(self.jobs)} missions done, {len(self.running)} running"
        text += f", {len(self.broken)} without a result" if self.broken else ""
        rate = f" ({100 * self.hanging / self.plants:.1f} %)" if self.plants else ""
        return f"{text}; {self.hanging} of {self.plants} plants hang{rate}, {self.doubtful} failures"


class StandingDisplay(LiveDisplay):
    """Shows a standing: a live table on a terminal, a line for each mission elsewhere."""

    def __init__(self, console: Console) -> None:
        super().__init__(console)
        self._last = ""

    def show(self, standing: Standing) -> None:
        """Show it as it is now."""
        if self.live is not None:
            self.live.update(_table(standing), refresh=True)
        elif standing.line != self._last:
            self._last = standing.line
            self.console.print(standing.line, highlight=False, soft_wrap=True)


def _table(standing: Standing) -> RenderableType:
    table = Table("seed", "varied", "as it stands")
    for job in standing.running:
        varied = " ".join(value for value in job.varied.values())
        table.add_row(str(job.seed), Text(varied), Text(_last_line(job), overflow="ellipsis", no_wrap=True))
    return Group(table, Text(standing.line, "bold")) if standing.running else Text(standing.line, "bold")


def _last_line(job: Job) -> str:
    """The newest line that the mission's process printed."""
    try:
        with job.log.open("rb") as log:
            log.seek(max(0, log.seek(0, 2) - 400))
            lines = log.read().decode(errors="replace").split("\n")
    except OSError:
        return "starting"
    return next((line.strip() for line in reversed(lines) if line.strip()), "starting")


def run_jobs(
    jobs: Sequence[Job],
    engine: Callable[[], Engine],
    workers: int,
    cancelled: Callable[[], bool] = lambda: False,
    show: Callable[[Standing], None] = lambda standing: None,
) -> Standing:
    """Run every job that is not finished yet, `workers` at a time, until all ended or somebody cancels.

    Args:
        engine: makes the engine; not called when there is nothing to run.
        cancelled: asked all the time.
        show: called several times a second.
    """
    standing = Standing(jobs=jobs)
    waiting = [job for job in jobs if not standing.take(job)]
    if not waiting:
        return standing
    pause, running = threading.Event(), engine()
    try:
        while (waiting or standing.running) and not cancelled():
            while waiting and len(standing.running) < workers:
                running.start(waiting[0])
                standing.running.append(waiting.pop(0))
            for job in running.ended():
                standing.running.remove(job)
                if not standing.take(job):
                    standing.broken.append(job)
            show(standing)
            pause.wait(POLL_S)
    finally:
        running.stop()
    standing.running = []
    return standing
