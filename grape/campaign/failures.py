"""What went wrong, by action and reason, and how to see each failure again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grape.campaign.plan import Job
from grape.campaign.reading import PlantRun, RunData
from grape.mission.result import lost_unnoticed, misplaced, true_places

ACCOUNT = "account"  # robot and referee disagree
MISSION = "mission"  # no action failed: time was up, somebody stopped it, or nothing was left to serve it with
PROCESS = "process"  # the mission left no result


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A plant that does not hang or is counted wrongly; without `plant`, a dispenser that is, or a broken mission.

    Attributes:
        action, reason, detail: what failed last before the robot gave it up.
        picture: path from the campaign folder; empty when there is none.
        replay: the command that runs the mission again.
    """

    seed: int
    plant: str
    mode: str
    conditions: Mapping[str, Any]
    action: str
    reason: str
    detail: str
    time_s: float | None
    picture: str
    replay: str


def failures_of(runs: Sequence[RunData], broken: Iterable[Job], folder: Path) -> list[Failure]:
    """Every failure of a campaign in `folder`, by seed."""
    found = [
        _plant_failure(run, plant, folder)
        for run in runs
        for plant in run.plants
        if not plant.hanging or not plant.agrees
    ]
    found += [_lost_failure(run, folder) for run in runs if lost_unnoticed(run.result)]
    found += [_process_failure(job) for job in broken]
    return sorted(found, key=lambda failure: failure.seed)


def _plant_failure(run: RunData, plant: PlantRun, folder: Path) -> Failure:
    action, reason, detail, time_s, picture = _cause(plant, str(run.result["detail"]))
    return Failure(
        seed=plant.seed,
        plant=plant.plant,
        mode=plant.mode,
        conditions=plant.conditions,
        action=action,
        reason=reason,
        detail=detail,
        time_s=time_s,
        picture=(run.job.folder.relative_to(folder) / picture).as_posix() if picture else "",
        replay=run.job.replay,
    )


def _cause(plant: PlantRun, mission_detail: str) -> tuple[str, str, str, float, str]:
    """Action, reason, detail, time and picture of what the plant failed by."""
    if not plant.agrees:
        reason = "hangs but is not counted" if plant.hanging else "counted but does not hang"
        detail = f"the robot says {plant.outcome} {plant.reason}".strip()
        return ACCOUNT, reason, detail, plant.end_s, plant.last_picture
    crash = [failure for failure in plant.failures if failure.reason == "crash"]
    fitting = [failure for failure in plant.failures if failure.reason == plant.reason]
    last = (crash or fitting or [*plant.failures])[-1:]
    if plant.reason in ("time_limit", "aborted", "not_served") or not last:
        return MISSION, plant.reason or "unknown", mission_detail, plant.end_s, plant.last_picture
    return last[0].action, last[0].reason, last[0].detail, last[0].time_s, last[0].picture


def _lost_failure(run: RunData, folder: Path) -> Failure:
    result, picture = run.result, run.plants[-1].last_picture if run.plants else ""
    wrong = misplaced(result["places"], true_places(result["truth"])) if "places" in result else {}
    counted = ", ".join(f"{number} at {place}" for place, number in wrong.items() if place != "lost")
    return Failure(
        seed=run.job.seed,
        plant="",
        mode="",
        conditions=run.conditions,
        action=ACCOUNT,
        reason="lost unnoticed",
        detail=f"lies on the ground, but is counted elsewhere: {counted}",
        time_s=float(result["sim_time_s"]),
        picture=(run.job.folder.relative_to(folder) / picture).as_posix() if picture else "",
        replay=run.job.replay,
    )


def _process_failure(job: Job) -> Failure:
    lines = job.log.read_text(errors="replace").strip().splitlines() if job.log.is_file() else []
    return Failure(
        seed=job.seed,
        plant="",
        mode="",
        conditions=job.varied,
        action=PROCESS,
        reason="no result",
        detail=lines[-1] if lines else "it printed nothing",
        time_s=None,
        picture="",
        replay=job.replay,
    )


def taxonomy(runs: Sequence[RunData], failures: Sequence[Failure]) -> list[dict[str, Any]]:
    """How often each action failed for each reason (`times`), and how many plants it cost (`plants`); worst first."""
    times = Counter(
        (failure.action, failure.reason) for run in runs for plant in run.plants for failure in plant.failures
    )
    cost = Counter((failure.action, failure.reason) for failure in failures)
    rows = [
        {"action": key[0], "reason": key[1], "times": max(times[key], cost[key]), "plants": cost[key]}
        for key in {*times, *cost}
    ]
    return sorted(rows, key=lambda row: (-row["plants"], -row["times"], row["action"], row["reason"]))
