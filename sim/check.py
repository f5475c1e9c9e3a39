"""Whether a MuJoCo model file compiles."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco

from grape.errors import FileError, Problem
from grape.kinematics.mjcf import read_mjcf

MOST_ELEMENTS = 50_000  # with all copies; a robot has some hundreds, and MuJoCo copies for hours without a word
COPYING = ("replicate", "flexcomp")


def check_mjcf(path: Path) -> None:
    """Compile an MJCF file with the files, meshes and textures that it names.

    Raises:
        FileError: with MuJoCo's reason and, where it tells one, the line.
        InvalidInput: it is no XML.
    """
    _refuse_endless(path)
    try:
        mujoco.MjSpec.from_file(str(path)).compile()
    except (ValueError, OSError, RuntimeError) as error:
        text = " ".join(str(error).split())
        line = re.search(r"line (\d+)", text)
        place = int(line[1]) if line else 0
        raise FileError(
            [Problem(file=str(path), line=place, got=text, allowed="a model that MuJoCo compiles")]
        ) from error


def _refuse_endless(path: Path) -> None:
    """Refuse a model whose nested copies would never end."""
    elements, waiting = 0, [(read_mjcf(path), 1)]
    while waiting:
        element, copies = waiting.pop()
        if element.tag in COPYING:
            copies *= math.prod(int(count) for count in element.get("count", "").split() if count.isdigit())
        elements += copies
        if elements > MOST_ELEMENTS:
            got = f"<{element.tag}>, {copies} times: too many elements"
            raise FileError([Problem(file=str(path), got=got, allowed=f"at most {MOST_ELEMENTS} with all copies")])
        waiting += [(child, copies) for child in element]
