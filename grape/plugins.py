"""What can be plugged in: tasks, robots, worlds, experiments, benches, costmap layers, global and local planners.

They are built in or of installed packages.

A package adds its own through entry points, without grape knowing it:

    [project.entry-points."grape.tasks"]
    pruning = "vine_pruning:TASK"

Finding names imports nothing; `load` imports the one plugin that is asked for.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import AfterValidator

from grape.errors import GrapeError, InvalidInput, with_suggestion

GRAPE = "grape"  # where the built-in ones come from
TASKS, ROBOTS, WORLDS = "grape.tasks", "grape.robots", "grape.worlds"
EXPERIMENTS, BENCHES = "grape.experiments", "grape.benches"
LAYERS = "grape.costmap_layers"
GLOBAL_PLANNERS, LOCAL_PLANNERS = "grape.global_planners", "grape.local_planners"

BUILT_IN: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        TASKS: {"dispenser": "grape.tasks.dispenser:TASK"},
        ROBOTS: {
            "husky_jaco2": "grape.robots.husky_jaco2:DESCRIPTION",
            "robi_jaco2": "grape.robots.robi_jaco2:DESCRIPTION",
        },
        WORLDS: {"vineyard": "grape.sim.worlds:VINEYARD"},
        EXPERIMENTS: {
            "G2": "grape.experiments.g2_odometry:EXPERIMENT",
            "G3": "grape.experiments.g3_mapping:EXPERIMENT",
            "G4": "grape.experiments.g4_costmaps:EXPERIMENT",
            "G5": "grape.experiments.g5_local_planners:EXPERIMENT",
            "G5-goal": "grape.experiments.g5_goal_poses:EXPERIMENT",
            "G6": "grape.experiments.g6_arm_motion:EXPERIMENT",
            "G7": "grape.experiments.g7_scanning:EXPERIMENT",
            "G8": "grape.experiments.g8_deployment_points:EXPERIMENT",
            "G10": "grape.experiments.g10_servoing:EXPERIMENT",
            "G12": "grape.experiments.g12_nail_servoing:EXPERIMENT",
            "G13": "grape.experiments.g13_spur_servoing:EXPERIMENT",
            "G9": "grape.experiments.deployments:G9",
            "G11": "grape.experiments.deployments:G11",
            "G12-hanging": "grape.experiments.deployments:G12",
            "G13-hanging": "grape.experiments.deployments:G13",
            "G14": "grape.experiments.deployments:G14",
            "G15": "grape.experiments.deployments:G15",
            "G19": "grape.experiments.deployments:G19",
            "B1": "grape.experiments.base_placement:EXPERIMENT",
            "K1": "grape.experiments.kill_resume:EXPERIMENT",
            "S1": "grape.experiments.soak:EXPERIMENT",
        },
        BENCHES: {
            "manipulation": "grape.experiments.bench_manipulation:BENCH",
            "navigation": "grape.experiments.bench_navigation:BENCH",
        },
        LAYERS: {
            "static": "grape.navigation.layers:StaticLayer",
            "obstacles": "grape.navigation.costmap:ObstacleLayer",
            "polygons": "grape.navigation.costmap:PolygonLayer",
            "denoise": "grape.navigation.layers:DenoiseLayer",
            "footprint": "grape.navigation.layers:FootprintLayer",
            "inflation": "grape.navigation.layers:InflationLayer",
        },
        GLOBAL_PLANNERS: {"legs": "grape.navigation.planner:plan_route"},
        LOCAL_PLANNERS: {
            "pure_pursuit": "grape.navigation.follower:PurePursuit",
            "dwa": "grape.navigation.dwa:Dwa",
            "teb": "grape.navigation.teb:Teb",
            "mppi": "grape.navigation.mppi:Mppi",
        },
    }
)


class PluginError(GrapeError):
    """A plugin is unknown, named twice, or cannot be imported."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a task brings along.

    Attributes:
        actions: its `Action`s, those of grape's own that its trees use included.
        conditions: its `Condition`s, likewise.
        trees: tree files by name.
        missions: mission files by name.
        serves_plants: whether a mission has plants, whose outcomes in the ledger are its status; if not, the tree's
            end is.

    Raises:
        InvalidInput: something in `actions` or `conditions` is no node.
    """

    name: str
    summary: str
    actions: tuple[Any, ...] = ()
    conditions: tuple[Any, ...] = ()
    trees: Mapping[str, Path] = field(default_factory=dict)
    missions: Mapping[str, Path] = field(default_factory=dict)
    serves_plants: bool = True

    def __post_init__(self) -> None:
        for leaf in self.leaves:
            if not (hasattr(leaf, "goal_type") and hasattr(leaf, "name")):
                raise InvalidInput(f"task {self.name}: got {leaf!r} as a node; declare it with @action or @condition")

    @property
    def leaves(self) -> tuple[Any, ...]:
        """Every node that its trees may use."""
        return (*self.actions, *self.conditions)


@dataclass(frozen=True, kw_only=True)
class WorldType:
    """A kind of generated world.

    Attributes:
        options: frozen dataclass of what can be set, checked at construction.
        site: from options to the `grape.site.Site` that a surveyor would draw of it.
        grow: from a site and options to the world that `grape.sim.simulation.Simulation` takes.
    """

    options: type[Any]
    site: Callable[[Any], Any]
    grow: Callable[[Any, Any], Any]


CALLABLE = "collections.abc:Callable"
KINDS: Mapping[str, str] = MappingProxyType(
    {
        TASKS: "grape.plugins:Task",
        ROBOTS: "grape.robots.description:RobotDescription",
        WORLDS: "grape.plugins:WorldType",
        EXPERIMENTS: "grape.proof:Experiment",
        BENCHES: "grape.proof:Bench",
        LAYERS: CALLABLE,
        GLOBAL_PLANNERS: CALLABLE,
        LOCAL_PLANNERS: CALLABLE,
    }
)  # where the type of each group's plugins is


@dataclass(frozen=True, kw_only=True)
class Plugin:
    """Something that can be plugged in, not imported yet.

    Attributes:
        target: where it is, `package.module:attribute`.
        origin: `grape`, or the distribution that brings it.
        rival: the distribution that brings another one under this name; then neither can be loaded.
    """

    group: str
    name: str
    target: str
    origin: str = GRAPE
    rival: str = ""

    def load(self) -> Any:
        """Import it.

        Raises:
            PluginError: two have its name, its module cannot be imported or lacks the attribute, or it is of another
                kind.
        """
        if self.rival:
            owners = f"{self.origin} and by {self.rival}"
            raise PluginError(f"{self.group}: {self.name!r} is brought by {owners}; remove one")
        try:
            value = _import(self.target)
        except (Exception, SystemExit) as error:  # a script that was meant to be run exits when it is imported
            raise PluginError(
                f"{self.group} plugin {self.name!r} of {self.origin} ({self.target}) cannot be loaded:"
                f" {type(error).__name__}: {error}"
            ) from error
        kind = _import(KINDS.get(self.group, CALLABLE))
        if not isinstance(value, kind):
            raise PluginError(
                f"{self.group} plugin {self.name!r} of {self.origin} ({self.target}) must be a {kind.__name__},"
                f" got {type(value).__name__}"
            )
        return value


def _import(target: str) -> Any:
    """What `package.module:attribute` names."""
    module, _, attribute = target.partition(":")
    value: Any = importlib.import_module(module)
    for part in attribute.split(".") if attribute else ():
        value = getattr(value, part)
    return value


def find(group: str) -> Mapping[str, Plugin]:
    """Every plugin of a group (`TASKS`, `EXPERIMENTS`, …) by name; imports none.

    Raises:
        PluginError: no such group.
    """
    if group not in BUILT_IN:
        raise PluginError(f"no plugin group {group!r}; there are {', '.join(BUILT_IN)}")
    found = {name: Plugin(group=group, name=name, target=target) for name, target in BUILT_IN[group].items()}
    for entry in entry_points(group=group):
        origin = entry.dist.name if entry.dist is not None else "an unknown package"
        plugin = Plugin(group=group, name=entry.name, target=entry.value, origin=origin)
        known = found.setdefault(entry.name, plugin)
        if known.target != plugin.target:
            found[entry.name] = replace(known, rival=origin)
    return MappingProxyType(found)


def load(group: str, name: str) -> Any:
    """Import one plugin.

    Raises:
        PluginError: it is unknown, two have its name, or it cannot be imported.
    """
    found = find(group)
    if name not in found:
        allowed = ", ".join(sorted(found)) or "none"
        sentence = f"{group}: {name!r} is not installed; there are {allowed}"
        raise PluginError(with_suggestion(sentence, name, found))
    return found[name].load()


def names(group: str) -> AfterValidator:
    """What makes a text a plugin's name, checked with the file it stands in: `Annotated[str, names(LOCAL_PLANNERS)]`.

    The check raises InvalidInput when no plugin of this name can be loaded.
    """

    def check(name: str) -> str:
        try:
            load(group, name)
        except PluginError as error:
            raise InvalidInput(str(error)) from error
        return name

    return AfterValidator(check)
