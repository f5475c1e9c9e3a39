"""Gathers the tree definitions of a BehaviorTree.CPP v4 file and of the files it includes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from grape.errors import FileError, Problem, did_you_mean
from grape.xml_document import Element, read_document

FORMAT = "4"
MAX_FILES = 50
ROOT_TAGS = ("BehaviorTree", "TreeNodesModel", "include")


@dataclass(kw_only=True)
class Definitions:
    """Every `BehaviorTree` element by its ID, the models that came with them, and what was wrong on the way."""

    main: str | None = None
    main_from: Element | None = None
    trees: dict[str, Element] = field(default_factory=dict)
    models: list[Element] = field(default_factory=list)
    problems: set[Problem] = field(default_factory=set)


def gather(path: Path, main: str | None = None) -> Definitions:
    """Read a tree file and everything it includes; problems are collected, not raised."""
    found = Definitions()
    _read(path, None, found, set())
    root = found.main_from
    if root is not None:
        _choose_main(root, main, found)
    return found


def _choose_main(root: Element, main: str | None, found: Definitions) -> None:
    found.main = main or root.attributes.get("main_tree_to_execute")
    if found.main is None:
        found.problems.add(root.problem("main_tree_to_execute is missing", _one_of(found.trees)))
    elif found.main not in found.trees:
        got = f"the main tree {found.main!r} is not in the file"
        hint = did_you_mean(found.main, found.trees)
        found.problems.add(root.problem(got, _one_of(found.trees), hint, "main_tree_to_execute"))
        found.main = None


def _one_of(names: dict[str, Element]) -> str:
    return "the ID of a tree: " + ", ".join(sorted(names)) if names else "the ID of a tree; the file holds none"


def _read(path: Path, including: Element | None, found: Definitions, seen: set[Path]) -> None:
    resolved = path.resolve()
    if resolved in seen:
        return
    if len(seen) >= MAX_FILES:
        if including is not None:
            found.problems.add(including.problem(f"more than {MAX_FILES} files are included"))
        return
    seen.add(resolved)
    try:
        root = read_document(path)
    except FileError as error:
        if including is not None and not path.is_file():
            found.problems.add(including.problem(f"no file {str(path)!r}", "a path beside this file", "", "path"))
        else:
            found.problems.update(error.problems)
        return
    if including is None:
        found.main_from = root
    _check_root(root, found)
    for child in root.children:
        if child.tag == "include":
            _include(path, child, found, seen)
        elif child.tag == "BehaviorTree":
            _add_tree(child, found)
        elif child.tag == "TreeNodesModel":
            found.models.append(child)
        else:
            hint = did_you_mean(child.tag, ROOT_TAGS)
            found.problems.add(child.problem("not expected under <root>", ", ".join(ROOT_TAGS), hint))


def _check_root(root: Element, found: Definitions) -> None:
    if root.tag != "root":
        found.problems.add(root.problem("the outermost element is wrong", "<root>"))
    if "BTCPP_format" not in root.attributes:
        found.problems.add(root.problem("BTCPP_format is missing", f'BTCPP_format="{FORMAT}"'))
    elif root.attributes["BTCPP_format"] != FORMAT:
        got = f"format {root.attributes['BTCPP_format']!r} is not supported"
        found.problems.add(root.problem(got, f'BTCPP_format="{FORMAT}"', "", "BTCPP_format"))
    allowed = ("BTCPP_format", "main_tree_to_execute", "project_name")
    for name in root.attributes:
        if name not in allowed:
            found.problems.add(
                root.problem(f"unknown attribute {name!r}", ", ".join(allowed), did_you_mean(name, allowed), name)
            )
    if root.text.strip():
        found.problems.add(root.problem("text between elements", "elements only"))


def _include(path: Path, element: Element, found: Definitions, seen: set[Path]) -> None:
    target = element.attributes.get("path")
    if not target or set(element.attributes) != {"path"}:
        found.problems.add(element.problem("an include needs a path and nothing else", 'path="other.xml"'))
        return
    _read(path.parent / target, element, found, seen)


def _add_tree(element: Element, found: Definitions) -> None:
    name = element.attributes.get("ID")
    if not name:
        found.problems.add(element.problem("the tree has no ID", 'ID="Name"'))
    elif name in found.trees:
        first = found.trees[name]
        got = f"a second tree {name!r}; the first is at {first.file}:{first.line}"
        found.problems.add(element.problem(got, "one tree for each ID", "", "ID"))
    else:
        found.trees[name] = element
