"""Whether a MuJoCo model file compiles."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import mujoco

from grape.errors import FileError, Problem
from grape.xml_document import Element, read_document

MAX_BYTES = 4_000_000
MOST_ELEMENTS = 50_000  # with all copies; a robot has some hundreds, and MuJoCo copies for hours without a word
COPYING = ("replicate", "flexcomp")
# What MuJoCo makes room for by a number alone: it takes hours, all memory, or ends without a place.
MOST: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "size": {
            "memory": 2.0**30,
            "nkey": 1_000,
            **dict.fromkeys(("njmax", "nconmax"), 10_000),
            "nuserdata": 100_000,
            "nstack": 10_000_000,
            **{f"nuser_{of}": 1_000 for of in ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")},
        },
        "hfield": {"nrow": 5_000, "ncol": 5_000},
        "texture": {"width": 5_000, "height": 5_000},
        "mesh": {"params": 200},
        "camera": {"resolution": 5_000},
        "user": {"dim": 10_000},
        "contact": {"num": 10_000},
        "general": {"actdim": 10_000},
    }
)  # tag -> attribute -> the most that each of its numbers may be
_UNITS = {unit: 2.0 ** (10 * k) for k, unit in enumerate(("", "K", "M", "G", "T", "P", "E"))}


def check_mjcf(path: Path) -> None:
    """Compile an MJCF file with the files, meshes and textures that it names.

    Raises:
        FileError: with MuJoCo's reason and, where it tells one, the line.
    """
    refuse_endless(path)
    try:
        mujoco.MjSpec.from_file(str(path)).compile()
    except (ValueError, OSError, RuntimeError) as error:
        text = " ".join(str(error).split())
        line = re.search(r"line (\d+)", text)
        place = int(line[1]) if line else 0
        raise FileError(
            [Problem(file=str(path), line=place, got=text, allowed="a model that MuJoCo compiles")]
        ) from error


def refuse_endless(path: Path) -> None:
    """Refuse a model whose copies would never end, or that asks for more room than any needs.

    Raises:
        FileError: with the place in the file or in one that it includes.
    """
    elements, problems, included = 0, list[Problem](), {path.resolve()}
    waiting = [(read_document(path, MAX_BYTES), 1)]
    while waiting:
        element, copies = waiting.pop()
        if element.tag == "include":
            file = (path.parent / element.attributes.get("file", "")).resolve()
            if file in included:
                raise FileError([element.problem(f"{file} is included twice", "each file once", "", "file")])
            included.add(file)
            waiting += [(child, copies) for child in read_document(file, MAX_BYTES).children]
            continue
        problems += _too_large(element)
        if element.tag in COPYING:
            copies *= math.prod(int(count) for count in element.attributes.get("count", "").split() if count.isdigit())
        elements += copies
        if elements > MOST_ELEMENTS:
            got, allowed = f"{copies} times: too many elements", f"at most {MOST_ELEMENTS} with all copies"
            raise FileError([*problems, element.problem(got, allowed, "", "count")])
        waiting += [(child, copies) for child in element.children]
    if problems:
        raise FileError(problems)


def _too_large(element: Element) -> Iterator[Problem]:
    for name, most in MOST.get(element.tag, {}).items():
        text = element.attributes.get(name, "")
        if any(_number(word) > most for word in text.split()):
            yield element.problem(f"{name} is {text[:40]!r}", f"at most {most:.0f}", "", name)


def _number(word: str) -> float:
    """A number, also one of bytes like `16M`; 0 for what is none, which MuJoCo refuses itself."""
    unit = word[-1:].upper() if word[-1:].isalpha() else ""
    try:
        return float(word[: len(word) - len(unit)]) * _UNITS.get(unit, 1.0)
    except ValueError:
        return 0.0
