"""Whether a MuJoCo model file compiles."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco

from grape.errors import FileError, Problem


def check_mjcf(path: Path) -> None:
    """Compile an MJCF file with the files, meshes and textures that it names.

    Raises:
        FileError: with MuJoCo's reason and, where it tells one, the line.
    """
    try:
        mujoco.MjSpec.from_file(str(path)).compile()
    except (ValueError, OSError, RuntimeError) as error:
        text = " ".join(str(error).split())
        line = re.search(r"line (\d+)", text)
        place = int(line[1]) if line else 0
        raise FileError(
            [Problem(file=str(path), line=place, got=text, allowed="a model that MuJoCo compiles")]
        ) from error
