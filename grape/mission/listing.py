"""`grape list`: what there is to name, from every plugin."""

from __future__ import annotations

import re
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from grape.config import load_yaml
from grape.errors import GrapeError
from grape.mission.catalog import benches, broken, experiments, missions, nodes, tasks, trees
from grape.plugins import BENCHES, BUILT_IN, EXPERIMENTS, GRAPE, find


def print_catalog(console: Console | None = None) -> None:
    """Print missions, rows, benches, trees, every other plugin, and the nodes of each task with their ports.

    What a package brings that is broken is named at the end, and keeps nothing else from being listed.
    """
    console = console or Console()
    wrong = list(broken())
    table = Table("mission", "what it does", title="Missions", title_justify="left")
    for name, path in missions().items():
        try:
            table.add_row(name, str(load_yaml(path).data.get("description", "")))
        except GrapeError as error:
            wrong.append(f"mission {name!r}: {error}")
    console.print(table)
    table = Table("name", "command", "what it measures", title="Proofs and benches", title_justify="left")
    for command, found in (("reproduce", experiments()), ("bench", benches())):
        for name in sorted(found, key=_natural):
            table.add_row(name, f"grape {command} {name}", escape(found[name].summary))
    console.print(table)
    console.print(f"[bold]Trees[/]: {', '.join(trees())}")
    for group in BUILT_IN:
        if group not in (EXPERIMENTS, BENCHES):
            console.print(f"[bold]{_title(group)}[/]: {', '.join(_names(group))}")
    for task in tasks():
        try:
            console.print(_nodes(task))
        except GrapeError as error:
            wrong.append(f"task {task!r}: {error}")
    for text in wrong:
        console.print(f"[red]error:[/] {escape(text)}")


def _title(group: str) -> str:
    """`Local planners` of `grape.local_planners`."""
    return group.removeprefix("grape.").replace("_", " ").capitalize()


def _names(group: str) -> list[str]:
    """Names of a group's plugins, with the distribution where it is not grape."""
    return [name if found.origin == GRAPE else f"{name} ({found.origin})" for name, found in find(group).items()]


def _natural(name: str) -> tuple[str | int, ...]:
    """G8 before G10."""
    return tuple(int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name))


def _nodes(task: str) -> Table:
    from grape.bt.ports import Direction, leaf_ports, type_name

    table = Table("node", "ports", "what it does", title=f"Nodes of task {task}", title_justify="left", show_lines=True)
    table.caption, table.caption_justify = "→ read (= default, where there is one), ← written, ↔ both", "left"
    arrows = {Direction.INPUT: "→", Direction.OUTPUT: "←", Direction.INOUT: "↔"}
    for name, leaf in nodes(task).items():
        ports = [
            f"{arrows[port.direction]} {port.name}: {type_name(port.type)}"
            + ("" if port.required or port.direction is Direction.OUTPUT else f" = {_default(port.default)}")
            for port in leaf_ports(leaf).values()
        ]
        table.add_row(name, "\n".join(ports), leaf.summary)
    return table


def _default(value: Any) -> str:
    """A default as short as it can be read."""
    if isinstance(value, tuple):
        return f"({', '.join(_default(item) for item in value)})"
    return f"{value:.4g}" if isinstance(value, float) else str(value) or "''"
