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
    """Mission files of every task by name; by `task/name` where several tasks bring one name."""
    return _by_shortest_name(_brought("missions"))


def trees() -> dict[str, Path]:
    """Tree files of every task by name; by `task/name` where several tasks bring one name."""
    return _by_shortest_name(_brought("trees"))


def mission_file(name: str) -> Path | None:
    """The mission file of a name or `task/name`, None when no task brings it.

    Raises:
        PluginError: several tasks bring it.
    """
    return _the_one("mission", _brought("missions"), name)


def tree_file(name: str, task: str = "") -> Path | None:
    """The tree file of a name or `task/name`, None when no task brings it; a task's own tree comes first.

    Raises:
        PluginError: several tasks bring it, and not the one that is given.
    """
    brought = _brought("trees")
    return brought.get((task, name)) or _the_one("tree", brought, name)


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


def _brought(what: str) -> dict[tuple[str, str], Path]:
    """The files of every task that can be loaded, by task and name."""
    return {(task, name): path for task, brings in tasks().items() for name, path in getattr(brings, what).items()}


def _by_shortest_name(brought: Mapping[tuple[str, str], Path]) -> dict[str, Path]:
    shared = {name for _, name in brought if len(_files_of(brought, name)) > 1}
    return {f"{task}/{name}" if name in shared else name: path for (task, name), path in brought.items()}


def _the_one(what: str, brought: Mapping[tuple[str, str], Path], name: str) -> Path | None:
    task, _, own = name.rpartition("/")
    if (task, own) in brought:
        return brought[task, own]
    files = _files_of(brought, name)
    if len(files) > 1:
        found = find(TASKS)
        owners = " and ".join(f"{task!r} of {found[task].origin}" for task in files.values())
        ways = " or ".join(f"{task}/{name}" for task in files.values())
        raise PluginError(f"{what} {name!r} is brought by the tasks {owners}; name {ways}")
    return next(iter(files), None)


def _files_of(brought: Mapping[tuple[str, str], Path], name: str) -> dict[Path, str]:
    """The task that brings each file of a name."""
    return {path: task for (task, known), path in brought.items() if known == name}
