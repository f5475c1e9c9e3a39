"""The mission file: which robot does which task on which plants of which world, by which tree."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from grape.config import Document, Model, load_yaml, override, read_text, validate, validate_options
from grape.errors import FileError, InvalidInput, Problem, did_you_mean
from grape.mission.catalog import (
    broken,
    mission_file,
    missions,
    robot_description,
    robots,
    tree_file,
    trees,
    world_type,
    worlds,
)
from grape.mission.faults import MissionFault, check_faults
from grape.mission.refill import Refill as Refill
from grape.mission.refill import check_refill
from grape.plugins import TASKS, PluginError, find, load
from grape.site import Plant, Site, load_site

MODES = {"nail": ("nail", "auto"), "vine": ("plant", "plant_open_loop", "auto")}  # the first is what auto means
Mode = Literal["nail", "plant", "plant_open_loop", "auto"]
SIMULATED = "simulated"  # as drivers: no robot's own
OF_SITE = "site"  # as a map: the site's own plants
MAP_FILE = "map.yaml"  # of a run folder
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=80)]


class PlantGoal(Model):
    """One plant of the site to serve; `auto` takes the nail where there is one, else the plant in closed loop."""

    plant: str
    mode: Mode = "auto"


class Selection(Model):
    """Plants chosen by number instead of by id: spread evenly over the site, in the site's order."""

    nails: Annotated[int, Field(ge=0, le=1000)] = 0
    vines: Annotated[int, Field(ge=0, le=1000)] = 0
    vine_mode: Literal["plant", "plant_open_loop"] = "plant"


class MissionFile(Model):
    """The keys of a mission file."""

    name: Name
    description: str = ""
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    robot: Name = "husky_jaco2"
    drivers: Name = SIMULATED
    task: Name = "dispenser"
    tree: str = "dispenser_deployment"
    world: dict[str, Any] = Field(default_factory=dict)
    site: str | None = None
    plants: tuple[PlantGoal, ...] | None = None
    select: Selection | None = None
    dispensers: Annotated[int, Field(ge=0, le=8)] = 8
    refill: Refill = Field(default_factory=Refill)
    arm_errors: Annotated[float, Field(ge=0, le=2)] = 0.0
    faults: tuple[MissionFault, ...] = ()
    map: str | None = None
    laser_odometry: bool = False
    time_limit_s: Annotated[float, Field(gt=0, le=86400)] = 1500.0
    actions: dict[str, dict[str, Any]] = Field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Mission:
    """A mission that was checked and is ready to run.

    Attributes:
        file: what the user wrote, with defaults filled in.
        tree: the tree file.
        world: options of the world's generator.
        site: the surveyed site, or the one that the generator lays out.
        surveyed: whether the site is the user's.
        map: `grape.mapping.OccupancyGrid` to localise on by the base's laser; None: by wheels, IMU and GNSS alone.
        actions: defaults of goal fields by node, with the types of the fields.
    """

    file: MissionFile
    tree: Path
    world: Any
    site: Site
    surveyed: bool
    plants: tuple[PlantGoal, ...]
    map: Any = None
    actions: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def seed(self) -> int:
        return self.file.seed

    @property
    def stock(self) -> int:
        """Dispensers that are ready for refills: none where the site has no refill point."""
        if not self.site.refills:
            return 0
        stock = self.file.refill.stock
        return max(0, len(self.plants) - self.file.dispensers) if stock is None else stock

    def resolved(self) -> dict[str, Any]:
        """The mission as it runs, every default written out; loading it again gives the same mission."""
        data = self.file.model_dump(mode="json", exclude={"select"}, exclude_none=True)
        world = {key: value for key, value in dataclasses.asdict(self.world).items() if value != ()}
        data["world"] = {"type": self.file.world.get("type", "vineyard"), **world}
        if self.plants:
            data["plants"] = [plant.model_dump() for plant in self.plants]
        data["refill"]["stock"] = self.stock
        if self.surveyed:
            data["site"] = "site.geojson"
        if self.file.map not in (None, OF_SITE):
            data["map"] = MAP_FILE
        return data


