"""Loads behaviour trees from BehaviorTree.CPP v4 XML and reports everything that is wrong, with its place, at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

from grape.bt.builtin import BUILTIN
from grape.bt.definitions import Definitions, gather
from grape.bt.expand import Expander, Flow, TooLarge, Use, find_cycles, never_written, type_conflicts
from grape.bt.merge import too_large_together
from grape.bt.nodes_model import check_model
from grape.bt.parse import EXPLICIT, Parsed, Parser
from grape.bt.ports import Leaf, leaf_ports
from grape.bt.tree import Node, Tree
from grape.errors import MOST_PROBLEMS, FileError, InvalidInput, Problem


def node_library(leaves: Iterable[Leaf]) -> Mapping[str, Leaf]:
    """Actions and conditions by the name they have in tree files.

    Raises:
        InvalidInput: two have one name, a name is taken by a built-in node, or a port cannot be written in a file.
    """
    library: dict[str, Leaf] = {}
    for leaf in leaves:
        if leaf.name in BUILTIN or leaf.name in EXPLICIT or leaf.name == "SubTree":
            raise InvalidInput(f"{leaf.name!r} is a built-in node; choose another name")
        if library.setdefault(leaf.name, leaf) is not leaf:
            raise InvalidInput(f"two nodes are called {leaf.name!r}")
        leaf_ports(leaf)
    return MappingProxyType(library)


def load_tree(
    path: Path,
    nodes: Mapping[str, Leaf],
    *,
    main: str | None = None,
    inputs: Mapping[str, Any] | None = None,
) -> Tree:
    """Read, check and expand a tree file.

    Args:
        nodes: actions and conditions, from `node_library`.
        main: ID of the tree to run instead of the file's main_tree_to_execute.
        inputs: entries of the main tree that will be set before the first tick, with their types.

    Raises:
        FileError: with every problem of the file and of the files it includes.
    """
    tree, problems = _load(path, nodes, main, dict(inputs or {}))
    if problems or tree is None:
        raise FileError(problems)
    return tree


def check_tree(
    path: Path, nodes: Mapping[str, Leaf], *, inputs: Mapping[str, Any] | None = None
) -> tuple[Problem, ...]:
    """Every problem of a tree file, sorted by place; empty when it can be loaded."""
    return tuple(sorted(_load(path, nodes, None, dict(inputs or {}))[1]))


def _load(
    path: Path, nodes: Mapping[str, Leaf], main: str | None, inputs: dict[str, Any]
) -> tuple[Tree | None, set[Problem]]:
    found = gather(path, main)
    parser = Parser(nodes, found.trees)
    parsed = {name: parser.tree(element) for name, element in found.trees.items()}
    problems = found.problems | parser.problems | set(too_large_together(found))
    for model in found.models:
        problems |= set(islice(check_model(model, nodes), MOST_PROBLEMS))
    cycles = find_cycles(parsed)
    if cycles or found.main is None:
        return None, problems | cycles
    root, constants, more = _expand(found, found.main, parsed, inputs, clean=not problems)
    problems |= more
    if root is None:
        return None, problems
    return Tree(name=found.main, file=str(path), root=root, constants=constants, inputs=inputs), problems


def _expand(
    found: Definitions, main: str, parsed: Mapping[str, Parsed | None], inputs: Mapping[str, Any], clean: bool
) -> tuple[Node | None, Mapping[str, str], set[Problem]]:
    """Expand the main tree; what depends on every node being known is only checked when all are."""
    expander = Expander(parsed)
    try:
        root = expander.expand(main)
    except TooLarge as error:
        return None, {}, {found.trees[main].problem(str(error))}
    problems = type_conflicts(_with_inputs(expander.flow, inputs, found.trees[main]))
    if clean:
        problems |= expander.unused | never_written(expander.flow, inputs)
    return root, expander.constants, problems


def _with_inputs(flow: Flow, inputs: Mapping[str, Any], element: Any) -> Flow:
    given = {key: [Use(element=element, port=key, key=key, type=kind)] for key, kind in inputs.items()}
    return Flow(reads=flow.reads, writes={k: given.get(k, []) + flow.writes.get(k, []) for k in {*given, *flow.writes}})
