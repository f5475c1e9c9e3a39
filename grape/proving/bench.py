"""`grape bench` behind its options: measure speeds beside their peers, show them, write them down."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape as plain
from rich.table import Table

from grape import __version__
from grape.folders import refuse_unwritable_file
from grape.mission.page import document, section, table
from grape.mission.record import write_atomic
from grape.mission.svg import PALETTE, line_chart
from grape.plugins import BENCHES, load
from grape.proof import Bench, Comparison
from grape.proving.show import figure, live_progress, verdict

HEAD = ("quantity", "ours", "peer", "peer's", "ratio", "goal", "met")
_VERDICTS = {True: "yes", False: "no", None: ""}
SCHEMA = "grape.bench/1"


def bench_command(name: str, file: Path | None, html: Path | None = None) -> None:
    """Measure as `grape bench` does.

    Args:
        file: for programs. html: for people.

    Raises:
        GrapeError: no such bench, or a file that cannot be written.
    """
    bench: Bench = load(BENCHES, name)
    for option, path in (("--json", file), ("--html", html)):
        if path is not None:
            refuse_unwritable_file(option, path)
    console = Console()
    console.print(f"[bold]{name}[/]: {plain(bench.summary)}", highlight=False)
    with live_progress(console) as progress:
        rows = bench.run(progress)
    console.print(_table(name, rows))
    if file is not None:
        write_atomic(file, as_json(name, rows))
        console.print(f"written: {file}", markup=False, highlight=False, soft_wrap=True)
    if html is not None:
        write_atomic(html, page(bench, rows))
        console.print(f"written: {html}", markup=False, highlight=False, soft_wrap=True)


def as_json(name: str, rows: Any) -> str:
    """The text of the JSON file."""
    content = {"schema": SCHEMA, "name": name, "grape": __version__, "rows": [_as_json(row) for row in rows]}
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _as_json(row: Comparison) -> dict[str, Any]:
    return {
        "quantity": row.quantity,
        "at": row.at,
        "value": row.value,
        "unit": row.unit,
        "peer": row.peer,
        "peer_value": row.peer_value,
        "ratio": row.ratio,
        "ratio_goal": row.ratio_goal,
        "value_goal": row.value_goal,
        "met": row.met,
    }


def page(bench: Bench, rows: Sequence[Comparison]) -> str:
    """One page that needs no other file: a line for each quantity that was measured at several sizes, and the table."""
    head = f'<header><h1>{escape(bench.name)}</h1><p class="sub">{escape(bench.summary)}</p></header>'
    plots = [section(name, f'<div class="plot">{chart}</div>') for name, chart in _lines(rows)]
    cells = [[*(escape(cell) for cell in _cells(row)), _VERDICTS[row.met]] for row in rows]
    return document(f"grape bench {bench.name}", [head, *plots, section("Figures", table(HEAD, cells))])


def _lines(rows: Sequence[Comparison]) -> list[tuple[str, str]]:
    """Quantity and chart of all that was measured at several sizes."""
    names = dict.fromkeys(row.quantity for row in rows if row.at is not None)
    points = {
        name: [(row.at, row.value) for row in rows if row.quantity == name and row.at is not None] for name in names
    }
    units = {row.quantity: row.unit for row in rows}
    return [
        (name, line_chart([("", line, PALETTE[0])], x_title="size", y_title=units[name]))
        for name, line in points.items()
    ]


def _cells(row: Comparison) -> tuple[str, ...]:
    """A row of the table, without its verdict."""
    name = row.quantity if row.at is None else f"{row.quantity}, at {row.at:g}"
    ratio = "" if row.ratio is None else f"x{row.ratio:.{1 if row.ratio >= 1 else 2}f}"
    goals = [f"ratio {row.ratio_goal}"] if row.ratio_goal else []
    goals += [f"{row.value_goal} {row.unit}"] if row.value_goal else []
    peer_value = "" if row.peer_value is None else figure(row.peer_value, row.unit)
    return name, figure(row.value, row.unit), row.peer, peer_value, ratio, ", ".join(goals)


def _table(name: str, rows: Any) -> Table:
    shown = Table(title=name, title_justify="left")
    shown.add_column("quantity")
    shown.add_column("ours", justify="right")
    shown.add_column("peer")
    for column in ("peer's", "ratio"):
        shown.add_column(column, justify="right")
    for column in ("goal", "met"):
        shown.add_column(column)
    for row in rows:
        shown.add_row(*(plain(cell) for cell in _cells(row)), verdict(row.met))
    return shown