def load_mission(name: str, overrides: Iterable[str] = (), world: Path | None = None) -> Mission:
    """A mission by built-in name or path, checked against robot, tree, site and plants.

    Args:
        overrides: `key=value` assignments to any key of the file.
        world: replaces the mission's world: a YAML file with the keys of `world`, or a site's GeoJSON.

    Raises:
        FileError: with every problem found.
    """
    path = mission_path(name)
    document = load_yaml(path)
    if world is not None:
        document = _with_world(document, world)
    document = override(document, overrides)
    file = validate(MissionFile, document)
    problems: list[Problem] = []
    tree = _check_names(file, document, path.parent, problems)
    options, site = None, None
    try:
        options, site = _world_and_site(file, document, path.parent)
    except FileError as error:
        problems += error.problems
    plants = _plants(file, document, site, problems) if site is not None else ()
    actions = _actions(file, tree, document, problems)
    if site is not None:
        problems += check_refill(file.refill, site, document)
    if file.robot in robots():
        problems += check_faults(file.faults, robot_description(file.robot), document)
        problems += _drivers(file, document)
    grid = _map(file, document, path.parent, site, problems)
    if problems or options is None or site is None:
        raise FileError(problems)
    surveyed = file.site is not None
    return Mission(
        file=file,
        tree=tree,
        world=options,
        site=site,
        surveyed=surveyed,
        plants=plants,
        map=grid,
        actions=actions,
    )


def mission_path(name: str) -> Path:
    """The file of a mission named by a user: a path, or the name of a built-in mission.

    Raises:
        FileError: neither exists.
        PluginError: several tasks bring a mission of that name.
    """
    brought = mission_file(name)
    if brought is not None:
        return brought
    path = Path(name)
    if path.is_file():
        return path
    if path.suffix in (".yaml", ".yml") or "/" in name:
        read_text(path)
    known = missions()
    allowed, hint = f"{', '.join(known)}, or the path of a YAML file", did_you_mean(name, known)
    unknown = Problem(file=name, got="no such mission", allowed=allowed, suggestion=hint)
    raise FileError([unknown, *(Problem(file=name, got=text) for text in broken((TASKS,)))])


def _with_world(document: Document, path: Path) -> Document:
    """The document with its world replaced by a file's; problems then point into that file."""
    data = dict(document.data)
    if path.suffix in (".geojson", ".json"):
        data["site"] = str(path.resolve())
        return Document(file=document.file, data=data, places=document.places)
    replacement = load_yaml(path)
    data["world"] = replacement.data
    return Document(file=document.file, data=data, places=document.places, included={("world",): replacement})


def _check_names(file: MissionFile, document: Document, folder: Path, problems: list[Problem]) -> Path:
    """Robot, task and tree must exist; returns the tree's file."""
    for kind, value, known in (("robot", file.robot, robots()), ("task", file.task, tuple(find(TASKS)))):
        if value not in known:
            hint = did_you_mean(value, known)
            problems.append(document.problem((kind,), f"got {value!r}", ", ".join(known), hint))
    try:
        brought = tree_file(file.tree, file.task)
    except PluginError as error:
        problems.append(document.problem(("tree",), str(error)))
        return folder / file.tree
    if brought is not None:
        return brought
    tree = folder / file.tree
    if not tree.is_file():
        known_trees = trees()
        allowed, hint = f"{', '.join(known_trees)}, or the path of an XML file", did_you_mean(file.tree, known_trees)
        problems.append(document.problem(("tree",), f"got {file.tree!r}", allowed, hint))
    return tree


def _world_and_site(file: MissionFile, document: Document, folder: Path) -> tuple[Any, Site]:
    kind = file.world.get("type", "vineyard")
    known = worlds()
    if kind not in known:
        allowed = ", ".join(known)
        raise FileError([document.problem(("world", "type"), f"got {kind!r}", allowed, did_you_mean(str(kind), known))])
    world = world_type(kind)
    options = validate_options(world.options, document, ("world",), reserved=("type",), defaults={"seed": file.seed})
    if file.site is None:
        return options, world.site(options)
    path = folder / file.site
    if not path.is_file():
        raise FileError([document.problem(("site",), f"got {file.site!r}", "the path of a GeoJSON file")])
    return options, load_site(path)


def _drivers(file: MissionFile, document: Document) -> Iterator[Problem]:
    """The robot must have the drivers that are named; on its own ones nothing is laid out or put wrong."""
    if file.drivers == SIMULATED:
        return
    known = (SIMULATED, *robot_description(file.robot).drivers)
    if file.drivers not in known:
        hint = did_you_mean(file.drivers, known)
        yield document.problem(("drivers",), f"{file.robot} has no {file.drivers!r}", ", ".join(known), hint)
    if file.site is None:
        yield document.problem(("drivers",), "there is no site", f"with {file.drivers!r} the GeoJSON of a real one")
    for key, given in (("faults", file.faults), ("arm_errors", file.arm_errors)):
        if given:
            yield document.problem((key,), f"got it beside the drivers {file.drivers!r}", "in simulation alone")


