"""`grape bench` behind its options: measure speeds beside their peers, show them, write them down."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape as plain
from rich.table import Table

from grape import __version__
from grape.errors import InvalidInput
from grape.mission.record import write_atomic
from grape.plugins import BENCHES, load
from grape.proof import Bench, Comparison
from grape.proving.show import figure, live_progress, verdict

SCHEMA = "grape.bench/1"


def bench_command(name: str, file: Path | None) -> None:
    """Measure as `grape bench` does.

    Raises:
        GrapeError: no such bench, or a file that cannot be written.
    """
    bench: Bench = load(BENCHES, name)
    if file is not None and not file.absolute().parent.is_dir():
        raise InvalidInput(f"--json {file}: its folder does not exist")
    console = Console()
    console.print(f"[bold]{name}[/]: {plain(bench.summary)}", highlight=False)
    with live_progress(console) as progress:
        rows = bench.run(progress)
    console.print(_table(name, rows))
    if file is not None:
        write_atomic(file, as_json(name, rows))
        console.print(f"written: {file}", highlight=False, soft_wrap=True)


def as_json(name: str, rows: Any) -> str:
    """The text of the JSON file."""
    content = {"schema": SCHEMA, "name": name, "grape": __version__, "rows": [_as_json(row) for row in rows]}
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _as_json(row: Comparison) -> dict[str, Any]:
    return {
        "quantity": row.quantity,
        "value": row.value,
        "unit": row.unit,
        "peer": row.peer,
        "peer_value": row.peer_value,
        "ratio": row.ratio,
        "ratio_goal": row.ratio_goal,
        "value_goal": row.value_goal,
        "met": row.met,
    }


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
        ratio = "" if row.ratio is None else f"x{row.ratio:.1f}"
        goals = [f"ratio {row.ratio_goal}"] if row.ratio_goal else []
        goals += [f"{row.value_goal} {row.unit}"] if row.value_goal else []
        peer_value = "" if row.peer_value is None else figure(row.peer_value, row.unit)
        cells = (row.quantity, figure(row.value, row.unit), row.peer, peer_value, ratio, ", ".join(goals))
        shown.add_row(*(plain(cell) for cell in cells), verdict(row.met))
    return shown
