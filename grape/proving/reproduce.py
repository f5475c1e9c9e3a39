"""`grape reproduce` behind its options: run the experiment of a row, show its figures, write them down."""

from __future__ import annotations

import json
import math
from html import escape
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape as plain
from rich.table import Table

from grape import __version__
from grape.errors import InvalidInput, with_suggestion
from grape.folders import open_folder
from grape.mission.page import document, none, section, table
from grape.mission.record import write_atomic
from grape.plugins import EXPERIMENTS, find
from grape.proof import Experiment, Proof, Quantity, parse_seeds
from grape.proving.show import figure, live_progress, verdict

SCHEMA = "grape.reproduce/1"
DONE, STOPPED = 0, 130


def reproduce_command(row: str, seeds: str | None, out: Path | None) -> int:
    """Run an experiment as `grape reproduce` does; returns the exit code.

    Raises:
        GrapeError: no such row, malformed seeds, or a folder that cannot be used.
    """
    experiment = experiment_of(row)
    chosen = experiment.seeds if seeds is None else parse_seeds(seeds)
    folder = open_folder(out, f"reproduce-{experiment.row}")
    console = Console()
    console.print(f"[bold]{experiment.row}[/] on seeds {span(chosen)}: {plain(experiment.summary)}", highlight=False)
    stopped = f"stopped; `grape reproduce {experiment.row} --seeds {span(chosen)} --out {folder}` goes on"
    try:
        with live_progress(console) as progress:
            proof = experiment.run(chosen, folder, progress)
    except KeyboardInterrupt:
        console.print(stopped, markup=False, highlight=False, soft_wrap=True)
        raise
    write_atomic(folder / "reproduce.json", as_json(experiment, chosen, proof))
    write_atomic(folder / "reproduce.html", page(experiment, chosen, proof))
    console.print(_table(experiment, chosen, proof))
    for note in proof.notes:
        console.print(f"- {note}", markup=False, highlight=False)
    console.print(
        f"written: {folder / 'reproduce.json'}, reproduce.html", markup=False, highlight=False, soft_wrap=True
    )
    if not proof.complete:
        console.print(stopped, markup=False, highlight=False, soft_wrap=True)
    return DONE if proof.complete else STOPPED


def experiment_of(row: str) -> Experiment:
    """The experiment of a row, whatever the case of its letters.

    Raises:
        InvalidInput: there is none.
        PluginError: it cannot be imported.
    """
    found = {name.lower(): plugin for name, plugin in find(EXPERIMENTS).items()}
    if row.lower() not in found:
        rows = [plugin.name for plugin in found.values()]
        allowed = ", ".join(sorted(rows)) or "none"
        sentence = f"no experiment proves a row {row!r}; there are {allowed}"
        raise InvalidInput(with_suggestion(sentence, row.upper(), rows))
    experiment: Experiment = found[row.lower()].load()
    return experiment


def span(seeds: range) -> str:
    """Seeds as they are given on the command line."""
    return f"{seeds.start}:{seeds.stop}"


def as_json(experiment: Experiment, seeds: range, proof: Proof) -> str:
    """The text of reproduce.json."""
    content = {
        "schema": SCHEMA,
        "row": experiment.row,
        "summary": experiment.summary,
        "grape": __version__,
        "seeds": span(seeds),
        "complete": proof.complete,
        "quantities": [_as_json(quantity) for quantity in proof.quantities],
        "notes": list(proof.notes),
    }
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _as_json(quantity: Quantity) -> dict[str, Any]:
    ci95 = quantity.ci95
    return {
        "name": quantity.name,
        "unit": quantity.unit,
        "value": _finite(quantity.value),
        "n": int(quantity.n),
        "ci95": None if ci95 is None else [_finite(bound) for bound in ci95],
        "reference": quantity.reference,
        "goal": quantity.goal,
        "met": quantity.met,
    }


def _finite(value: float | None) -> float | None:
    """JSON has no NaN and no infinity."""
    return None if value is None or not math.isfinite(value) else float(value)


def page(experiment: Experiment, seeds: range, proof: Proof) -> str:
    """The text of reproduce.html: one page that needs no other file."""
    command = f"grape reproduce {experiment.row} --seeds {span(seeds)}"
    stopped = "" if proof.complete else " · stopped before its end"
    header = (
        f"<header><h1>{escape(experiment.row)}</h1><p>{escape(experiment.summary)}</p>"
        f'<p class="sub">{escape(command)} · grape {__version__}{stopped}</p></header>'
    )
    notes = "".join(f"<p>{escape(note)}</p>" for note in proof.notes)
    rows = [[escape(cell) for cell in _cells(quantity)] + [_badge(quantity)] for quantity in proof.quantities]
    head = ["quantity", "ours", "n", "95 % interval", "reference", "goal", "met"]
    figures = "".join(f'<h3>{escape(item.title)}</h3><div class="plot">{item.svg}</div>' for item in proof.figures)
    sections = [section("Figures", table(head, rows) + notes), section("Plots", figures or none("no plots"))]
    return document(f"{experiment.row}: {experiment.summary}", [header, *sections])


def _cells(quantity: Quantity) -> list[str]:
    interval = "" if quantity.ci95 is None else " … ".join(figure(bound) for bound in quantity.ci95)
    return [
        quantity.name,
        figure(quantity.value, quantity.unit),
        str(quantity.n),
        interval,
        quantity.reference,
        quantity.goal,
    ]


def _badge(quantity: Quantity) -> str:
    if quantity.met is None:
        return ""
    return f'<span class="badge {"ok" if quantity.met else "bad"}">{"yes" if quantity.met else "no"}</span>'


def _table(experiment: Experiment, seeds: range, proof: Proof) -> Table:
    shown = Table(title=f"{experiment.row}, seeds {span(seeds)}", title_justify="left")
    shown.add_column("quantity")
    for name in ("ours", "n", "95 % interval"):
        shown.add_column(name, justify="right")
    for name in ("reference", "goal", "met"):
        shown.add_column(name)
    for quantity in proof.quantities:
        shown.add_row(*(plain(cell) for cell in _cells(quantity)), verdict(quantity.met))
    return shown
