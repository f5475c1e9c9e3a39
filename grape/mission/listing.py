"""`grape list`: what there is to name, from every plugin."""

from __future__ import annotations

import re
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from grape.config import load_yaml
from grape.mission.catalog import benches, broken, experiments, missions, nodes, robots, tasks, trees, worlds


def print_catalog(console: Console | None = None) -> None:
    """Print missions, rows, benches, trees, robots, tasks, worlds and the nodes of each task with their ports."""
    console = console or Console()
    table = Table("mission", "what it does", title="Missions", title_justify="left")
    for name, path in missions().items():
        table.add_row(name, str(load_yaml(path).data.get("description", "")))
    console.print(table)
    table = Table("name", "command", "what it measures", title="Proofs and benches", title_justify="left")
    for command, found in (("reproduce", experiments()), ("bench", benches())):
        for name in sorted(found, key=_natural):
            table.add_row(name, f"grape {command} {name}", escape(found[name].summary))
    console.print(table)
    for kind, names in (("Trees", trees()), ("Robots", robots()), ("Tasks", tasks()), ("Worlds", worlds())):
        console.print(f"[bold]{kind}[/]: {', '.join(names)}")
    for task in tasks():
        console.print(_nodes(task))
    for text in broken():
        console.print(f"[red]error:[/] {escape(text)}")


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
