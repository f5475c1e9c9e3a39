"""From a checked mission to a complete run folder, in simulation or on the robot's own drivers."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from grape import __version__
from grape.errors import InvalidInput
from grape.folders import open_folder, refuse_unwritable_folder
from grape.mission.catalog import nodes, robot_description, world_type
from grape.mission.file import MAP_FILE, OF_SITE, SIMULATED, Mission, load_mission
from grape.mission.film import Film
from grape.mission.ledger import SqliteLedger
from grape.mission.lock import RunLock
from grape.mission.progress import Progress
from grape.mission.real import connected, resumed_at
from grape.mission.record import read_events, write_atomic
from grape.mission.result import build_result, write_result
from grape.mission.result_file import read_result
from grape.mission.runner import Backend, Runner
from grape.mission.track import csv_of
from grape.site import save_site

UNATTENDED_S = 1.0  # simulated between a kill and the next session: longer than any actuator's time-out
WORLD_FOLDER = "world"  # the simulated world's own; no robot reads it
INPUTS = ("mission.yaml", "tree.xml", "site.geojson")
MAP_FILES = (MAP_FILE, "map.pgm")  # of missions with a map of their own


@dataclass(frozen=True, kw_only=True)
class MissionRun:
    """A finished run: its folder, the content of its result.json, and whether anything was left to do."""

    folder: Path
    result: dict[str, Any]
    resumed: bool = True


def run_mission(
    mission: Mission,
    out: Path | None = None,
    *,
    cancelled: Callable[[], bool] = lambda: False,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    render: bool = False,
) -> MissionRun:
    """Run a mission; the folder appears only when everything it needs could be built and connected.

    Args:
        out: a folder that does not exist or is empty; default `runs/<mission>-seed<N>-<n>`.
        cancelled: asked every beat; true ends the mission as aborted.
        on_progress: called a few times a second.
        render: also keep pictures of a camera that follows the simulated robot.

    Raises:
        FileError: the tree file has problems.
        InvalidInput: robot, world, drivers and options do not fit together, or `out` cannot be
            written or holds something.
        PluginError: the robot's own drivers cannot be imported.
        DriverError: they cannot be connected.
    """
    refuse_used(out)
    if render and mission.file.drivers != SIMULATED:
        raise InvalidInput(f"--render needs a simulation, this mission has the drivers {mission.file.drivers!r}")
    with open_scene(mission) as scene:
        folder = make_folder(out, mission)
        with RunLock(folder):
            write_inputs(mission, folder)
            result = execute(scene, folder, cancelled=cancelled, on_progress=on_progress, render=render)
    return MissionRun(folder=folder, result=result)


def resume_mission(
    folder: Path,
    *,
    cancelled: Callable[[], bool] = lambda: False,
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> MissionRun:
    """Go on with a mission that a kill or Ctrl-C has ended; one that has ended by itself stays as it is.

    Args:
        folder: of the run.
        cancelled, on_progress: as of `run_mission`.

    Raises:
        InvalidInput: the folder is no run, another process is at it, or mission or version have changed since.
    """
    if not (folder / "mission.yaml").is_file():
        raise InvalidInput(f"{folder}: no run folder, it has no mission.yaml; runs are started by `grape run`")
    with RunLock(folder):
        earlier = ended_result(folder)
        if earlier is not None:
            if not (folder / "report.html").exists():  # killed while it was written
                from grape.mission.report import write_report

                write_report(folder)
            return MissionRun(folder=folder, result=earlier, resumed=False)
        refuse_changed(folder)
        mission = load_mission(str(folder / "mission.yaml"))
        if mission.file.drivers == SIMULATED:
            refuse_lost_world(folder)
        with open_scene(mission, folder) as scene:
            result = execute(scene, folder, cancelled=cancelled, on_progress=on_progress, resume=True)
    return MissionRun(folder=folder, result=result)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Everything that is built before a run folder is touched.

    Attributes:
        simulation: also the backend; None on the robot's own drivers.
    """

    mission: Mission
    tree: Any
    robot: Any
    backend: Backend
    simulation: Any = None


