"""YAML text as plain data with the place of every key; what a configuration has no use for is refused.

Refused before anything is built: files that are too large or too deep, duplicate keys, tabs, anchors and aliases,
tags, NaN and infinity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, MappingStartEvent, NodeEvent, SequenceStartEvent
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from grape.errors import FileError, Problem

MAX_BYTES = 256 * 1024
MAX_DEPTH = 16
OVERRIDE = "--set"

_COLLECTIONS = ("map", "seq")
_PLAIN_TAGS = ("null", "bool", "int", "float", "str", "timestamp", "merge", "value")

Key = tuple[str | int, ...]
Place = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class Document:
    """A parsed file: plain data and, for each key path, where it stands (line and column from 1).

    `overrides` are the key paths set from the command line, `included` the parts that came from another file.
    """

    file: str
    data: dict[str, Any]
    places: Mapping[Key, Place] = field(default_factory=dict)
    overrides: tuple[Key, ...] = ()
    included: Mapping[Key, Document] = field(default_factory=dict)

    def problem(self, key: Key, got: str, allowed: str = "", suggestion: str = "") -> Problem:
        """A problem at the place of `key`, or of its nearest known ancestor, or of the override that set it."""
        file, (line, column) = self._where(key)
        return Problem(
            file=file, line=line, column=column, path=dotted(key), got=got, allowed=allowed, suggestion=suggestion
        )

    def _where(self, key: Key) -> tuple[str, Place]:
        for path in self.overrides:
            if key[: len(path)] == path or (path[: len(key)] == key and key not in self.places):
                return OVERRIDE, (0, 0)
        for path, document in self.included.items():
            if key[: len(path)] == path:
                return document._where(key[len(path) :])
        nearest = next((key[:n] for n in range(len(key), -1, -1) if key[:n] in self.places), None)
        return self.file, self.places[nearest] if nearest is not None else (0, 0)


def dotted(key: Key) -> str:
    """The key path as a user writes it: `plants.0.mode`."""
    return ".".join(str(part) for part in key)


def read_text(path: Path, max_bytes: int = MAX_BYTES) -> str:
    """The text of a user's file.

    Raises:
        FileError: the file is missing, no file, too large or not UTF-8.
    """

    def refuse(got: str, allowed: str = "") -> FileError:
        return FileError([Problem(file=str(path), got=got, allowed=allowed)])

    try:
        with path.open("rb") as stream:
            raw = stream.read(max_bytes + 1)
    except OSError as error:
        raise refuse(f"cannot be read: {error.strerror or error}") from error
    if len(raw) > max_bytes:
        raise refuse("file is too large", f"at most {max_bytes} bytes")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise refuse(f"byte {error.start} is not UTF-8", "UTF-8 text") from error


def load_yaml(path: Path) -> Document:
    """Parse a YAML file whose top level is a mapping.

    Raises:
        FileError: with every problem of the file.
    """
    return parse_yaml(read_text(path), str(path))


def parse_yaml(text: str, file: str) -> Document:
    """Parse YAML text; `file` names it in problems.

    Raises:
        FileError: with every problem of the text.
    """
    try:
        problems = _forbidden_constructs(text, file)
        if problems:
            raise FileError(problems)
        root = YAML(typ="safe", pure=True).compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark is not None else (0, 0)
        raise FileError([Problem(file=file, line=line, column=column, got=_yaml_message(error))]) from error
    except YAMLError as error:
        raise FileError([Problem(file=file, got=str(error).replace("\n", " "), allowed="YAML 1.2")]) from error
    if not isinstance(root, MappingNode):
        got = "file is empty" if root is None else f"the top level is a {root.id}"
        raise FileError([Problem(file=file, line=1, column=1, got=got, allowed="key: value lines")])
    builder = _Builder(file)
    data = builder.build(root, ())
    if builder.problems:
        raise FileError(builder.problems)
    return Document(file=file, data=data, places=builder.places)


def _yaml_message(error: MarkedYAMLError) -> str:
    message = error.problem or error.context or "malformed YAML"
    return "a tab where YAML allows spaces only" if "'\\t'" in message else message


def _forbidden_constructs(text: str, file: str) -> list[Problem]:
    """Anchors, aliases and too deep nesting, found from the event stream, before any node is built."""
    problems: list[Problem] = []
    depth = 0
    for event in YAML(typ="safe", pure=True).parse(text):
        opens = isinstance(event, MappingStartEvent | SequenceStartEvent)
        depth += 1 if opens else -1 if type(event).__name__ in ("MappingEndEvent", "SequenceEndEvent") else 0
        line, column = event.start_mark.line + 1, event.start_mark.column + 1
        if depth > MAX_DEPTH:
            got, allowed = "nested too deeply", f"at most {MAX_DEPTH} levels"
            return [*problems, Problem(file=file, line=line, column=column, got=got, allowed=allowed)]
        if isinstance(event, AliasEvent) or (isinstance(event, NodeEvent) and event.anchor is not None):
            got, allowed = f"anchor or alias {event.anchor!r}", "write the value out"
            problems.append(Problem(file=file, line=line, column=column, got=got, allowed=allowed))
    return problems


def _kind(node: Node) -> str:
    return str(node.tag).removeprefix("tag:yaml.org,2002:")


def _is_text(value: str) -> bool:
    """Whether UTF-8 can say it: halves of surrogate pairs, which escapes can name, it cannot."""
    return not any("\ud800" <= letter <= "\udfff" for letter in value)


class _Builder:
    """Turns composed nodes into plain data and notes places and problems."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.places: dict[Key, Place] = {}
        self.problems: list[Problem] = []
        self._constructor = YAML(typ="safe", pure=True).constructor

    def build(self, node: Node, key: Key) -> Any:
        self.places.setdefault(key, self._place(node))
        if not isinstance(node, ScalarNode) and _kind(node) not in _COLLECTIONS:
            self._refuse(node, key, f"tag {node.tag}", "plain values")
            return None
        if isinstance(node, MappingNode):
            return self._mapping(node, key)
        if isinstance(node, SequenceNode):
            return [self.build(child, (*key, k)) for k, child in enumerate(node.value)]
        return self._scalar(node, key)

    def _mapping(self, node: MappingNode, key: Key) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, ScalarNode):
                self._refuse(key_node, key, f"a {key_node.id} as a key", "a word")
                continue
            name = str(key_node.value)
            if not _is_text(name):
                self._refuse(key_node, key, f"{name!r} as a key", "a word")
                continue
            if name in data:
                self._refuse(key_node, (*key, name), "key is given twice", "each key once")
                continue
            self.places[(*key, name)] = self._place(key_node)
            data[name] = self.build(value_node, (*key, name))
        return data

    def _scalar(self, node: Node, key: Key) -> Any:
        kind = _kind(node)
        if kind not in _PLAIN_TAGS:
            self._refuse(node, key, f"tag {node.tag}", "plain values")
            return None
        if kind not in ("null", "bool", "int", "float"):
            if not _is_text(str(node.value)):
                self._refuse(node, key, f"{str(node.value)[:40]!r} is no text", "UTF-8 text")
            return str(node.value)
        try:
            value = self._constructor.construct_object(node)
        except (ValueError, LookupError, YAMLError):
            self._refuse(node, key, f"{str(node.value)[:40]!r} is no {kind}", f"a {kind}")
            return None
        if isinstance(value, int | float) and not (math.isfinite(value) if abs(value) < 1e300 else False):
            self._refuse(node, key, str(node.value)[:40], "a finite number")
            return None
        return value

    def _refuse(self, node: Node, key: Key, got: str, allowed: str) -> None:
        line, column = self._place(node)
        self.problems.append(
            Problem(file=self.file, line=line, column=column, path=dotted(key), got=got, allowed=allowed)
        )

    @staticmethod
    def _place(node: Node) -> Place:
        return node.start_mark.line + 1, node.start_mark.column + 1
