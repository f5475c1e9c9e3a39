"""`grape check`: everything that is wrong with the files a user names, all at once."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from grape.config import load_yaml, read_text, validate_options
from grape.errors import FileError, GrapeError, Problem, did_you_mean
from grape.mission.catalog import (
    mission_file,
    missions,
    nodes,
    robot_description,
    robots,
    tree_file,
    trees,
    world_type,
    worlds,
)
from grape.plugins import TASKS, load

KINDS = "mission or world (.yaml), site (.geojson), tree or MJCF (.xml), or the name of a robot, mission or tree"


def check_files(names: Iterable[str], task: str = "dispenser") -> tuple[dict[str, str], tuple[Problem, ...]]:
    """What each name turned out to be, and every problem of all of them.

    Args:
        names: paths or built-in names.
        task: whose nodes a tree file may use.

    Raises:
        PluginError: no such task.
    """
    load(TASKS, task)
    kinds: dict[str, str] = {}
    problems: list[Problem] = []
    for name in names:
        try:
            kinds[name] = _check(name, task)
        except FileError as error:
            problems += error.problems
        except GrapeError as error:
            problems.append(Problem(file=name, got=str(error)))
    return kinds, tuple(sorted(problems))


def _check(name: str, task: str) -> str:
    path = Path(name)
    if not path.is_file():  # a package's folder often has the name of what it brings
        return _check_name(name, task)
    if path.suffix in (".yaml", ".yml"):
        return _check_yaml(path)
    if path.suffix in (".geojson", ".json"):
        from grape.site import load_site

        site = load_site(path)
        return f"site with {len(site.rows)} rows and {len(site.plants)} plants"
    if path.suffix == ".xml":
        return _check_xml(path, task)
    raise FileError([Problem(file=name, got=f"ending {path.suffix!r}", allowed=KINDS)])


def _check_name(name: str, task: str) -> str:
    if name in robots():
        return _check_robot(name)
    if (mission := mission_file(name)) is not None:
        return _check_yaml(mission)
    if (tree := tree_file(name, task)) is not None:
        return _check_xml(tree, task)
    known = [*robots(), *missions(), *trees()]
    if "/" in name or Path(name).suffix:
        read_text(Path(name))
    raise FileError(
        [Problem(file=name, got="no such file or name", allowed=KINDS, suggestion=did_you_mean(name, known))]
    )


def _check_yaml(path: Path) -> str:
    from grape.mission.file import load_mission

    document = load_yaml(path)
    if "type" in document.data and "plants" not in document.data:
        kind, known = document.data["type"], worlds()
        if kind not in known:
            raise FileError([document.problem(("type",), f"got {kind!r}", ", ".join(known))])
        validate_options(world_type(kind).options, document, (), reserved=("type",))
        return f"world of type {kind}"
    mission = load_mission(str(path))
    _check_xml(mission.tree, mission.file.task)
    return f"mission {mission.name} with {len(mission.plants)} plants"


def _check_xml(path: Path, task: str) -> str:
    text = read_text(path, max_bytes=4_000_000)
    if re.search(r"<mujoco[\s>]", text):
        from grape.sim.check import check_mjcf

        check_mjcf(path)
        return "MJCF model"
    from grape.bt import load_tree

    load_tree(path, nodes(task))
    return "behaviour tree"


def _check_robot(name: str) -> str:
    from grape.actions.robot import build_robot
    from grape.sim.check import check_mjcf

    description = robot_description(name)
    check_mjcf(description.mjcf)
    build_robot(description)
    return f"robot {description.name}"
