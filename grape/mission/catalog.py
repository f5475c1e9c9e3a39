"""What is built in: missions, trees, robots, tasks and worlds, found by looking into their packages."""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

Kind = Literal["missions", "trees", "robots", "tasks"]


@dataclass(frozen=True, kw_only=True)
class WorldType:
    """A kind of generated world: its options, the site it lays out, and how it grows on a site."""

    options: type[Any]
    site: Callable[[Any], Any]
    grow: Callable[[Any, Any], Any]


def built_in(kind: str) -> dict[str, Path]:
    """Name -> file (missions, trees) or folder (robots, tasks)."""
    if kind == "trees":
        return {path.stem: path for path in sorted(_folder("grape.trees").glob("*.xml"))}
    if kind == "missions":
        return {path.stem: path for path in sorted(_folder("grape.tasks").glob("*/missions/*.yaml"))}
    folders = sorted(path.parent for path in _folder(f"grape.{kind}").glob("*/__init__.py"))
    return {path.name: path for path in folders}


def worlds() -> dict[str, WorldType]:
    """Every kind of world by its `type`."""
    from grape.sim.worlds.options import VineyardOptions
    from grape.sim.worlds.vineyard import grow_world, vineyard_site

    return {"vineyard": WorldType(options=VineyardOptions, site=vineyard_site, grow=grow_world)}


def robot_description(name: str) -> Any:
    """The `DESCRIPTION` of a built-in robot."""
    return importlib.import_module(f"grape.robots.{name}").DESCRIPTION


def _folder(package: str) -> Path:
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return Path("/nonexistent")
    return Path(spec.origin).parent


def nodes(task: str) -> dict[str, Any]:
    """Every action and condition that a tree of this task may use, by name: those of grape and those of the task."""
    from grape.actions.core import Action, Condition
    from grape.bt import node_library

    modules = [*_modules("grape.actions"), *_modules(f"grape.tasks.{task}")]
    leaves = {id(leaf): leaf for m in modules for leaf in vars(m).values() if isinstance(leaf, Action | Condition)}
    return dict(node_library(sorted(leaves.values(), key=lambda leaf: leaf.name)))


def _modules(package: str) -> list[Any]:
    root = importlib.import_module(package)
    names = sorted(info.name for info in pkgutil.walk_packages(root.__path__, f"{package}."))
    return [root, *(importlib.import_module(name) for name in names)]
