"""The key `actions` of a mission file: defaults of goal fields, by the name of the node that has them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pydantic

from grape.bt.loader import load_tree
from grape.bt.ports import Direction, Leaf, Port, leaf_ports
from grape.bt.tree import Literal
from grape.config import Document, Model, validate_options
from grape.errors import FileError, InvalidInput, Problem, did_you_mean
from grape.mission.catalog import nodes

KEY = "actions"


def goal_defaults(
    given: Mapping[str, Mapping[str, Any]], task: str, tree: Path, document: Document
) -> tuple[dict[str, dict[str, Any]], list[Problem]]:
    """The values with the types of their fields, and what is wrong with them.

    Args:
        given: node -> field -> value, as the file has it.
        task: whose nodes are allowed.
        tree: the mission's tree file, in which the values must have an effect.
        document: tells where each value stands.
    """
    known = nodes(task) if given else {}
    checked: dict[str, dict[str, Any]] = {}
    problems: list[Problem] = []
    for name in given:
        if name not in known:
            problems.append(document.problem((KEY, name), "unknown node", ", ".join(known), did_you_mean(name, known)))
            continue
        try:
            checked[name] = _of_node(known[name], given[name], document)
        except FileError as error:
            problems += error.problems
    return checked, problems + _without_effect(checked, tree, known, document)


def _without_effect(
    checked: Mapping[str, Mapping[str, Any]], tree: Path, known: Mapping[str, Leaf], document: Document
) -> list[Problem]:
    """A problem for each value that no node of the tree takes; none for a tree that has problems of its own."""
    try:
        every = list(load_tree(tree, known).root.walk()) if checked else []
    except FileError:
        return []
    problems = []
    for name, values in checked.items():
        uses = [node for node in every if node.tag == name]
        if not uses:
            tags = {node.tag: None for node in every if node.leaf is not None}
            problems.append(document.problem((KEY, name), f"no node of {tree.name}", ", ".join(tags)))
        problems += [
            document.problem((KEY, name, port), f"{tree.name} sets this port at every {name}, and the tree wins")
            for port in values
            if uses and all(isinstance(node.inputs.get(port), Literal) for node in uses)
        ]
    return problems


def _of_node(leaf: Leaf, given: Mapping[str, Any], document: Document) -> dict[str, Any]:
    ports = {name: port for name, port in leaf_ports(leaf).items() if port.direction is not Direction.OUTPUT}
    fields = {name: (port.type, port.default) for name, port in ports.items() if not port.required and _plain(port)}
    always = [name for name in given if name in ports and ports[name].required]
    if always:
        raise FileError(
            document.problem((KEY, leaf.name, name), "the tree always gives this port", ", ".join(fields) or "no keys")
            for name in always
        )
    model: type[Model] = pydantic.create_model(leaf.name, __base__=Model, **fields)  # type: ignore[call-overload]
    options = validate_options(model, document, (KEY, leaf.name))
    values = {name: getattr(options, name) for name in given}
    if not any(port.required for port in ports.values()):
        try:
            leaf.goal_type(**values)
        except InvalidInput as error:
            raise FileError([document.problem((KEY, leaf.name), f"the goal is refused: {error}")]) from error
    return values


def _plain(port: Port) -> bool:
    """Whether a file can hold a value of the port's type."""
    try:
        pydantic.TypeAdapter(port.type)
    except pydantic.errors.PydanticSchemaGenerationError:
        return False
    return True
