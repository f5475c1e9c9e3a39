"""`grape campaign` behind its options."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console, JustifyMethod
from rich.markup import escape
from rich.table import Table

from grape.campaign.engines import Engine, LocalEngine, engine_named
from grape.campaign.failures import failures_of
from grape.campaign.plan import PLAN_FILE, Job, Plan, keep_plan, make_jobs, make_plan
from grape.campaign.reading import CONDITIONS, RunData, read_run
from grape.campaign.report import campaign_page, interval, percent
from grape.campaign.summary import build_summary
from grape.campaign.watch import Standing, StandingDisplay, run_jobs
from grape.folders import open_folder
from grape.mission.command import Cancellation
from grape.mission.lock import RunLock
from grape.mission.page import number
from grape.mission.record import write_atomic
from grape.proof import parse_seeds

DONE, MISSING, STOPPED = 0, 2, 130
FIGURES: Mapping[str, JustifyMethod] = {"hang": "right", "rate": "right", "95 % interval": "left", "cycle": "right"}


@dataclass(frozen=True, kw_only=True)
class CampaignRun:
    """A campaign that ended. Attributes: runs: its finished missions. summary: the content of campaign.json."""

    folder: Path
    standing: Standing
    runs: Sequence[RunData]
    summary: Mapping[str, Any]


def campaign_command(
    mission: str, seeds: str, workers: int, engine: str, out: Path | None, settings: list[str], variations: list[str]
) -> int:
    """Run a campaign as `grape campaign` does; returns the exit code.

    Raises:
        GrapeError: the input has problems.
    """
    make_engine = engine_named(engine)
    chosen, plan = parse_seeds(seeds), make_plan(mission, settings, variations)
    name = plan.check(chosen.start).name
    folder = open_folder(out, f"campaign-{name}")
    console, cancellation = Console(), Cancellation()
    combinations = len(plan.combinations())
    console.print(
        f"[bold]{name}[/], {len(chosen)} missions, {combinations} kinds of world: {escape(str(folder))}",
        highlight=False,
    )
    if len(chosen) < combinations:
        console.print(f"note: {len(chosen)} seeds do not reach all {combinations} combinations of --vary")
    with cancellation.listening(), StandingDisplay(console) as display:
        done = run_campaign(plan, chosen, folder, make_engine, workers, cancellation, display.show)
    if done.runs:
        console.print(_table(done.summary))
    console.print(done.standing.line, highlight=False)
    console.print(f"written: {folder / 'report.html'}, campaign.json", markup=False, highlight=False, soft_wrap=True)
    if cancellation.requested:
        console.print("stopped; the same command goes on when --out names this folder")
        return STOPPED
    for job in done.standing.broken:
        console.print(f"seed {job.seed}: no result, see {job.log}", markup=False, highlight=False, soft_wrap=True)
    return MISSING if done.standing.broken else DONE


def run_campaign(
    plan: Plan,
    seeds: range,
    folder: Path,
    engine: Callable[[], Engine] = LocalEngine,
    workers: int = 1,
    cancelled: Callable[[], bool] = lambda: False,
    show: Callable[[Standing], None] = lambda standing: None,
) -> CampaignRun:
    """Run what is not finished in a folder, then write campaign.json and report.html of what is.

    Args:
        folder: exists; empty, or of the same plan.
        engine: makes the engine that runs missions.
        cancelled: asked all the time; true ends the missions that run.
        show: called several times a second while missions run.

    Raises:
        InvalidInput: the folder holds something else.
        FolderBusy: another process runs a campaign there.
    """
    keep_plan(plan, folder)
    with RunLock(folder):
        standing = run_jobs(make_jobs(plan, seeds, folder), engine, workers, cancelled, show)
        done = read_campaign(plan, seeds, folder, standing)
        text = json.dumps(done.summary, indent=2, allow_nan=False, ensure_ascii=False)
        write_atomic(folder / "campaign.json", text + "\n")
        write_atomic(folder / "report.html", campaign_page(done.summary, done.runs, folder))
    return done


def read_campaign(plan: Plan, seeds: range, folder: Path, standing: Standing | None = None) -> CampaignRun:
    """The missions of a campaign that are done, and what they come to; nothing is run or written.

    Args:
        folder: of that plan; it may be missing.
        standing: how it stands, where that is known.

    Raises:
        InvalidInput: the folder holds something else.
    """
    if (folder / PLAN_FILE).is_file():
        keep_plan(plan, folder)
    jobs = make_jobs(plan, seeds, folder)
    runs, standing = _finished(jobs), standing or Standing(jobs=jobs)
    summary = build_summary(plan, seeds, runs, standing.broken, failures_of(runs, standing.broken, folder))
    return CampaignRun(folder=folder, standing=standing, runs=runs, summary=summary)


def _finished(jobs: Sequence[Job]) -> list[RunData]:
    results = [(job, job.result()) for job in jobs]
    return [read_run(job, result) for job, result in results if result is not None]


def _table(summary: Mapping[str, Any]) -> Table:
    shown = Table(title="How many hang, by the referee", title_justify="left")
    rows = [
        {
            **{name.replace("_", " "): group[name] for name in ("mode", *CONDITIONS)},
            **group["varied"],
            "hang": f"{group['hanging']} of {group['n']}",
            "rate": percent(group["rate"]),
            "95 % interval": interval(group["wilson95"]),
            "cycle": None if group["cycle_s_median"] is None else f"{group['cycle_s_median']:.0f} s",
        }
        for group in summary["groups"]
    ]
    names = dict.fromkeys(name for row in rows for name, value in row.items() if value is not None)
    for name in names:
        shown.add_column(name, no_wrap=name in FIGURES, overflow="fold", justify=FIGURES.get(name, "left"))
    for row in rows:
        shown.add_row(*(escape("" if row.get(name) is None else str(row[name])) for name in names))
    shown.caption_justify = "left"
    shown.caption = (
        f"account right {percent(summary['account_agreement'])}, {summary['lost_unnoticed']} dispensers lost unnoticed,"
        f" hardest touch {number(summary['max_plant_force_n'], 1, ' N')}"
    )
    return shown
