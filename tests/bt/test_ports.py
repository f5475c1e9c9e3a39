"""Text becomes values, and types of writers meet types of readers."""

from __future__ import annotations

from enum import Enum, StrEnum
from typing import Any, Literal, Protocol

import pytest

from grape.bt.ports import fits, parse_literal, type_name
from grape.errors import InvalidInput, Reason


class Colour(StrEnum):
    RED = "red"


class Level(Enum):
    LOW = 0


class Base:
    pass


class Derived(Base):
    pass


class Shape(Protocol):
    area: float


VALUES = {
    "float": ("-1.5e-3", float, -0.0015),
    "whole float": ("2", float, 2.0),
    "int": ("-7", int, -7),
    "text": ("1", str, "1"),
    "any": ("1", Any, "1"),
    "bool": ("False", bool, False),
    "text enum by value": ("red", Colour, Colour.RED),
    "other enum by name": ("LOW", Level, Level.LOW),
    "choice": ("2", Literal[1, 2], 2),
    "empty tuple": ("", tuple[float, ...], ()),
    "tuple": ("1; 2", tuple[float, ...], (1.0, 2.0)),
    "mixed tuple": ("a;1", tuple[str, int], ("a", 1)),
    "none": ("", float | None, None),
    "optional": ("1", float | None, 1.0),
    "empty text": ("", str | None, ""),
    "first that fits": ("1.5", int | float, 1.5),
}


@pytest.mark.parametrize("case", VALUES)
def test_text_becomes_a_value_of_the_type(case: str) -> None:
    text, kind, value = VALUES[case]
    parsed = parse_literal(text, kind)
    assert parsed == value and type(parsed) is type(value)


REFUSED = [
    ("1_000", int),
    ("0x10", int),
    ("１", int),
    ("1.0", int),
    ("", int),
    (" 1", int),
    ("1_0", float),
    ("inf", float),
    ("-nan", float),
    ("", float),
    ("yes", bool),
    ("RED", Colour),
    ("0", Level),
    ("3", Literal[1, 2]),
    ("1;x", tuple[float, ...]),
    ("1;2;3", tuple[float, float]),
    ("x", int | float),
    ("x", Base),
    ("1", list[int]),
]


@pytest.mark.parametrize(("text", "kind"), REFUSED)
def test_text_that_does_not_fit_is_refused(text: str, kind: Any) -> None:
    with pytest.raises(InvalidInput):
        parse_literal(text, kind)


FITS = [
    (float, float),
    (int, float),
    (Derived, Base),
    (Reason, str),
    (str, Colour),
    (float, float | None),
    (float | None, float),
    (Any, int),
    (int, object),
    (Base, Shape),
    (tuple[int, ...], tuple[float, ...]),
    (tuple[float, float], tuple[float, ...]),
    (list[int], list[int]),
]
CONFLICTS = [
    (float, int),
    (str, float),
    (bool, int),
    (bool, float),
    (Base, Derived),
    (str, int | None),
    (Colour, Level),
    (tuple[str, ...], tuple[float, ...]),
    (tuple[float, float], tuple[float, float, float]),
    (Base, str),
]


@pytest.mark.parametrize(("written", "read"), FITS)
def test_a_type_that_may_be_read(written: Any, read: Any) -> None:
    assert fits(written, read)


@pytest.mark.parametrize(("written", "read"), CONFLICTS)
def test_a_type_that_may_not_be_read(written: Any, read: Any) -> None:
    assert not fits(written, read)


def test_types_are_named_as_a_person_writes_them() -> None:
    names = [type_name(kind) for kind in (float, Colour, tuple[float, ...], tuple[int, str], float | None, Any)]
    assert names == ["float", "Colour", "tuple[float, ...]", "tuple[int, str]", "float | None", "any"]
