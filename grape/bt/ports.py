"""Ports: what a node reads and writes in a tree file, taken from the dataclasses of its goal and result."""

from __future__ import annotations

import dataclasses
import enum
import inspect
import math
import re
import types
import typing
from collections.abc import Mapping
from dataclasses import MISSING, dataclass
from enum import StrEnum
from functools import cache
from typing import Annotated, Any

import pydantic

from grape.actions.core import Action, Condition
from grape.errors import InvalidInput, Reason, with_suggestion

Leaf = Action[Any, Any] | Condition[Any]


class NoDefault(enum.Enum):
    """Marks a port without a default."""

    NO_DEFAULT = enum.auto()


NO_DEFAULT = NoDefault.NO_DEFAULT


class Direction(StrEnum):
    """The tags of BehaviorTree.CPP's TreeNodesModel."""

    INPUT = "input_port"
    OUTPUT = "output_port"
    INOUT = "inout_port"


@dataclass(frozen=True, kw_only=True)
class Port:
    """One port of a node.

    Attributes:
        default: value of an input that the tree leaves out; NO_DEFAULT where it must be given.
    """

    name: str
    type: Any
    direction: Direction
    default: Any = NO_DEFAULT
    description: str = ""

    @property
    def required(self) -> bool:
        """Whether a tree must give it."""
        return self.direction is not Direction.OUTPUT and self.default is NO_DEFAULT


RESERVED = (
    Port(name="reason", type=Reason, direction=Direction.OUTPUT, description="reason code, written when it fails"),
    Port(name="detail", type=str, direction=Direction.OUTPUT, description="sentence, written when it fails"),
)


@cache
def leaf_ports(leaf: Leaf) -> Mapping[str, Port]:
    """Every port of an action or condition; an action also has `reason` and `detail`, unless it uses the names itself.

    Raises:
        InvalidInput: a field name that a tree file cannot carry, or a goal and a result field that disagree in type.
    """
    ports = {port.name: port for port in _ports_of(leaf.goal_type, Direction.INPUT)}
    if isinstance(leaf, Action):
        for port in _ports_of(leaf.result_type, Direction.OUTPUT):
            known = ports.get(port.name)
            if known is not None and bare(known.type) != bare(port.type):
                raise InvalidInput(
                    f"{leaf.name}: port {port.name!r} is {type_name(known.type)} in the goal and"
                    f" {type_name(port.type)} in the result; give both one type or two names"
                )
            ports[port.name] = dataclasses.replace(known, direction=Direction.INOUT) if known else port
        for port in RESERVED:
            ports.setdefault(port.name, port)
    for name in ports:
        if name in ("name", "ID") or name.startswith("_"):
            raise InvalidInput(
                f"{leaf.name}: a port cannot be called {name!r}; tree files use that attribute themselves"
            )
    return types.MappingProxyType(ports)


def _ports_of(kind: Any, direction: Direction) -> list[Port]:
    hints = typing.get_type_hints(kind, include_extras=True)
    descriptions = _descriptions(inspect.getdoc(kind) or "")
    ports = []
    for field in dataclasses.fields(kind):
        if not field.init:
            continue
        default = field.default if field.default_factory is MISSING else field.default_factory()
        default = NO_DEFAULT if default is MISSING or direction is Direction.OUTPUT else default
        ports.append(
            Port(
                name=field.name,
                type=hints[field.name],
                direction=direction,
                default=default,
                description=descriptions.get(field.name, ""),
            )
        )
    return ports


def _descriptions(docstring: str) -> dict[str, str]:
    """What the `Attributes:` section of a docstring says of each field."""
    section = docstring.partition("Attributes:\n")[2]
    found = re.findall(r"^    (\w+): (.*(?:\n {5,}.*)*)", section, re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}


def type_name(kind: Any) -> str:
    """A type as a person writes it: `float`, `tuple[float, float]`, `Outcome`."""
    kind = bare(kind)
    if kind is Any:
        return "any"
    if isinstance(kind, type) and not typing.get_args(kind):
        return kind.__name__
    arguments = typing.get_args(kind)
    if is_union(kind):
        return " | ".join(type_name(argument) for argument in arguments).replace("NoneType", "None")
    if typing.get_origin(kind) is tuple:
        return f"tuple[{', '.join('...' if a is ... else type_name(a) for a in arguments)}]"
    return str(kind).replace("typing.", "")


def bare(kind: Any) -> Any:
    """A type without the checks that `Annotated` adds to it."""
    return typing.get_args(kind)[0] if typing.get_origin(kind) is Annotated else kind


