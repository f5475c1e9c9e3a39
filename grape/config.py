"""Files that users write: YAML with the place of every key, checked against a model; every problem is reported at once.

    mission = load_config(MissionFile, Path("mission.yaml"), overrides=["world.style=gobelet"])

Refused before anything is built: files that are too large or too deep, duplicate keys, tabs, anchors and aliases,
tags, NaN and infinity.
"""

from __future__ import annotations

import dataclasses
import json
import math
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import pydantic
from pydantic import BaseModel, ConfigDict
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, MappingStartEvent, NodeEvent, SequenceStartEvent
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from grape.errors import FileError, InvalidInput, Problem, did_you_mean

MAX_BYTES = 256 * 1024
MAX_DEPTH = 16
OVERRIDE = "--set"

Key = tuple[str | int, ...]
Place = tuple[int, int]
M = TypeVar("M", bound=BaseModel)


class Model(BaseModel):
    """Base of every model of a user's file: unknown keys and silent conversions are refused, values are frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


@dataclass(frozen=True, kw_only=True)
class Document:
    """A parsed file: plain data and, for each key path, where it stands (line and column from 1)."""

    file: str
    data: dict[str, Any]
    places: Mapping[Key, Place] = field(default_factory=dict)
    overrides: tuple[Key, ...] = ()

    def problem(self, key: Key, got: str, allowed: str = "", suggestion: str = "") -> Problem:
        """A problem at the place of `key`, or of its nearest known ancestor, or of the override that set it."""
        if any(
            key[: len(path)] == path or (path[: len(key)] == key and key not in self.places) for path in self.overrides
        ):
            return Problem(file=OVERRIDE, path=dotted(key), got=got, allowed=allowed, suggestion=suggestion)
        nearest = next((key[:n] for n in range(len(key), -1, -1) if key[:n] in self.places), None)
        line, column = self.places[nearest] if nearest is not None else (0, 0)
        return Problem(
            file=self.file, line=line, column=column, path=dotted(key), got=got, allowed=allowed, suggestion=suggestion
        )


def dotted(key: Key) -> str:
    """The key path as a user writes it: `plants.0.mode`."""
    return ".".join(str(part) for part in key)


def load_config(model: type[M], path: Path, overrides: Iterable[str] = ()) -> M:
    """Read a YAML file, apply `a.b=value` overrides and check it against a model.

    Raises:
        FileError: with every problem of the file.
    """
    return validate(model, override(load_yaml(path), overrides))


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
    problems, depth = [], 0
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


class _Builder:
    """Turns composed nodes into plain data and notes places and problems."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.places: dict[Key, Place] = {}
        self.problems: list[Problem] = []
        self._constructor = YAML(typ="safe", pure=True).constructor

    def build(self, node: Node, key: Key) -> Any:
        self.places.setdefault(key, self._place(node))
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
            if name in data:
                self._refuse(key_node, (*key, name), "key is given twice", "each key once")
                continue
            self.places[(*key, name)] = self._place(key_node)
            data[name] = self.build(value_node, (*key, name))
        return data

    def _scalar(self, node: ScalarNode, key: Key) -> Any:
        kind = str(node.tag).rpartition(":")[2]
        if not str(node.tag).startswith("tag:yaml.org,2002:") or kind in ("binary", "python", "merge", "value"):
            self._refuse(node, key, f"tag {node.tag}", "plain values")
            return None
        if kind not in ("null", "bool", "int", "float"):
            return str(node.value)
        try:
            value = self._constructor.construct_object(node)
        except (ValueError, YAMLError):
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


def override(document: Document, assignments: Iterable[str]) -> Document:
    """A document with `a.b=value` assignments applied; values are typed as in YAML, list items named by number.

    Raises:
        FileError: an assignment has no `=`, an empty key, a value that is no YAML, or reaches into a plain value.
    """
    data = json.loads(json.dumps(document.data))
    paths: list[Key] = []
    problems: list[Problem] = []
    for assignment in assignments:
        name, separator, text = assignment.partition("=")
        if not separator or not all(name.split(".")):
            problems.append(Problem(file=OVERRIDE, got=repr(assignment), allowed="key=value or key.sub=value"))
            continue
        try:
            value = parse_yaml(f"value: {text}", OVERRIDE).data["value"]
            paths.append(_assign(data, name.split("."), value))
        except FileError as error:
            problems += [dataclasses.replace(p, path=name, line=0, column=0) for p in error.problems]
        except InvalidInput as error:
            problems.append(Problem(file=OVERRIDE, path=name, got=str(error)))
    if problems:
        raise FileError(problems)
    return dataclasses.replace(document, data=data, overrides=(*document.overrides, *paths))