@contextmanager
def open_scene(mission: Mission, earlier: Path | None = None) -> Iterator[Scene]:
    """Tree, robot and what it runs on, which is closed at the end of the block.

    Args:
        earlier: folder of the run that goes on; None for a new one.
    """
    from grape.actions.robot import build_robot
    from grape.bt import load_tree

    tree = load_tree(mission.tree, nodes(mission.file.task))
    description = robot_description(mission.file.robot)
    robot = build_robot(description)
    if mission.file.drivers != SIMULATED:
        start_s = 0.0 if earlier is None else resumed_at(earlier)
        with connected(description, mission.file.drivers, start_s) as backend:
            yield Scene(mission=mission, tree=tree, robot=robot, backend=backend)
        return
    simulation = simulate(mission, description)
    try:
        yield Scene(mission=mission, tree=tree, robot=robot, backend=simulation, simulation=simulation)
    finally:
        simulation.close()


def simulate(mission: Mission, description: Any) -> Any:
    """The simulation of a mission's world and robot."""
    from grape.sim.drivers import SensorOptions
    from grape.sim.drivers.arm import ArmDriverOptions
    from grape.sim.drivers.operator import OperatorOptions
    from grape.sim.simulation import Simulation, SimulationOptions

    world = world_type(mission.file.world.get("type", "vineyard")).grow(mission.site, mission.world)
    operator = OperatorOptions(fill=mission.file.refill.fill, after_s=mission.file.refill.after_s)
    sensors = SensorOptions(arm=ArmDriverOptions(errors=mission.file.arm_errors), operator=operator)
    options = SimulationOptions(
        dispensers=mission.file.dispensers, stock=mission.stock, sensors=sensors, faults=planned_faults(mission)
    )
    return Simulation(world, description, seed=mission.seed, options=options)


def planned_faults(mission: Mission) -> tuple[tuple[float, Any], ...]:
    """What goes wrong in a mission, with the time of each, for the simulation."""
    from grape.sim.faults import FreezeSensor, GnssJump

    planned: list[tuple[float, Any]] = []
    for fault in mission.file.faults:
        if fault.silent is not None:
            planned.append((fault.at_s, FreezeSensor(name=fault.silent)))
            planned.append((fault.at_s + fault.for_s, FreezeSensor(name=fault.silent, frozen=False)))
        elif fault.gnss_jump is not None:
            bias = np.array([*fault.gnss_jump, 0.0])
            planned.append((fault.at_s, GnssJump(bias=bias, duration_s=fault.for_s, wrong_fix=True)))
    return tuple(planned)


def execute(
    scene: Scene,
    folder: Path,
    *,
    cancelled: Callable[[], bool],
    on_progress: Callable[[Progress], None],
    render: bool = False,
    resume: bool = False,
) -> dict[str, Any]:
    """Run, or go on with, the mission of a scene in its folder; returns the content of result.json."""
    from grape.bt import TreeExecutor

    simulation = scene.simulation
    if simulation is not None and simulation.keep(folder / WORLD_FOLDER):
        for _ in range(round(UNATTENDED_S * 100)):  # what the world did while nobody spoke to the actuators
            simulation.advance()
    referee = simulation.referee if simulation is not None else None
    film = Film(folder, lambda: simulation.render(width=640, height=480)) if render else None
    runner = Runner(
        scene.mission,
        scene.backend,
        scene.robot,
        folder,
        make_tree=lambda context: TreeExecutor(scene.tree, context),
        referee=referee,
        cancelled=cancelled,
        on_progress=on_progress,
        on_beat=film.see if film is not None else lambda now: None,
        resume=resume,
        facts=identity(folder),
    )
    for name in ("result.json", "report.html"):  # of an earlier session; now everything that it left could be read
        (folder / name).unlink(missing_ok=True)
    result = finish(scene.mission, runner, referee, folder)
    if film is not None:
        film.close()
    return result


def identity(folder: Path) -> dict[str, str]:
    """What a ledger remembers of the program and the inputs that it was begun with."""
    maps = (name for name in MAP_FILES if (folder / name).exists())
    inputs = b"".join((folder / name).read_bytes() for name in (*INPUTS, *maps))
    return {"grape": __version__, "inputs": hashlib.sha256(inputs).hexdigest()}


