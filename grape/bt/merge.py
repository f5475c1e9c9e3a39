"""Writes a tree file and the files it includes as one BehaviorTree.CPP v4 file that needs no other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from grape.bt.definitions import Definitions, gather
from grape.errors import FileError, Problem
from grape.xml_document import MAX_BYTES, MAX_ELEMENTS, Element


def merge_includes(path: Path) -> bytes:
    """A tree file as it is, byte for byte, or with the content of every file it includes and without comments.

    Raises:
        FileError: with every problem of reading the files and finding their trees.
    """
    found = gather(path)
    problems = found.problems | set(too_large_together(found))
    if problems:
        raise FileError(problems)
    return _text(_merged(found)) if _includes(found) else path.read_bytes()


def too_large_together(found: Definitions) -> Iterator[Problem]:
    """The problem of files that can each be read, but would be refused as one."""
    root = found.main_from
    if root is None or not _includes(found):
        return
    merged = _merged(found)
    if len(_text(merged)) > MAX_BYTES or sum(1 for _ in merged.iter()) > MAX_ELEMENTS:
        allowed = f"at most {MAX_BYTES} bytes and {MAX_ELEMENTS} elements"
        yield root.problem("the file is too large with those it includes", allowed)


def _includes(found: Definitions) -> bool:
    return found.main_from is not None and any(child.tag == "include" for child in found.main_from.children)


def _merged(found: Definitions) -> ElementTree.Element:
    """One root: the attributes of the main file, all trees, and one model, since BehaviorTree.CPP accepts no second."""
    attributes = found.main_from.attributes if found.main_from is not None else {}
    root = ElementTree.Element("root", attributes)
    root.extend(_copy(tree) for tree in found.trees.values())
    models: dict[tuple[str, str | None], Element] = {}
    for model in found.models:
        for node in model.children:
            models.setdefault((node.tag, node.attributes.get("ID")), node)
    if models:
        ElementTree.SubElement(root, "TreeNodesModel").extend(_copy(node) for node in models.values())
    return root


def _copy(element: Element) -> ElementTree.Element:
    copy = ElementTree.Element(element.tag, element.attributes)
    copy.text = element.text
    copy.extend(_copy(child) for child in element.children)
    return copy


def _text(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"
