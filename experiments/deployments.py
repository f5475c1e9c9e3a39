"""Rows that whole missions prove: hanging on nails and vines (G12 to G14), checks (G9, G11, G15), Robì (G19).

All rows but G14 and G19 are read from the same missions. G14 serves the same vines of the same worlds by open loop, G19
the same plants with the second base. A row runs what is not there yet, so the first one asked for takes hours and the
others seconds.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from grape.experiments.quantities import count_of, median_of
from grape.proof import Experiment, Figure, Proof, Quantity, wilson95

if TYPE_CHECKING:
    from grape.campaign.command import CampaignRun
    from grape.campaign.plan import Plan
    from grape.campaign.reading import PlantRun, RunData

MISSION = "dispenser_deployment"
VARIATIONS = ("world.style=cordon,gobelet", "world.sun=noon,low,overcast")
SEEDS = range(500, 550)  # two nails and four vines each: 100 nails, and 100 vines of each style
Progress = Callable[[float, str], None]


@dataclass(frozen=True, kw_only=True)
class Missions:
    """Missions that rows share. Attributes: name: of their folder. settings: `KEY=VALUE` of each."""

    name: str
    settings: tuple[str, ...]

    def plan(self) -> Plan:
        from grape.campaign.plan import make_plan

        return make_plan(MISSION, self.settings, VARIATIONS)

    def folder(self, row: Path) -> Path:
        """Beside the folder of a row, for all rows there."""
        return row.absolute().parent / f"campaign-{self.name}"


FLAWED = ("plants=null", "arm_errors=1")
CLOSED = Missions(name="closed-loop", settings=(*FLAWED, "select={nails: 2, vines: 4}"))
UNCALIBRATED = "actions={CalibrateArm: {skip: true}}"  # the arm as it comes, as the field trials of open loop had it
OPEN = Missions(
    name="open-loop",
    settings=(*FLAWED, UNCALIBRATED, "dispensers=6", "select={vines: 4, vine_mode: plant_open_loop}"),
)

ROBI = Missions(name="second-base", settings=(*FLAWED, "robot=robi_jaco2", "select={nails: 2, vines: 4}"))


def run(missions: Missions, seeds: Sequence[int], folder: Path, progress: Progress) -> tuple[CampaignRun, bool]:
    """The missions of these seeds, on all cores, as far as they are not there; and whether that is all of them.

    While another process runs them, those that are done are read.
    """
    from grape.campaign.command import run_campaign
    from grape.campaign.engines import LocalEngine
    from grape.mission.command import Cancellation
    from grape.mission.lock import FolderBusy

    shared, cancellation = missions.folder(folder), Cancellation()
    shared.mkdir(parents=True, exist_ok=True)
    try:
        with cancellation.listening():
            done = run_campaign(
                missions.plan(), _span(seeds), shared, LocalEngine, len(os.sched_getaffinity(0)), cancellation,
                show=lambda standing: progress(len(standing.done) / len(standing.jobs), standing.line),
            )  # fmt: skip
    except FolderBusy:
        return read(missions, seeds, folder), False
    return done, not cancellation()


def read(missions: Missions, seeds: Sequence[int], folder: Path) -> CampaignRun:
    """Those of the missions of these seeds that are done; none is run."""
    from grape.campaign.command import read_campaign

    return read_campaign(missions.plan(), _span(seeds), missions.folder(folder))


def _span(seeds: Sequence[int]) -> range:
    return range(seeds[0], seeds[-1] + 1)


def hanging(
    missions: Missions,
    mode: str,
    beside: tuple[Missions, str] | None,
    goals: Mapping[str, str],
    seeds: Sequence[int],
    folder: Path,
    progress: Progress,
) -> Proof:
    """How many dispensers hang, whether the account is right, forces and times.

    Args:
        mode: of the plants that count.
        beside: missions and mode to be shown beside, on the same plants, as far as they are there.
        goals: of `rate` and `cycle`.
    """
    done, complete = run(missions, seeds, folder, progress)
    plants = [plant for mission in done.runs for plant in mission.plants if plant.mode == mode]
    others = {} if beside is None else _by_place(read(beside[0], seeds, folder).runs, beside[1])
    pairs = [(plant, others[plant.seed, plant.plant]) for plant in plants if (plant.seed, plant.plant) in others]
    quantities = (
        *_by_style("hang by the referee", plants, goals.get("rate", "")),
        *_by_style(f"{beside[1]} on the same plants" if beside else "", [other for _, other in pairs], ""),
        *_accounted(done, plants),
        _cycle("base stop to arm retracted", plants, goals.get("cycle", "")),
        *_touched(done, plants),
    )
    figures = (_figure("Plants that hang", plants), *([_paired(pairs, mode, beside[1])] if beside and pairs else []))
    return Proof(quantities=quantities, figures=figures, notes=_notes(done, seeds, plants), complete=complete)


def second_base(seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """What hangs, the account, touches, times and the estimate, in missions on the other base."""
    done, complete = run(ROBI, seeds, folder, progress)
    plants = [plant for mission in done.runs for plant in mission.plants]
    nails, vines = ([plant for plant in plants if plant.mode == mode] for mode in ("nail", "plant"))
    errors = [mission.result["localization"]["position_rmse_m"] for mission in done.runs]
    quantities = (
        *_by_style("nails that hang by the referee", nails, ">= 0.97"),
        *_by_style("vines that hang by the referee", vines, ">= 0.90"),
        *_accounted(done, plants),
        _cycle("nails, base stop to arm retracted", nails, "<= 75"),
        _cycle("vines, base stop to arm retracted", vines, "<= 100"),
        *_touched(done, plants),
        count_of("fences crossed", [mission.result["truth"]["fence_crossings"] for mission in done.runs], "= 0"),
        median_of("position error of a mission, root mean square", "m", errors),
    )
    figures = (_figure("Plants that hang", plants),)
    return Proof(quantities=quantities, figures=figures, notes=_notes(done, seeds, plants), complete=complete)


def _accounted(done: CampaignRun, plants: Sequence[PlantRun]) -> tuple[Quantity, ...]:
    agreeing = sum(plant.agrees for plant in plants)
    return (
        Quantity(
            name="account agrees with the referee", unit="1", value=agreeing / len(plants) if plants else None,
            n=len(plants), ci95=wilson95(agreeing, len(plants)), goal=">= 0.99",
        ),
        Quantity(
            name="lost unnoticed", unit="1", value=done.summary["lost_unnoticed"] if plants else None, n=len(plants),
            goal="= 0",
        ),
    )  # fmt: skip


def _cycle(name: str, plants: Sequence[PlantRun], goal: str) -> Quantity:
    cycles = [plant.cycle_s for plant in plants if plant.cycle_s is not None]
    return replace(median_of(name, "s", cycles), reference="11–36 s by hand", goal=goal)


def _touched(done: CampaignRun, plants: Sequence[PlantRun]) -> tuple[Quantity, ...]:
    return (
        Quantity(
            name="hardest touch of a plant", unit="N", value=done.summary["max_plant_force_n"], n=len(done.runs),
            goal="<= 20",
        ),
        Quantity(
            name="pairs of parts that collided", unit="1", value=done.summary["collisions"] if plants else None,
            n=len(done.runs), goal="= 0",
        ),
    )  # fmt: skip


def _by_place(runs: Sequence[RunData], mode: str) -> dict[tuple[int, str], PlantRun]:
    return {(plant.seed, plant.plant): plant for run in runs for plant in run.plants if plant.mode == mode}


def _by_style(name: str, plants: Sequence[PlantRun], goal: str) -> list[Quantity]:
    """Rate and interval for each style of vines."""
    from grape.campaign.summary import success

    found = []
    for style in sorted({str(plant.conditions["style"]) for plant in plants}):
        entry = success([plant for plant in plants if plant.conditions["style"] == style])
        ci95 = wilson95(entry["hanging"], entry["n"])
        found.append(
            Quantity(name=f"{name}, {style}", unit="1", value=entry["rate"], n=entry["n"], ci95=ci95, goal=goal)
        )
    return found


def _figure(title: str, plants: Sequence[PlantRun]) -> Figure:
    """Rates by style and light."""
    from grape.campaign.summary import success
    from grape.mission.svg import interval_chart

    rows = []
    for name in ("style", "light"):
        for value in sorted({str(plant.conditions[name]) for plant in plants}):
            entry = success([plant for plant in plants if plant.conditions[name] == value])
            text = f"{entry['hanging']} of {entry['n']}"
            rows.append((f"{name}: {value}", entry["rate"], tuple(entry["wilson95"]), text))
    return Figure(title=title, svg=interval_chart(rows))


def _paired(pairs: Sequence[tuple[PlantRun, PlantRun]], mode: str, other: str) -> Figure:
    """Two modes on the same plants: how often both, one or none hang."""
    from grape.mission.svg import interval_chart

    kinds = ((True, True, "both hang"), (True, False, f"only {mode} hangs"), (False, True, f"only {other} hangs"))
    rows = []
    for first, second, name in (*kinds, (False, False, "none hangs")):
        number = sum((one.hanging, two.hanging) == (first, second) for one, two in pairs)
        share = number / len(pairs)
        rows.append((name.replace("_", " "), share, wilson95(number, len(pairs)), f"{number} of {len(pairs)}"))
    return Figure(title="On the same plants of the same worlds", svg=interval_chart(rows))


def _notes(done: CampaignRun, seeds: Sequence[int], plants: Sequence[PlantRun]) -> tuple[str, ...]:
    counted = {(plant.seed, plant.plant) for plant in plants}
    causes: dict[str, int] = {}
    for failure in done.summary["failures"]:
        if (failure["seed"], failure["plant"]) in counted:
            cause = f"{failure['action']} {failure['reason']}"
            causes[cause] = causes.get(cause, 0) + 1
    lost = ", ".join(f"{cause} ({number})" for cause, number in sorted(causes.items(), key=lambda item: -item[1]))
    missing = done.summary["without_result"]
    return (
        f"{len(done.runs)} of {len(seeds)} missions, in {done.folder}; each failure with its picture and command:"
        " report.html there. Missions that were there already are read and not run again.",
        *((f"Plants lost by: {lost}.",) if lost else ()),
        *((f"No result: seeds {missing}.",) if missing else ()),
    )


def checks(name: str, seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """How often a check of the robot said yes or no and was wrong, in the missions that prove the hanging."""
    from grape.campaign.summary import confusion

    done, complete = run(CLOSED, seeds, folder, progress)
    others = read(OPEN, seeds, folder).runs
    cells = confusion([check for mission in (*done.runs, *others) for check in mission.checks if check.name == name])
    found = cells.get(name, {"positive": "", "tp": 0, "fp": 0, "tn": 0, "fn": 0})
    quantities = [
        _wrong("said yes and was wrong", found["fp"], found["tp"] + found["fp"], "<= 0.01"),
        _wrong("said no and was wrong", found["fn"], found["tn"] + found["fn"], ""),
        _wrong("said yes where it was not so", found["fp"], found["fp"] + found["tn"], ""),
    ]
    if name == "feeder":
        right, wrong = found.get("level_right", 0), found.get("level_wrong", 0)
        quantities.append(_wrong("named a level that was not on top", wrong, right + wrong, "<= 0.01"))
    plants = [plant for mission in (*done.runs, *others) for plant in mission.plants]
    notes = (
        f"A yes means: {found['positive']}. Looks in {len(done.runs)} missions in closed loop and {len(others)} in open"
        " loop, judged by the referee at the moment of the look.",
    )
    figures = (_figure("Plants that hang in these missions", plants),)
    return Proof(quantities=tuple(quantities), figures=figures, notes=notes, complete=complete)


def _wrong(name: str, wrong: int, said: int, goal: str) -> Quantity:
    value = wrong / said if said else None
    return Quantity(name=name, unit="1", value=value, n=said, ci95=wilson95(wrong, said), goal=goal)


def _hanging(
    row: str, summary: str, missions: Missions, mode: str, beside: tuple[Missions, str] | None, **goals: str
) -> Experiment:
    return Experiment(row=row, summary=summary, seeds=SEEDS, run=partial(hanging, missions, mode, beside, goals))


def _checks(row: str, name: str) -> Experiment:
    summary = f"The {name} check held against the referee, in missions under changing light."
    return Experiment(row=row, summary=summary, seeds=SEEDS, run=partial(checks, name))


G12 = _hanging(
    "G12-hanging", "100 dispensers on nails, servoed by markers.", CLOSED, "nail", None, rate=">= 0.97", cycle="<= 75"
)
G13 = _hanging(
    "G13-hanging", "200 dispensers on vines, servoed by camera.", CLOSED, "plant", (OPEN, "plant_open_loop"),
    rate=">= 0.90", cycle="<= 100",
)  # fmt: skip
G14 = _hanging("G14", "200 dispensers on vines by the scan alone.", OPEN, "plant_open_loop", (CLOSED, "plant"))
G9, G11, G15 = _checks("G9", "feeder"), _checks("G11", "grasp"), _checks("G15", "deployment")
G19 = Experiment(
    row="G19", summary="Dispensers on nails and vines with Robì, the second base.", seeds=SEEDS, run=second_base
)
