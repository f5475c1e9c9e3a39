"""What a campaign came to: the content of campaign.json (schema `grape.campaign/1`)."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from grape import __version__
from grape.campaign.failures import Failure, taxonomy
from grape.campaign.plan import Job, Plan
from grape.campaign.reading import CONDITIONS, Check, PlantRun, RunData
from grape.mission.result import lost_unnoticed
from grape.proof import wilson95

SCHEMA = "grape.campaign/1"
POSITIVE = {
    "feeder": "a dispenser is in the feeder",
    "grasp": "a dispenser is on the hand",
    "deployment": "a dispenser hangs on the plant",
}  # what a yes of each check means


def build_summary(
    plan: Plan, seeds: range, runs: Sequence[RunData], broken: Sequence[Job], failures: Sequence[Failure]
) -> dict[str, Any]:
    """The content of campaign.json.

    Args:
        runs: finished missions.
        broken: missions that ended without a result.
    """
    plants = [plant for run in runs for plant in run.plants]
    truths = [run.result["truth"] or {} for run in runs]
    agreeing = sum(plant.agrees for plant in plants)
    return {
        "schema": SCHEMA,
        "grape": __version__,
        **plan.as_dict(),
        "seeds": f"{seeds.start}:{seeds.stop}",
        "missions": len(runs),
        "complete": len(runs) + len(broken) == len(seeds),
        "without_result": [job.seed for job in broken],
        "ended_by": _counts(run.result["ended_by"] for run in runs),
        "total": success(plants),
        "groups": _groups(plants),
        "by": {name: _by(plants, name) for name in ("mode", *_condition_names(plants))},
        "account_agreement": agreeing / len(plants) if plants else None,
        "account_agreement_wilson95": _rounded(wilson95(agreeing, len(plants))),
        "lost_unnoticed": sum(lost_unnoticed(run.result) for run in runs),
        "checks": confusion([check for run in runs for check in run.checks]),
        "max_plant_force_n": max((truth.get("max_plant_force_n", 0.0) for truth in truths), default=None),
        "collisions": sum(len(truth.get("collisions", ())) for truth in truths),
        "fence_crossings": sum(truth.get("fence_crossings", 0) for truth in truths),
        "position_rmse_m": _spread(run.result["localization"]["position_rmse_m"] for run in runs),
        "real_time_factor": _spread(run.result["real_time_factor"] for run in runs),
        "phases": _phases(plants),
        "taxonomy": taxonomy(runs, failures),
        "failures": [asdict(failure) | {"conditions": dict(failure.conditions)} for failure in failures],
    }


def success(plants: Sequence[PlantRun]) -> dict[str, Any]:
    """How many of these plants hang, with the interval of the rate, and the median cycle."""
    hanging = sum(plant.hanging for plant in plants)
    cycles = [plant.cycle_s for plant in plants if plant.cycle_s is not None]
    return {
        "n": len(plants),
        "hanging": hanging,
        "rate": hanging / len(plants) if plants else None,
        "wilson95": _rounded(wilson95(hanging, len(plants))),
        "cycle_s_median": round(statistics.median(cycles), 3) if cycles else None,
    }


def quantile(values: Sequence[float], share: float) -> float:
    """The quantile of at least one value, between its neighbours by straight lines."""
    ordered = sorted(values)
    place = share * (len(ordered) - 1)
    low = int(place)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (place - low) * (ordered[high] - ordered[low])


def _condition_names(plants: Sequence[PlantRun]) -> list[str]:
    return list(dict.fromkeys(name for plant in plants for name in plant.conditions))


def _groups(plants: Sequence[PlantRun]) -> list[dict[str, Any]]:
    """One entry for each mode under each combination of conditions; what else was varied stands under `varied`."""
    members: dict[tuple[str, ...], list[PlantRun]] = {}
    for plant in plants:
        members.setdefault((plant.mode, *map(str, plant.conditions.values())), []).append(plant)
    return [
        {
            "mode": group[0].mode,
            **{name: group[0].conditions.get(name) for name in CONDITIONS},
            "varied": {name: value for name, value in group[0].conditions.items() if name not in CONDITIONS},
            **success(group),
        }
        for _, group in sorted(members.items())
    ]


def _by(plants: Sequence[PlantRun], name: str) -> list[dict[str, Any]]:
    """Success by the values of one condition, or by mode."""
    members: dict[str, list[PlantRun]] = {}
    for plant in plants:
        members.setdefault(str(plant.mode if name == "mode" else plant.conditions.get(name)), []).append(plant)
    return [{"value": value, **success(group)} for value, group in sorted(members.items())]


def confusion(checks: Iterable[Check]) -> dict[str, dict[str, Any]]:
    """What the robot said against what was so, by check.

    Returns:
        `positive`: what a yes means; `tp`, `fp` (it said yes and was wrong), `tn`, `fn`; where it also named the level
        on top in the feeder, how often that was `level_right` and `level_wrong`.
    """
    tables: dict[str, dict[str, Any]] = {}
    for check in checks:
        empty = {"positive": POSITIVE.get(check.name, "yes"), "tp": 0, "fp": 0, "tn": 0, "fn": 0}
        table = tables.setdefault(check.name, empty)
        table[("t" if check.said == check.true else "f") + ("p" if check.said else "n")] += 1
        if check.level_right is not None:
            for name in ("level_right", "level_wrong"):
                table.setdefault(name, 0)
            table["level_right" if check.level_right else "level_wrong"] += 1
    return tables


def _phases(plants: Sequence[PlantRun]) -> list[dict[str, Any]]:
    """Seconds by mode and action, in the order in which they come."""
    times: dict[tuple[str, str], list[float]] = {}
    for plant in plants:
        for phase, seconds in plant.phases_s.items():
            times.setdefault((plant.mode, phase), []).append(seconds)
    return [
        {
            "mode": mode,
            "phase": phase,
            "n": len(seconds),
            "median_s": round(quantile(seconds, 0.5), 3),
            "p90_s": round(quantile(seconds, 0.9), 3),
        }
        for (mode, phase), seconds in sorted(times.items(), key=lambda item: item[0][0])
    ]


def _counts(values: Iterable[Any]) -> dict[str, int]:
    found: dict[str, int] = {}
    for value in values:
        found[str(value)] = found.get(str(value), 0) + 1
    return found


def _spread(values: Iterable[float | None]) -> Mapping[str, float] | None:
    known = [value for value in values if value is not None]
    return {"median": round(statistics.median(known), 4), "max": max(known)} if known else None


def _rounded(interval: tuple[float, float]) -> list[float]:
    return [round(bound, 4) for bound in interval]