def ended_result(folder: Path) -> dict[str, Any] | None:
    """The result of a run that has ended by itself; None when it can be resumed."""
    path = folder / "result.json"
    if not path.exists():
        return None
    result = read_result(path)
    return None if result["ended_by"] == "aborted" else result


def refuse_changed(folder: Path) -> None:
    """Refuse to go on with other inputs or another program than the run was begun with.

    Raises:
        InvalidInput: they differ, or files are missing.
    """
    if not (folder / "ledger.sqlite").exists():
        return  # killed before anything was done
    missing = [name for name in INPUTS if not (folder / name).exists()]
    if missing:
        raise InvalidInput(f"{folder}: {', '.join(missing)} of the run is missing")
    ledger = SqliteLedger.open(folder / "ledger.sqlite")
    begun, now = ledger.facts(), identity(folder)
    ledger.close()
    if begun.get("grape") != now["grape"]:
        raise InvalidInput(f"{folder}: grape {begun.get('grape')} began this run, this is grape {now['grape']}")
    if begun.get("inputs") != now["inputs"]:
        raise InvalidInput(f"{folder}: {', '.join(INPUTS)} or its map differ from those that the run was begun with")


def refuse_lost_world(folder: Path) -> None:
    """Refuse to go on in a simulation whose world has been deleted or damaged.

    Raises:
        InvalidInput: it is not there, and something was done in it.
    """
    from grape.sim.checkpoint import kept_time

    if kept_time(folder / WORLD_FOLDER) is not None or not (folder / "ledger.sqlite").exists():
        return
    ledger = SqliteLedger.open(folder / "ledger.sqlite")
    moved = ledger.last_step() is not None
    ledger.close()
    if moved:
        raise InvalidInput(
            f"{folder}: the simulated world, {WORLD_FOLDER}/, is gone or damaged; the robot has nowhere to go on"
        )


def finish(mission: Mission, runner: Runner, referee: Any, folder: Path) -> dict[str, Any]:
    """Run the beats and write what they came to; `referee` is None on the robot's own drivers."""
    from grape.mission.report import write_report

    finding = runner.run()
    events = list(read_events(folder / "events.jsonl"))
    verdict = referee.verdict() if referee is not None else None
    result = build_result(mission, finding, runner.ledger, events, verdict)
    runner.close()
    truth = None
    if referee is not None:
        truth = np.array([(s.time_s, s.x, s.y, s.yaw) for s in referee.path]).reshape(-1, 4)
        write_atomic(folder / "standing.csv", csv_of("x_m,y_m", referee.standing()))
    write_atomic(folder / "path.csv", finding.track.to_csv(truth))
    write_result(result, folder)
    write_report(folder)
    return result


def make_folder(out: Path | None, mission: Mission) -> Path:
    """Create the run folder.

    Raises:
        InvalidInput: `out` cannot be written, or is a folder that holds something.
    """
    refuse_used(out)
    return open_folder(out, f"{mission.name}-seed{mission.seed}")


def refuse_used(out: Path | None) -> None:
    """Refuse a run folder that is not new or cannot be written: also before the work begins.

    Raises:
        InvalidInput: `out` cannot be written, or is a folder that holds something.
    """
    refuse_unwritable_folder(out)
    if out is not None and out.exists() and any(out.iterdir()):
        raise InvalidInput(f"--out {out}: it exists and is not empty; name a new folder")


def write_inputs(mission: Mission, folder: Path) -> None:
    """Keep exactly what runs: `grape run FOLDER/mission.yaml` repeats it.

    Raises:
        FileError: the tree file, or one that it includes, cannot be read.
    """
    from grape.bt import merge_includes

    write_atomic(folder / "tree.xml", merge_includes(mission.tree))
    save_site(mission.site, folder / "site.geojson")
    if mission.map is not None and mission.file.map != OF_SITE:
        from grape.mapping import MapFormat, save_map

        save_map(mission.map, folder / MAP_FILE, MapFormat(mode="raw"))
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.width = 10_000  # a long text stays on its line: where it is folded, all but one of several spaces are lost
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    text = io.StringIO()
    yaml.dump({**mission.resolved(), "tree": "tree.xml"}, text)
    write_atomic(folder / "mission.yaml", text.getvalue())
