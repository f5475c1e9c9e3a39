"""The dispenser task as a plugin: complete, and every node of it has a place."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

import pytest

from grape.actions.core import Action, Condition
from grape.bt import load_tree, node_library
from grape.plugins import TASKS, load
from grape.tasks.dispenser import TASK


def declared(package: str) -> Iterator[Action | Condition]:
    root = importlib.import_module(package)
    for info in pkgutil.walk_packages(root.__path__, f"{package}."):
        for value in vars(importlib.import_module(info.name)).values():
            if isinstance(value, Action | Condition):
                yield value


def test_it_is_the_plugin_of_its_name() -> None:
    assert load(TASKS, TASK.name) is TASK


@pytest.mark.parametrize("package", ["grape.actions", "grape.tasks.dispenser"])
def test_every_node_that_is_declared_is_offered(package: str) -> None:
    assert {leaf.name for leaf in declared(package)} <= {leaf.name for leaf in TASK.leaves}


def test_every_node_has_a_summary_and_a_name_of_its_own() -> None:
    library = node_library(TASK.leaves)
    assert len(library) == len(TASK.leaves)
    assert [name for name, leaf in library.items() if not leaf.summary.endswith(".")] == []


def test_its_files_exist_and_its_trees_load() -> None:
    assert TASK.missions and all(path.is_file() for path in TASK.missions.values())
    assert TASK.trees
    for path in TASK.trees.values():
        load_tree(path, node_library(TASK.leaves))
