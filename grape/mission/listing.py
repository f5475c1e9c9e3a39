"""`grape list`: what is built in."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from grape.config import load_yaml
from grape.mission.catalog import built_in, nodes, worlds


def print_catalog(console: Console | None = None) -> None:
    """Print missions, trees, robots, tasks, worlds and the nodes of each task with their ports."""
    console = console or Console()
    missions = Table("mission", "what it does", title="Missions", title_justify="left")
    for name, path in built_in("missions").items():
        missions.add_row(name, str(load_yaml(path).data.get("description", "")))
    console.print(missions)
    for kind in ("trees", "robots", "tasks"):
        console.print(f"[bold]{kind.capitalize()}[/]: {', '.join(built_in(kind))}")
    console.print(f"[bold]Worlds[/]: {', '.join(worlds())}")
    for task in built_in("tasks"):
        console.print(_nodes(task))


def _nodes(task: str) -> Table:
    from grape.bt.ports import Direction, leaf_ports, type_name

    table = Table("node", "ports", "what it does", title=f"Nodes of task {task}", title_justify="left", show_lines=True)
    arrows = {Direction.INPUT: "→", Direction.OUTPUT: "←", Direction.INOUT: "↔"}
    for name, leaf in nodes(task).items():
        ports = [
            f"{arrows[port.direction]} {port.name}: {type_name(port.type)}"
            + ("" if port.required or port.direction is Direction.OUTPUT else " (optional)")
            for port in leaf_ports(leaf).values()
        ]
        table.add_row(name, "\n".join(ports), leaf.summary)
    return table
