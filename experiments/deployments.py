"""Rows that whole missions prove: hanging on nails and vines (G12 to G14), and the robot's checks (G9, G11, G15)."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from grape.proof import Experiment, Figure, Proof, Quantity, wilson95

MISSION = "dispenser_deployment"
FLAWED = ("plants=null", "arm_errors=1", "dispensers=6")  # fewer loops in the feeder: a quicker simulation
NAILS = (*FLAWED, "select={nails: 4}")
VINES = (*FLAWED, "select={vines: 4}")
OPEN_LOOP = (*FLAWED, "select={vines: 4, vine_mode: plant_open_loop}")
BOTH = (*FLAWED, "select={nails: 2, vines: 2}")
LIGHTS = "world.sun=noon,low,overcast"
STYLES = "world.style=cordon,gobelet"
Progress = Callable[[float, str], None]


def campaign(
    settings: Sequence[str], variations: Sequence[str], seeds: Sequence[int], folder: Path, progress: Progress
) -> Mapping[str, Any]:
    """The content of campaign.json of missions on all cores, below `folder`."""
    from grape.campaign.command import run_campaign
    from grape.campaign.engines import LocalEngine
    from grape.campaign.plan import make_plan

    folder = folder / "campaign"
    folder.mkdir(exist_ok=True)
    plan, span = make_plan(MISSION, settings, variations), range(seeds[0], seeds[-1] + 1)
    workers = len(os.sched_getaffinity(0))
    done = run_campaign(
        plan, span, folder, LocalEngine, workers,
        show=lambda standing: progress(len(standing.done) / len(standing.jobs), standing.line),
    )  # fmt: skip
    return done.summary


def deployments(
    settings: Sequence[str],
    goals: Mapping[str, str],
    seeds: Sequence[int],
    folder: Path,
    progress: Progress,
) -> Proof:
    """How many dispensers hang, whether the account is right, forces and times.

    Args:
        settings: which plants are served.
        goals: of `rate` and `cycle`.
    """
    summary = campaign(settings, (STYLES, LIGHTS), seeds, folder, progress)
    styles = [_hanging(f"hang by the referee, {entry['value']}", entry, goals) for entry in summary["by"]["style"]]
    total, agreeing = summary["total"], summary["account_agreement"]
    quantities = (
        *styles,
        Quantity(
            name="account agrees with the referee", unit="1", value=agreeing, n=total["n"],
            ci95=tuple(summary["account_agreement_wilson95"]), goal=">= 0.99",
        ),
        Quantity(name="lost unnoticed", unit="1", value=summary["lost_unnoticed"], n=total["n"], goal="= 0"),
        Quantity(
            name="base stop to arm retracted, median", unit="s", value=total["cycle_s_median"], n=total["n"],
            reference="11–36 s by hand", goal=goals.get("cycle", ""),
        ),
        Quantity(
            name="hardest touch of a plant", unit="N", value=summary["max_plant_force_n"], n=summary["missions"],
            goal="<= 20",
        ),
    )  # fmt: skip
    return Proof(quantities=quantities, figures=(_figure(summary),), notes=_notes(summary))


def _hanging(name: str, entry: Mapping[str, Any], goals: Mapping[str, str]) -> Quantity:
    return Quantity(
        name=name,
        unit="1",
        value=entry["rate"],
        n=entry["n"],
        ci95=tuple(entry["wilson95"]),
        goal=goals.get("rate", ""),
    )


def checks(name: str, seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """How often a check of the robot said yes or no and was wrong."""
    summary = campaign(BOTH, (STYLES, LIGHTS), seeds, folder, progress)
    cells = summary["checks"].get(name, {"tp": 0, "fp": 0, "tn": 0, "fn": 0})
    quantities = (
        _wrong("said yes and was wrong", cells["fp"], cells["tp"] + cells["fp"], "<= 0.01"),
        _wrong("said no and was wrong", cells["fn"], cells["tn"] + cells["fn"], ""),
    )
    return Proof(quantities=quantities, figures=(_figure(summary),), notes=_notes(summary))


def _wrong(name: str, wrong: int, said: int, goal: str) -> Quantity:
    value = wrong / said if said else None
    return Quantity(name=name, unit="1", value=value, n=said, ci95=wilson95(wrong, said), goal=goal)


def _figure(summary: Mapping[str, Any]) -> Figure:
    from grape.mission.svg import interval_chart

    rows = [
        (f"{name}: {entry['value']}", entry["rate"], tuple(entry["wilson95"]), f"{entry['hanging']} of {entry['n']}")
        for name in ("mode", "style", "light")
        for entry in summary["by"].get(name, ())
    ]
    return Figure(title="Plants that hang", svg=interval_chart(rows))


def _notes(summary: Mapping[str, Any]) -> tuple[str, ...]:
    causes = [f"{row['action']} {row['reason']} ({row['plants']})" for row in summary["taxonomy"] if row["plants"]]
    notes = [f"{summary['missions']} missions; each failure with its picture and command: campaign/report.html."]
    notes += [f"Plants lost by: {', '.join(causes)}."] if causes else []
    notes += [f"No result: seeds {summary['without_result']}."] if summary["without_result"] else []
    return tuple(notes)


def _deployments(row: str, summary: str, settings: Sequence[str], seeds: range, **goals: str) -> Experiment:
    return Experiment(row=row, summary=summary, seeds=seeds, run=partial(deployments, settings, goals))


def _checks(row: str, name: str) -> Experiment:
    summary = f"The {name} check held against the referee, in missions under changing light."
    return Experiment(row=row, summary=summary, seeds=range(500, 525), run=partial(checks, name))


G12 = _deployments(
    "G12-hanging",
    "100 dispensers on nails, in missions of four.",
    NAILS,
    range(500, 525),
    rate=">= 0.97",
    cycle="<= 75",
)
G13 = _deployments(
    "G13-hanging", "200 dispensers on vines, servoed by camera.", VINES, range(500, 550), rate=">= 0.90", cycle="<= 100"
)
G14 = _deployments("G14", "200 dispensers on vines by the scan alone.", OPEN_LOOP, range(500, 550))
G9, G11, G15 = _checks("G9", "feeder"), _checks("G11", "grasp"), _checks("G15", "deployment")