def _assign(data: dict[str, Any], names: list[str], value: Any) -> Key:
    """Put a value at a path, making mappings on the way; returns the path as a key."""
    at: Any = data
    key: list[str | int] = []
    for depth, name in enumerate(names):
        last = depth == len(names) - 1
        if isinstance(at, list):
            if not (name.isdigit() and int(name) < len(at)):
                raise InvalidInput(
                    f"{dotted(tuple(key))} is a list of {len(at)}: got {name!r}, a number below that is allowed"
                )
            step: str | int = int(name)
        elif isinstance(at, dict):
            step = name
            if not last and at.get(name) is None:
                at[name] = {}
        else:
            raise InvalidInput(f"{dotted(tuple(key))} is a plain value and has no keys")
        key.append(step)
        if last:
            at[step] = value
        else:
            at = at[step]
    return tuple(key)


def validate(model: type[M], document: Document) -> M:
    """Check a document against a model.

    Raises:
        FileError: with every problem, each at its place.
    """
    try:
        return model.model_validate_json(json.dumps(document.data))
    except pydantic.ValidationError as error:
        raise FileError(_problem(model, document, dict(detail)) for detail in error.errors()) from error


def validate_options(options: type[Any], document: Document, at: Key, ignore: Iterable[str] = ()) -> Any:
    """Build an options dataclass from the mapping at a key path.

    Args:
        options: a dataclass whose fields are the allowed keys; its own checks may raise InvalidInput.
        ignore: keys of the mapping that are not for it.

    Raises:
        FileError: with every problem, each at its place.
    """
    data: Any = document.data
    for part in at:
        data = data.get(part, {}) if isinstance(data, dict) else {}
    data = {} if data is None else data
    if not isinstance(data, dict):
        raise FileError([document.problem(at, f"{data!r}", "key: value lines")])
    values = {key: value for key, value in data.items() if key not in set(ignore)}
    model = model_of(options)
    try:
        checked = model.model_validate_json(json.dumps(values))
    except pydantic.ValidationError as error:
        raise FileError(_problem(model, document, dict(detail), at) for detail in error.errors()) from error
    try:
        return options(**{name: getattr(checked, name) for name in checked.model_fields_set})
    except InvalidInput as error:
        named = [name for name in values if name in str(error)]
        key = (*at, max(named, key=len)) if named else at
        raise FileError([document.problem(key, str(error))]) from error


def model_of(options: type[Any]) -> type[Model]:
    """A model with the fields, types and defaults of a dataclass."""
    hints = typing.get_type_hints(options, include_extras=True)
    fields: dict[str, Any] = {}
    for item in dataclasses.fields(options):
        if not item.init:
            continue
        default: Any = ... if item.default is dataclasses.MISSING else item.default
        if item.default_factory is not dataclasses.MISSING:
            default = item.default_factory()
        fields[item.name] = (hints[item.name], default)
    return pydantic.create_model(options.__name__, __base__=Model, **fields)


def _problem(model: type[BaseModel], document: Document, detail: dict[str, Any], at: Key = ()) -> Problem:
    """A pydantic error as a problem: what was got, what is allowed, and a suggestion."""
    loc: Key = tuple(detail["loc"])
    key: Key = (*at, *loc)
    kind, value, context = detail["type"], detail.get("input"), detail.get("ctx", {})
    if kind == "extra_forbidden":
        allowed = _fields_at(model, loc[:-1])
        return document.problem(key, "unknown key", ", ".join(allowed), did_you_mean(str(loc[-1]), allowed))
    if kind == "missing":
        return document.problem(key, "is missing", "this key is required")
    message = str(detail["msg"])
    if kind in ("literal_error", "enum"):
        choices = [part.strip("'") for part in str(context["expected"]).replace(" or ", ", ").split(", ")]
        return document.problem(key, f"got {value!r}", ", ".join(choices), did_you_mean(str(value), choices))
    if kind == "value_error":
        return document.problem(key, str(context.get("error", message)))
    got = (
        f"got {value!r}"
        if not isinstance(value, dict | list) or len(str(value)) < 60
        else f"got a {type(value).__name__}"
    )
    return document.problem(key, got, message.removeprefix("Input should be ").removeprefix("a valid "))


def _fields_at(model: type[BaseModel], loc: Key) -> list[str]:
    """Names of the fields of the model that stands at a location inside another model."""
    annotation: Any = model
    for part in loc:
        annotation = _inside(annotation)
        if isinstance(annotation, type) and issubclass(annotation, BaseModel) and part in annotation.model_fields:
            annotation = annotation.model_fields[str(part)].annotation
    annotation = _inside(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return list(annotation.model_fields)
    return []


def _inside(annotation: Any) -> Any:
    """The model inside Optional, tuple, list or dict annotations; the annotation itself when there is none."""
    if isinstance(annotation, type) and not typing.get_args(annotation):
        return annotation
    for argument in reversed(typing.get_args(annotation)):
        found = _inside(argument)
        if isinstance(found, type) and issubclass(found, BaseModel):
            return found
    return annotation
