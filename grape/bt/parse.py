"""Checks one element of a tree file against its node type and splits its attributes into literals, reads and writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from grape.actions.core import Action
from grape.bt.blackboard import reference
from grape.bt.builtin import BUILTIN, Builtin, Category
from grape.bt.ports import Direction, Leaf, Port, leaf_ports, parse_literal, type_name
from grape.errors import MOST_PROBLEMS, InvalidInput, Problem, did_you_mean
from grape.xml_document import Element

EXPLICIT = {"Action", "Condition", "Control", "Decorator"}
IGNORED = {"name", "_uid", "_description", "_fullpath"}  # written by editors, without meaning for a run


@dataclass(kw_only=True)
class Parsed:
    """One element, understood as far as it is right."""

    element: Element
    tag: str
    name: str
    leaf: Leaf | None = None
    ports: Mapping[str, Port] = field(default_factory=dict)
    literals: dict[str, Any] = field(default_factory=dict)
    reads: dict[str, str] = field(default_factory=dict)  # port -> key
    writes: dict[str, str] = field(default_factory=dict)  # port -> key
    texts: dict[str, str] = field(default_factory=dict)  # SubTree: key inside -> text
    autoremap: bool = False
    children: list[Parsed] = field(default_factory=list)


class Parser:
    """Parses the elements of all trees of a file.

    Args:
        nodes: actions and conditions by the name they have in tree files.
        trees: every tree definition by ID.
    """

    def __init__(self, nodes: Mapping[str, Leaf], trees: Mapping[str, Element]) -> None:
        self._nodes = nodes
        self._trees = trees
        self.problems: set[Problem] = set()

    def tree(self, definition: Element) -> Parsed | None:
        """The one node below a `BehaviorTree` element; nothing is looked at any more when there are many problems."""
        for name in definition.attributes:
            if name != "ID" and name not in IGNORED:
                self.problems.add(definition.problem(f"unknown attribute {name!r}", "ID", "", name))
        self._children(definition, 1, 1)
        parsed = [node for child in definition.children if (node := self._node(child)) is not None]
        return parsed[0] if parsed else None

    def _node(self, element: Element) -> Parsed | None:
        if len(self.problems) >= MOST_PROBLEMS:
            return None
        tag = self._type(element)
        if tag is None:
            for child in element.children:
                self._node(child)
            return None
        parsed = Parsed(element=element, tag=tag, name=element.attributes.get("name") or tag)
        if tag == "SubTree":
            self._subtree(element, parsed)
        elif tag in BUILTIN:
            self._builtin(element, BUILTIN[tag], parsed)
        else:
            self._leaf(element, self._nodes[tag], parsed)
        parsed.children = [node for child in element.children if (node := self._node(child)) is not None]
        return parsed

    def _type(self, element: Element) -> str | None:
        tag, attribute = element.tag, ""
        if tag in EXPLICIT:
            attribute = "ID"
            if "ID" not in element.attributes:
                self.problems.add(element.problem("ID is missing", 'ID="NodeType"'))
                return None
            tag = element.attributes["ID"]
        if tag == "SubTree" or tag in BUILTIN or tag in self._nodes:
            if attribute and element.tag != self._category(tag):
                self.problems.add(element.problem(f"{tag!r} is no {element.tag}", self._category(tag), "", "ID"))
            return tag
        hint = did_you_mean(tag, [*BUILTIN, *self._nodes, "SubTree"])
        if tag in self._trees:
            hint = f'a tree is called with <SubTree ID="{tag}"/>'
        self.problems.add(
            element.problem(
                f"unknown node {tag!r}",
                "a node that `grape list` shows for the task (`task` of a mission, `--task` of `grape check`)",
                hint,
                attribute,
            )
        )
        return None

    def _category(self, tag: str) -> str:
        if tag in BUILTIN:
            return str(BUILTIN[tag].category)
        return "Action" if tag in self._nodes and isinstance(self._nodes[tag], Action) else "Condition"

    def _builtin(self, element: Element, builtin: Builtin, parsed: Parsed) -> None:
        parsed.ports = builtin.ports
        self._ports(element, parsed, plain_outputs=True)
        fewest, most = {Category.CONTROL: (1, None), Category.DECORATOR: (1, 1), Category.ACTION: (0, 0)}[
            builtin.category
        ]
        self._children(element, fewest, most)
        for port, value in parsed.literals.items():
            if type(value) is int and value < builtin.minimum and not (builtin.endless and value == -1):
                allowed = f"at least {builtin.minimum}" + (", or -1 for without end" if builtin.endless else "")
                self.problems.add(element.problem(f"{port} is {value}", allowed, "", port))
            if element.tag == "Parallel" and type(value) is int and value > len(element.children):
                got = f"{port} is {value}, but there are {len(element.children)} children"
                self.problems.add(element.problem(got, f"at most {len(element.children)}", "", port))

    def _leaf(self, element: Element, leaf: Leaf, parsed: Parsed) -> None:
        parsed.leaf, parsed.ports = leaf, leaf_ports(leaf)
        before = len(self.problems)
        self._ports(element, parsed)
        self._children(element, 0, 0)
        if len(self.problems) == before and not parsed.reads:
            try:
                leaf.goal_type(**parsed.literals)
            except InvalidInput as error:
                self.problems.add(element.problem(f"the goal is refused: {error}"))

    def _ports(self, element: Element, parsed: Parsed, plain_outputs: bool = False) -> None:
        for name, text in element.attributes.items():
            if name in IGNORED or (name == "ID" and element.tag in EXPLICIT):
                continue
            port = parsed.ports.get(name)
            if port is None:
                self._unknown(element, name, parsed.ports)
            else:
                self._value(element, port, text, parsed, plain_outputs)
        for port in parsed.ports.values():
            must = port.required or (plain_outputs and port.direction is Direction.OUTPUT)
            if must and port.name not in element.attributes:
                got = f"port {port.name!r} is missing"
                self.problems.add(element.problem(got, f"{port.name}=... ({type_name(port.type)})"))

    def _unknown(self, element: Element, name: str, ports: Mapping[str, Port]) -> None:
        if name.startswith("_"):
            self.problems.add(
                element.problem(f"{name!r} is not supported", "conditions as nodes of their own", "", name)
            )
            return
        allowed = ", ".join(ports) if ports else "no ports"
        self.problems.add(element.problem(f"unknown port {name!r}", allowed, did_you_mean(name, ports), name))

    def _value(self, element: Element, port: Port, text: str, parsed: Parsed, plain_outputs: bool) -> None:
        try:
            key = reference(text, port.name)
            if key is None and plain_outputs and port.direction is Direction.OUTPUT:
                key = reference(f"{{{text}}}", port.name)
            if key is None and port.direction is not Direction.INPUT:
                raise InvalidInput(f"port {port.name!r} is written, got the text {text!r}; give an entry as {{key}}")
            if key is None:
                parsed.literals[port.name] = parse_literal(text, port.type)
                return
        except InvalidInput as error:
            self.problems.add(element.problem(f"{port.name}: {error}", type_name(port.type), "", port.name))
            return
        if port.direction is not Direction.OUTPUT:
            parsed.reads[port.name] = key
        if port.direction is not Direction.INPUT:
            parsed.writes[port.name] = key

    def _subtree(self, element: Element, parsed: Parsed) -> None:
        self._children(element, 0, 0)
        target = element.attributes.get("ID", "")
        if target not in self._trees:
            hint = did_you_mean(target, self._trees)
            got = f"no tree {target!r}" if target else "ID is missing"
            self.problems.add(element.problem(got, ", ".join(sorted(self._trees)), hint, "ID"))
        parsed.tag, parsed.name = target, element.attributes.get("name") or target
        for name, text in element.attributes.items():
            try:
                if name == "_autoremap":
                    parsed.autoremap = parse_literal(text, bool)
                elif name.startswith("_") and name not in IGNORED:
                    self._unknown(element, name, {})
                elif name not in IGNORED and name != "ID":
                    key = reference(text, name)
                    (parsed.texts if key is None else parsed.reads)[name] = text if key is None else key
            except InvalidInput as error:
                self.problems.add(element.problem(f"{name}: {error}", "text or {key}", "", name))

    def _children(self, element: Element, fewest: int, most: int | None) -> None:
        count = len(element.children)
        if count < fewest or (most is not None and count > most):
            allowed = f"exactly {fewest}" if fewest == most else f"at least {fewest}"
            self.problems.add(element.problem(f"{count} children", allowed if most != 0 else "no children"))
        if element.text.strip():
            self.problems.add(element.problem(f"text {element.text.strip()[:40]!r} between elements", "elements only"))
