"""Configuration files: places, suggestions, overrides, and everything that is refused."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from grape.config import Model, load_config, override, parse_yaml, validate, validate_options
from grape.errors import FileError, InvalidInput


class Wheel(Model):
    kind: Literal["rubber", "steel"] = "rubber"
    radius: Annotated[float, Field(gt=0)] = 0.1


class Cart(Model):
    name: str
    load: Annotated[int, Field(ge=0, le=8)] = 0
    wheels: tuple[Wheel, ...] = ()
    axle: Wheel | None = None


def problems_of(text: str, overrides: list[str] | None = None) -> list[str]:
    with pytest.raises(FileError) as caught:
        validate(Cart, override(parse_yaml(text, "cart.yaml"), overrides or []))
    return [str(problem) for problem in caught.value.problems]


def test_a_valid_file_becomes_a_frozen_model(tmp_path: Path) -> None:
    path = tmp_path / "cart.yaml"
    path.write_text("name: blue\nwheels:\n  - {kind: steel, radius: 1}\n")
    cart = load_config(Cart, path, ["load=3"])
    assert cart == Cart(name="blue", load=3, wheels=(Wheel(kind="steel", radius=1.0),))


def test_every_problem_is_listed_with_its_place_what_was_got_and_what_is_allowed() -> None:
    text = "name: blue\nload: 11\nwheels:\n  - radius: -1\n    knd: steel\n  - {kind: stel}\ncolour: red\n"
    assert problems_of(text) == [
        "cart.yaml:2:1: load: got 11; allowed: less than or equal to 8",
        "cart.yaml:4:5: wheels.0.radius: got -1; allowed: greater than 0",
        "cart.yaml:5:5: wheels.0.knd: unknown key; allowed: kind, radius; did you mean 'kind'?",
        "cart.yaml:6:6: wheels.1.kind: got 'stel'; allowed: rubber, steel; did you mean 'steel'?",
        "cart.yaml:7:1: colour: unknown key; allowed: name, load, wheels, axle",
    ]


def test_unknown_keys_inside_an_optional_model_get_its_fields_as_allowed() -> None:
    (problem,) = problems_of("name: a\naxle: {radus: 1}")
    assert "axle.radus: unknown key; allowed: kind, radius; did you mean 'radius'?" in problem


def test_a_missing_key_is_reported_at_the_mapping_that_lacks_it() -> None:
    assert problems_of("load: 1") == ["cart.yaml:1:1: name: is missing; allowed: this key is required"]


@pytest.mark.parametrize("value", ["yes", "'3'", "true", "1.5"])
def test_values_are_not_converted_silently(value: str) -> None:
    assert "load" in problems_of(f"name: a\nload: {value}")[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "file is empty"),
        ("- a\n- b", "the top level is a sequence"),
        ("name: a\nname: b", "2:1: name: key is given twice"),
        ("name:\n\t- b", "a tab"),
        ("name: &x a\nload: *x", "1:7: anchor or alias 'x'"),
        ("name: .nan", "a finite number"),
        ("name: -.inf", "a finite number"),
        ("name: 1e999", "a finite number"),
        ("name: !!python/object:os.system x", "tag"),
        ("name: [1, 2", "1:12"),
        ("a: b: c", "1:5"),
        ("[" * 40, "nested too deeply"),
        ("{a: 1}: b", "as a key"),
        ("name: \x00", "unacceptable character"),
        ("a: 1\n---\nb: 2", "but found another document"),
    ],
)
def test_what_no_configuration_needs_is_refused(text: str, expected: str) -> None:
    with pytest.raises(FileError) as caught:
        parse_yaml(text, "cart.yaml")
    assert expected in str(caught.value)


def test_an_anchor_bomb_is_refused_before_it_grows() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 30)]
    with pytest.raises(FileError, match="anchor"):
        parse_yaml("\n".join(lines), "bomb.yaml")


@pytest.mark.parametrize("content", [b"name: \xff\xfe", b"name: " + b"x" * 300_000])
def test_unreadable_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "cart.yaml"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"UTF-8|too large"):
        load_config(Cart, path)


@pytest.mark.parametrize("name", ["missing.yaml", "."])
def test_missing_files_and_folders_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError, match="cannot be read"):
        load_config(Cart, tmp_path / name)


def test_overrides_are_typed_as_yaml_and_reach_lists_and_new_mappings() -> None:
    document = parse_yaml("name: a\nwheels: [{kind: steel}]", "cart.yaml")
    cart = validate(Cart, override(document, ["name='7'", "wheels.0.radius=2", "axle.kind=steel", "load=0x4"]))
    assert cart.name == "7"
    assert cart.wheels[0].radius == 2.0
    assert cart.axle == Wheel(kind="steel")
    assert cart.load == 4
    assert document.data["name"] == "a"


def test_a_wrong_override_is_reported_as_such() -> None:
    assert problems_of("name: a", ["lod=3", "load=9", "axle.knd=steel"]) == [
        "--set: axle.knd: unknown key; allowed: kind, radius; did you mean 'kind'?",
        "--set: load: got 9; allowed: less than or equal to 8",
        "--set: lod: unknown key; allowed: name, load, wheels, axle; did you mean 'load'?",
    ]


@pytest.mark.parametrize("assignment", ["load", "=3", "a..b=3", "load=[", "name.x=1", "wheels.first.kind=steel"])
def test_malformed_overrides_are_refused(assignment: str) -> None:
    (problem,) = problems_of("name: a\nwheels: []", [assignment])
    assert problem.startswith("--set: ")


@dataclass(frozen=True, kw_only=True)
class Tyre:
    width: Annotated[float, Field(gt=0)] = 0.1
    rim: float = 0.05

    def __post_init__(self) -> None:
        if self.rim >= self.width:
            raise InvalidInput(f"rim must be narrower than width, got {self.rim}")


def test_options_dataclasses_are_checked_like_models() -> None:
    document = parse_yaml("tyre:\n  type: big\n  width: 2\n", "cart.yaml")
    assert validate_options(Tyre, document, ("tyre",), reserved=("type",)) == Tyre(width=2.0)
    assert validate_options(Tyre, document, ("other",), defaults={"width": 3.0}) == Tyre(width=3.0)


def test_an_options_check_of_its_own_is_reported_at_the_key_it_names() -> None:
    document = parse_yaml("tyre:\n  width: 2\n  rim: 3\n", "cart.yaml")
    with pytest.raises(FileError, match=r"cart.yaml:3:3: tyre.rim: rim must be narrower"):
        validate_options(Tyre, document, ("tyre",))


def test_options_that_are_no_mapping_are_refused() -> None:
    with pytest.raises(FileError, match="1:1: tyre: got 3; allowed: key: value lines"):
        validate_options(Tyre, parse_yaml("tyre: 3", "cart.yaml"), ("tyre",))


@pytest.mark.parametrize(
    "text",
    ["name: !!bool x", "load: !!int ''", "load: !!float ''", "wheels: !!set {a, b}", 'name: "\\ud800"', '"\\udfff": 1'],
)
def test_scalars_and_tags_that_mean_nothing_are_refused_at_their_place(text: str) -> None:
    with pytest.raises(FileError) as caught:
        parse_yaml(f"# cart\n{text}", "cart.yaml")
    assert str(caught.value).startswith("cart.yaml:2:")


def test_of_very_many_problems_the_first_are_listed() -> None:
    unknown = problems_of("name: a\n" + "".join(f"k{k}: 1\n" for k in range(5000)))
    twice = problems_of("name: a\n" * 3000)
    assert len(unknown) == len(twice) == 100
    assert unknown[-1].startswith("cart.yaml:101:1: k99: unknown key")
    assert twice[-1].startswith("cart.yaml:101:1: name: key is given twice")


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        (".".join(["axle"] * 3000) + "=1", "3000 levels deep; allowed: at most 16"),
        ("load=3\nname: other", "sets more than one key"),
        ("\udcff=1", "allowed: KEY=VALUE"),
        ("name=\udcff", "not allowed"),
    ],
)
def test_hostile_assignments_are_problems(assignment: str, message: str) -> None:
    (problem,) = problems_of("name: a", [assignment])
    assert problem.startswith("--set: ")
    assert message in problem
