"""A loaded tree: every SubTree put in its place, every port resolved to a value or a blackboard entry, all checked.

It holds no state, so one `Tree` serves any number of missions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from grape.bt.ports import Leaf, Port


@dataclass(frozen=True, kw_only=True)
class Literal:
    """An input given as text in the tree file, already parsed."""

    value: Any


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An input that is read from a blackboard entry."""

    name: str


@dataclass(frozen=True, kw_only=True)
class Node:
    """One node of a loaded tree.

    Attributes:
        tag: name of the node type (`Sequence`, `DriveToPose`).
        path: names from the main tree down to this node, separated by '/', unique in the tree.
        leaf: the action or condition, None for a node type that is built in.
        outputs: output port -> blackboard entry, for the ports that the tree maps.
    """

    tag: str
    name: str
    path: str
    leaf: Leaf | None = None
    ports: Mapping[str, Port] = field(default_factory=dict)
    inputs: Mapping[str, Literal | Entry] = field(default_factory=dict)
    outputs: Mapping[str, str] = field(default_factory=dict)
    children: tuple[Node, ...] = ()

    def walk(self) -> Iterator[Node]:
        """This node and all below it, in the order of the file."""
        yield self
        for child in self.children:
            yield from child.walk()


@dataclass(frozen=True, kw_only=True)
class Tree:
    """A tree that passed every check.

    Attributes:
        constants: entries that SubTree attributes set to text before the first tick.
        inputs: entries of the main tree that the caller promised to set, with their types.
    """

    name: str
    file: str
    root: Node
    constants: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, Any] = field(default_factory=dict)