def is_union(kind: Any) -> bool:
    """Whether a type is `A | B` or `Optional[A]`."""
    return typing.get_origin(kind) in (typing.Union, types.UnionType)


def without_none(kind: Any) -> tuple[Any, ...]:
    """The members of a union without None; the type itself for any other."""
    return tuple(a for a in typing.get_args(kind) if a is not type(None)) if is_union(kind) else (kind,)


_INT = re.compile(r"[+-]?[0-9]{1,18}")
_FLOAT = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_BOOL = {
    "true": True,
    "True": True,
    "TRUE": True,
    "1": True,
    "false": False,
    "False": False,
    "FALSE": False,
    "0": False,
}


def parse_literal(text: str, kind: Any) -> Any:
    """The value that `text` in a tree file has for a port of type `kind`.

    Raises:
        InvalidInput: the text does not fit, or the type can only come from the blackboard.
    """
    if typing.get_origin(kind) is Annotated:
        return _checked(parse_literal(text, bare(kind)), kind)
    if is_union(kind):
        return _parse_union(text, kind)
    if kind is str or kind is Any:
        return text
    if typing.get_origin(kind) is tuple:
        return _parse_tuple(text, kind)
    if typing.get_origin(kind) is typing.Literal:
        return _choose(text, {str(choice): choice for choice in typing.get_args(kind)})
    if kind is bool:
        return _choose(text, _BOOL)
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return _choose(text, {str(m.value) if isinstance(m.value, str) else m.name: m for m in kind})
    if kind is int and _INT.fullmatch(text):
        return int(text)
    if kind is float and _FLOAT.fullmatch(text) and math.isfinite(float(text)):
        return float(text)
    if kind in (int, float):
        raise InvalidInput(f"{text!r} is no {'finite number' if kind is float else 'whole number'}")
    raise InvalidInput(f"a {type_name(kind)} cannot be written as text; give a blackboard entry as {{key}}")


def _checked(value: Any, kind: Any) -> Any:
    """The value, which passes the checks of an `Annotated` type."""
    try:
        return pydantic.TypeAdapter(kind).validate_python(value)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        raise InvalidInput(str(first.get("ctx", {}).get("error", f"{value!r}: {first['msg']}"))) from error


def _parse_union(text: str, kind: Any) -> Any:
    members = without_none(kind)
    if text == "" and str not in members:
        return None
    errors = []
    for member in members:
        try:
            return parse_literal(text, member)
        except InvalidInput as error:
            errors.append(str(error))
    raise InvalidInput("; ".join(errors))


def _parse_tuple(text: str, kind: Any) -> tuple[Any, ...]:
    members = typing.get_args(kind)
    parts = text.split(";") if text else []
    if len(members) == 2 and members[1] is ...:
        members = (members[0],) * len(parts)
    if len(parts) != len(members):
        raise InvalidInput(f"{text!r} has {len(parts)} values separated by ';', {type_name(kind)} has {len(members)}")
    return tuple(parse_literal(part.strip(), member) for part, member in zip(parts, members, strict=True))


def _choose(text: str, choices: Mapping[str, Any]) -> Any:
    if text not in choices:
        raise InvalidInput(with_suggestion(f"{text!r} is none of {', '.join(choices)}", text, choices))
    return choices[text]


def fits(written: Any, read: Any) -> bool:
    """Whether a value of type `written` may be read by a port of type `read`; what cannot be decided passes."""
    written, read = bare(written), bare(read)
    if written == read or Any in (written, read) or object in (written, read):
        return True
    if is_union(written) or is_union(read):
        return any(fits(w, r) for w in without_none(written) for r in without_none(read))
    if typing.get_origin(written) is tuple and typing.get_origin(read) is tuple:
        return _tuples_fit(typing.get_args(written), typing.get_args(read))
    written, read = typing.get_origin(written) or written, typing.get_origin(read) or read
    if not (isinstance(written, type) and isinstance(read, type)):
        return True
    if issubclass(read, enum.Enum) and written is str:
        return True
    if read is float and written is int:
        return True
    if getattr(read, "_is_protocol", False):
        return True
    return issubclass(written, read) and not (written is bool and read in (int, float))


def _tuples_fit(written: tuple[Any, ...], read: tuple[Any, ...]) -> bool:
    if ... in written or ... in read:
        pairs = [(w, r) for w in written if w is not ... for r in read if r is not ...]
        return all(fits(w, r) for w, r in pairs)
    return len(written) == len(read) and all(fits(w, r) for w, r in zip(written, read, strict=True))