def _map(file: MissionFile, document: Document, folder: Path, site: Site | None, problems: list[Problem]) -> Any:
    """The map that the mission names, if any."""
    if file.map is None or site is None:
        return None
    from grape.mapping import load_map, map_of_site

    try:
        if file.map == OF_SITE:
            return map_of_site(site)
        if (folder / file.map).is_file():
            return load_map(folder / file.map)
        allowed = f"{OF_SITE}, or the path of a map's YAML file"
        problems.append(document.problem(("map",), f"got {file.map!r}", allowed))
    except FileError as error:
        problems += error.problems
    except InvalidInput as error:
        problems.append(document.problem(("map",), str(error)))
    return None


def _actions(
    file: MissionFile, tree: Path, document: Document, problems: list[Problem]
) -> Mapping[str, Mapping[str, Any]]:
    """Defaults of goal fields, checked against the nodes of the task and the tree."""
    if not file.actions or file.task not in find(TASKS):
        return {}
    from grape.mission.goal_defaults import goal_defaults

    checked, wrong = goal_defaults(file.actions, file.task, tree, document)
    problems += wrong
    return checked


def _plants(file: MissionFile, document: Document, site: Site, problems: list[Problem]) -> tuple[PlantGoal, ...]:
    """The plants to serve, each checked against the site; none where the task serves none."""
    if file.task in find(TASKS) and not load(TASKS, file.task).serves_plants:
        for key, given in (("plants", file.plants), ("select", file.select)):
            if given is not None:
                problems.append(document.problem((key,), f"the task {file.task!r} serves no plants", "no such key"))
        return ()
    if file.plants is not None and file.select is not None:
        problems.append(document.problem(("select",), "both plants and select are given", "one of the two"))
        return ()
    if file.plants is None:
        return _selected(file.select or Selection(nails=2, vines=2), document, site, problems)
    by_id = {plant.id: plant for plant in site.plants}
    seen: set[str] = set()
    for k, goal in enumerate(file.plants):
        if goal.plant not in by_id:
            hint, allowed = did_you_mean(goal.plant, by_id), _shortened(list(by_id))
            problems.append(document.problem(("plants", k, "plant"), f"the site has no {goal.plant!r}", allowed, hint))
        elif goal.mode not in MODES[by_id[goal.plant].kind]:
            kind = by_id[goal.plant].kind
            got = f"got {goal.mode!r} for {goal.plant}, a {kind}"
            problems.append(document.problem(("plants", k, "mode"), got, ", ".join(MODES[kind])))
        if goal.plant in seen:
            problems.append(
                document.problem(("plants", k, "plant"), f"{goal.plant!r} is listed twice", "each plant once")
            )
        seen.add(goal.plant)
    if not file.plants:
        problems.append(document.problem(("plants",), "the list is empty", "at least one plant"))
    return tuple(_resolved(goal, by_id) for goal in file.plants)


def _resolved(goal: PlantGoal, by_id: Mapping[str, Plant]) -> PlantGoal:
    """The goal with the mode that `auto` stands for."""
    if goal.mode != "auto" or goal.plant not in by_id:
        return goal
    return goal.model_copy(update={"mode": MODES[by_id[goal.plant].kind][0]})


def _selected(selection: Selection, document: Document, site: Site, problems: list[Problem]) -> tuple[PlantGoal, ...]:
    chosen: dict[str, Mode] = {}
    wishes: tuple[tuple[str, str, int, Mode], ...] = (
        ("nails", "nail", selection.nails, "nail"),
        ("vines", "vine", selection.vines, selection.vine_mode),
    )
    for key, kind, number, mode in wishes:
        ids = [plant.id for plant in site.plants if plant.kind == kind]
        if number > len(ids):
            problems.append(
                document.problem(("select", key), f"got {number}", f"at most {len(ids)}, what the site has")
            )
            continue
        chosen |= {ids[(2 * k + 1) * len(ids) // (2 * number)]: mode for k in range(number)}
    if not chosen and not problems:
        problems.append(document.problem(("select",), "no plant is selected", "nails or vines above 0"))
    ordered = [plant.id for plant in _in_working_order(site) if plant.id in chosen]
    return tuple(PlantGoal(plant=id, mode=chosen[id]) for id in ordered)


def _in_working_order(site: Site) -> list[Any]:
    """Plants row by row, along each row as a robot drives that has it on its left."""

    def along(plant: Any) -> float:
        return float(plant.position @ site.row(plant.row).work_direction)

    order = {row.id: k for k, row in enumerate(site.rows)}
    return sorted(site.plants, key=lambda plant: (order[plant.row], along(plant)))


def _shortened(names: list[str], limit: int = 12) -> str:
    return ", ".join(names[:limit]) + (f", … ({len(names)} in all)" if len(names) > limit else "")
