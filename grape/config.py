"""Configuration: YAML that users write, checked against a model; every problem is reported at once, with its place.

mission = load_config(MissionFile, Path("mission.yaml"), overrides=["world.style=gobelet"])
"""

from __future__ import annotations

import dataclasses
import json
import re
import typing
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import pydantic
from pydantic import BaseModel, ConfigDict

from grape.errors import MOST_PROBLEMS, FileError, InvalidInput, Problem, did_you_mean
from grape.yaml_document import MAX_DEPTH, OVERRIDE, Document, Key, dotted, load_yaml, parse_yaml, read_text

__all__ = [
    "Document",
    "Model",
    "dotted",
    "load_config",
    "load_yaml",
    "override",
    "parse_yaml",
    "read_text",
    "validate",
    "validate_options",
]

M = TypeVar("M", bound=BaseModel)


class Model(BaseModel):
    """Base of every model of a user's file: unknown keys and silent conversions are refused, values are frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


def load_config(model: type[M], path: Path, overrides: Iterable[str] = ()) -> M:
    """Read a YAML file, apply `a.b=value` overrides and check it against a model.

    Raises:
        FileError: with every problem of the file.
    """
    return validate(model, override(load_yaml(path), overrides))


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
        if not separator or not all(part and part.isprintable() for part in name.split(".")):
            problems.append(
                Problem(file=OVERRIDE, got=f"got {assignment!r}", allowed="KEY=VALUE, such as seed=3 or world.rows=5")
            )
            continue
        try:
            given = parse_yaml(f"value: {text}", OVERRIDE).data
            if len(given) > 1:
                raise InvalidInput(f"got {text!r}, which sets more than one key; give each its own {OVERRIDE}")
            paths.append(_assign(data, name.split("."), given["value"]))
        except FileError as error:
            problems += [dataclasses.replace(p, path=name, line=0, column=0) for p in error.problems]
        except InvalidInput as error:
            problems.append(Problem(file=OVERRIDE, path=name, got=str(error)))
    if problems:
        raise FileError(problems)
    return dataclasses.replace(document, data=data, overrides=(*document.overrides, *paths))


def _assign(data: dict[str, Any], names: list[str], value: Any) -> Key:
    """Put a value at a path, making mappings on the way; returns the path as a key."""
    if len(names) > MAX_DEPTH:
        raise InvalidInput(f"{len(names)} levels deep; allowed: at most {MAX_DEPTH}")
    at: Any = data
    key: list[str | int] = []
    for depth, name in enumerate(names):
        last = depth == len(names) - 1
        if isinstance(at, list):
            if not (name.isdigit() and int(name) < len(at)):
                allowed = f"0 to {len(at) - 1}" if at else "nothing, set the whole list"
                raise InvalidInput(f"{dotted(tuple(key))} is a list of {len(at)}: got {name!r}; allowed: {allowed}")
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
        raise FileError(_problems(model, document, error)) from error


def validate_options(
    options: type[Any],
    document: Document,
    at: Key,
    *,
    reserved: Iterable[str] = (),
    defaults: Mapping[str, Any] | None = None,
) -> Any:
    """Build options from the mapping at a key path.

    Args:
        options: a dataclass or pydantic model whose fields are the allowed keys; its checks may raise InvalidInput.
        reserved: keys of the mapping that are allowed too, but not for it.
        defaults: values of keys that the mapping does not give.

    Raises:
        FileError: with every problem, each at its place.
    """
    data: Any = document.data
    for part in at:
        data = data.get(part) if isinstance(data, dict) else None
    if not isinstance(data, dict | None):
        raise FileError([document.problem(at, f"got {data!r}", "key: value lines")])
    reserved = tuple(reserved)
    values = dict(defaults or {}) | {key: value for key, value in (data or {}).items() if key not in reserved}
    model: type[BaseModel] = options if issubclass(options, BaseModel) else model_of(options)
    try:
        checked = model.model_validate_json(json.dumps(values))
        if issubclass(options, BaseModel):
            return checked
        return options(**{name: getattr(checked, name) for name in checked.model_fields_set})
    except pydantic.ValidationError as error:
        raise FileError(_problems(model, document, error, at, reserved)) from error
    except InvalidInput as error:
        raise FileError([document.problem(_named_key(at, values, str(error)), str(error))]) from error


def _named_key(at: Key, names: Iterable[str], message: str) -> Key:
    """The key that a message names first, below `at`; `at` when it names none."""
    places = {name: place.start() for name in names if (place := re.search(rf"\b{re.escape(name)}\b", message))}
    return (*at, min(places, key=lambda name: places[name])) if places else at


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


def _problems(
    model: type[BaseModel],
    document: Document,
    error: pydantic.ValidationError,
    at: Key = (),
    reserved: tuple[str, ...] = (),
) -> Iterator[Problem]:
    """The first of a validation's errors as problems."""
    for detail in error.errors()[:MOST_PROBLEMS]:
        yield _problem(model, document, dict(detail), at, reserved)


def _problem(
    model: type[BaseModel], document: Document, detail: dict[str, Any], at: Key, reserved: tuple[str, ...]
) -> Problem:
    """A pydantic error as a problem: what was got, what is allowed, and a suggestion."""
    loc: Key = tuple(detail["loc"])
    key: Key = (*at, *loc)
    kind, value, context = detail["type"], detail.get("input"), detail.get("ctx", {})
    if kind == "extra_forbidden":
        allowed = [*(reserved if len(loc) == 1 else ()), *_fields_at(model, loc[:-1])]
        return document.problem(key, "unknown key", ", ".join(allowed), did_you_mean(str(loc[-1]), allowed))
    if kind == "missing":
        return document.problem(key, "is missing", "this key is required")
    message = str(detail["msg"])
    if kind in ("literal_error", "enum"):
        choices = [part.strip("'") for part in str(context["expected"]).replace(" or ", ", ").split(", ")]
        return document.problem(key, f"got {value!r}", ", ".join(choices), did_you_mean(str(value), choices))
    if kind == "value_error":
        message = str(context.get("error", message))
        return document.problem(_named_key(key, _fields_at(model, loc), message), message)
    got = (
        f"got {value!r}"
        if not isinstance(value, dict | list) or len(str(value)) < 60
        else f"got a {type(value).__name__}"
    )
    wanted = "key: value lines" if kind == "dict_type" else message.removeprefix("Input should be ")
    return document.problem(key, got, wanted.removeprefix("a valid "))


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
