"""The TreeNodesModel of a node library: what Groot2 needs to know to show and edit trees that use it."""

from __future__ import annotations

import enum
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree

from grape.actions.core import Action
from grape.bt.ports import NO_DEFAULT, Direction, Leaf, Port, bare, leaf_ports, type_name
from grape.errors import Problem, did_you_mean
from grape.xml_document import Element

PORT_TAGS = tuple(str(direction) for direction in Direction)
NODE_TAGS = ("Action", "Condition", "Control", "Decorator", "SubTree")
CPP_TYPES = {bool: "bool", int: "int", float: "double", str: "std::string"}


def nodes_model(nodes: Mapping[str, Leaf]) -> str:
    """An XML file with the model of every action and condition: ports with direction, type, default and description."""
    root = ElementTree.Element("root", BTCPP_format="4")
    model = ElementTree.SubElement(root, "TreeNodesModel")
    for name in sorted(nodes):
        leaf = nodes[name]
        element = ElementTree.SubElement(model, "Action" if isinstance(leaf, Action) else "Condition", ID=name)
        for port in leaf_ports(leaf).values():
            _add_port(element, port)
        if leaf.summary:
            ElementTree.SubElement(element, "MetadataFields")
            ElementTree.SubElement(element[-1], "Metadata", description=leaf.summary)
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text.decode() + "\n"


def _add_port(element: ElementTree.Element, port: Port) -> None:
    attributes = {"name": port.name, "type": CPP_TYPES.get(bare(port.type)) or type_name(port.type)}
    default = _default_text(port.default)
    if default is not None:
        attributes["default"] = default
    child = ElementTree.SubElement(element, port.direction, attributes)
    child.text = port.description or None


def _default_text(value: Any) -> str | None:
    """A default as it would be written in a tree file, None where it cannot or need not be."""
    if value is NO_DEFAULT or value is None:
        return None
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, enum.Enum):
        return value.value if isinstance(value.value, str) else value.name
    if isinstance(value, int | float | str):
        return str(value)
    if isinstance(value, tuple):
        parts = [_default_text(item) for item in value]
        return None if None in parts else ";".join(part for part in parts if part is not None)
    return None


def check_model(model: Element, nodes: Mapping[str, Leaf]) -> Iterator[Problem]:
    """Every difference between a `<TreeNodesModel>` element and the library; nodes that it leaves out are fine."""
    for element in model.children:
        name = element.attributes.get("ID", "")
        if element.tag not in NODE_TAGS:
            hint = did_you_mean(element.tag, NODE_TAGS)
            yield element.problem("not expected in a TreeNodesModel", ", ".join(NODE_TAGS), hint)
        elif not name:
            yield element.problem("ID is missing", 'ID="NodeType"')
        elif element.tag in ("Action", "Condition"):
            yield from _check_node(element, name, nodes)


def _check_node(element: Element, name: str, nodes: Mapping[str, Leaf]) -> Iterator[Problem]:
    leaf = nodes.get(name)
    if leaf is None:
        yield element.problem(f"the model declares {name!r}, which no library has", "", did_you_mean(name, nodes), "ID")
        return
    kind = "Action" if isinstance(leaf, Action) else "Condition"
    if element.tag != kind:
        yield element.problem(f"the model declares {name!r} as {element.tag}", kind)
    ports = leaf_ports(leaf)
    for child in element.children:
        if child.tag in PORT_TAGS:
            yield from _check_port(child, name, ports)
    declared = {child.attributes.get("name") for child in element.children}
    for port in ports.values():
        if port.required and port.name not in declared:
            yield element.problem(f"the model of {name!r} lacks the port {port.name!r}")


def _check_port(element: Element, node: str, ports: Mapping[str, Port]) -> Iterator[Problem]:
    name = element.attributes.get("name", "")
    port = ports.get(name)
    if port is None:
        yield element.problem(f"{node!r} has no port {name!r}", ", ".join(ports), did_you_mean(name, ports), "name")
        return
    if element.tag != port.direction:
        yield element.problem(f"port {name!r} of {node!r} is declared as {element.tag}", str(port.direction))
    kind = element.attributes.get("type")
    cpp = CPP_TYPES.get(bare(port.type))
    if kind is not None and kind not in (cpp, type_name(port.type)):
        allowed = cpp or type_name(port.type)
        yield element.problem(f"port {name!r} of {node!r} is declared as {kind!r}", allowed, "", "type")
