"""What can be named on the command line and in mission files: all of it comes from plugins, also of other packages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from grape.plugins import (
    BENCHES,
    BUILT_IN,
    EXPERIMENTS,
    ROBOTS,
    TASKS,
    WORLDS,
    PluginError,
    Task,
    WorldType,
    find,
    load,
)
from grape.proof import Bench, Experiment


def tasks() -> dict[str, Task]:
    """Every task that can be loaded, by name; `broken` tells of the others."""
    return _loadable(TASKS)


def experiments() -> dict[str, Experiment]:
    """Every experiment that can be loaded, by row."""
    return _loadable(EXPERIMENTS)


def benches() -> dict[str, Bench]:
    """Every bench that can be loaded, by name."""
    return _loadable(BENCHES)


def broken(groups: Iterable[str] = tuple(BUILT_IN)) -> tuple[str, ...]:
    """What is wrong with each plugin of these groups that cannot be loaded."""
    texts = []
    for group in groups:
        for plugin in find(group).values():
            try:
                plugin.load()
            except PluginError as error:
                texts.append(str(error))
    return tuple(texts)


def missions() -> dict[str, Path]:
    """Mission files of every task by name.

    Raises:
        PluginError: two tasks bring one name.
    """
    return _files("mission", {name: task.missions for name, task in tasks().items()})


def trees() -> dict[str, Path]:
    """Tree files of every task by name.

    Raises:
        PluginError: two tasks bring one name.
    """
    return _files("tree", {name: task.trees for name, task in tasks().items()})


def robots() -> tuple[str, ...]:
    """Names of the robots."""
    return tuple(find(ROBOTS))


def robot_description(name: str) -> Any:
    """The `RobotDescription` of a robot.

    Raises:
        PluginError: it is unknown or cannot be loaded.
    """
    return load(ROBOTS, name)


def worlds() -> tuple[str, ...]:
    """Names of the kinds of world."""
    return tuple(find(WORLDS))


def world_type(name: str) -> WorldType:
    """A kind of world.

    Raises:
        PluginError: it is unknown or cannot be loaded.
    """
    kind: WorldType = load(WORLDS, name)
    return kind


def nodes(task: str) -> dict[str, Any]:
    """Every action and condition that a tree of this task may use, by name.

    Raises:
        PluginError: the task is unknown or cannot be loaded.
        InvalidInput: two of its nodes have one name, or one is built in.
    """
    from grape.bt import node_library

    return dict(node_library(sorted(load(TASKS, task).leaves, key=lambda leaf: leaf.name)))


def _loadable(group: str) -> dict[str, Any]:
    found = {}
    for name, plugin in find(group).items():
        try:
            found[name] = plugin.load()
        except PluginError:
            continue
    return found


def _files(what: str, brought: Mapping[str, Mapping[str, Path]]) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for task, files in brought.items():
        for name, path in files.items():
            if found.setdefault(name, path) != path:
                owner = next(other for other, theirs in brought.items() if name in theirs)
                raise PluginError(f"{what} {name!r} is brought by the tasks {owner!r} and {task!r}; remove one")
    return found
