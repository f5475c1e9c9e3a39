"""From a checked mission to a complete run folder, in simulation."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from grape.actions.core import Context
from grape.errors import InvalidInput
from grape.mission.catalog import nodes, robot_description, world_type
from grape.mission.file import Mission
from grape.mission.progress import Progress
from grape.mission.record import read_events, write_atomic
from grape.mission.result import build_result, write_result
from grape.mission.runner import Runner
from grape.site import save_site

RENDER_PERIOD_S = 10.0


@dataclass(frozen=True, kw_only=True)
class MissionRun:
    """A finished run: its folder and the content of its result.json."""

    folder: Path
    result: dict[str, Any]


def run_mission(
    mission: Mission,
    out: Path | None = None,
    *,
    cancelled: Callable[[], bool] = lambda: False,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    render: bool = False,
) -> MissionRun:
    """Run a mission in simulation; the folder appears only when everything it needs could be built.

    Args:
        out: a folder that does not exist or is empty; default `runs/<mission>-seed<N>-<n>`.
        cancelled: asked every beat; true ends the mission as aborted.
        on_progress: called a few times a second.
        render: also keep pictures of a camera that follows the robot.

    Raises:
        FileError: the tree file has problems.
        InvalidInput: robot, world and options do not fit together, or `out` holds something.
    """
    from grape.actions.robot import build_robot
    from grape.bt import TreeExecutor, load_tree
    from grape.sim.drivers import SensorOptions
    from grape.sim.drivers.arm import ArmDriverOptions
    from grape.sim.simulation import Simulation, SimulationOptions

    refuse_used(out)
    tree = load_tree(mission.tree, nodes(mission.file.task))
    description = robot_description(mission.file.robot)
    robot = build_robot(description)
    world = world_type(mission.file.world.get("type", "vineyard")).grow(mission.site, mission.world)
    sensors = SensorOptions(arm=ArmDriverOptions(errors=mission.file.arm_errors))
    options = SimulationOptions(dispensers=mission.file.dispensers, sensors=sensors)
    simulation = Simulation(world, description, seed=mission.seed, options=options)

    def make_tree(context: Context) -> TreeExecutor:
        return TreeExecutor(tree, context)

    try:
        folder = make_folder(out, mission)
        write_inputs(mission, folder)
        film = Film(folder, lambda: simulation.render()) if render else None
        runner = Runner(
            mission,
            simulation,
            robot,
            folder,
            make_tree=make_tree,
            referee=simulation.referee,
            cancelled=cancelled,
            on_progress=on_progress,
            on_beat=film.see if film is not None else lambda now: None,
        )
        result = finish(mission, runner, simulation, folder)
        if film is not None:
            film.close()
    finally:
        simulation.close()
    return MissionRun(folder=folder, result=result)


def finish(mission: Mission, runner: Runner, simulation: Any, folder: Path) -> dict[str, Any]:
    """Run the beats and write what they came to."""
    from grape.mission.report import write_report

    finding = runner.run()
    events = list(read_events(folder / "events.jsonl"))
    result = build_result(mission, finding, runner.ledger, events, simulation.referee.verdict())
    runner.close()
    truth = np.array([(s.time_s, s.x, s.y, s.yaw) for s in simulation.referee.path]).reshape(-1, 4)
    write_atomic(folder / "path.csv", finding.track.to_csv(truth))
    write_result(result, folder)
    write_report(folder)
    return result


def make_folder(out: Path | None, mission: Mission) -> Path:
    """Create the run folder.

    Raises:
        InvalidInput: `out` is a file or a folder that holds something.
    """
    if out is None:
        stem, number = f"{mission.name}-seed{mission.seed}", 1
        while (folder := Path("runs") / f"{stem}-{number}").exists():
            number += 1
        folder.mkdir(parents=True)
        return folder
    refuse_used(out)
    out.mkdir(parents=True, exist_ok=True)
    return out


def refuse_used(out: Path | None) -> None:
    """Refuse a run folder that is not new: also before the work begins.

    Raises:
        InvalidInput: `out` is a file or a folder that holds something.
    """
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InvalidInput(
            f"--out {out}: it exists and is {'not empty' if out.is_dir() else 'no folder'}; name a new folder"
        )


def write_inputs(mission: Mission, folder: Path) -> None:
    """Keep exactly what runs: `grape run FOLDER/mission.yaml` repeats it."""
    write_atomic(folder / "tree.xml", mission.tree.read_text(encoding="utf-8"))
    save_site(mission.site, folder / "site.geojson")
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    text = io.StringIO()
    yaml.dump({**mission.resolved(), "tree": "tree.xml"}, text)
    write_atomic(folder / "mission.yaml", text.getvalue())


class Film:
    """Pictures of a camera that follows the robot, and a contact sheet of them."""

    def __init__(self, folder: Path, picture: Callable[[], Any], period_s: float = RENDER_PERIOD_S) -> None:
        self._folder = folder / "render"
        self._folder.mkdir()
        self._picture = picture
        self._period_s = period_s
        self._next_s = 0.0
        self._frames: list[Any] = []

    def see(self, now: float) -> None:
        """Take a picture when one is due."""
        import cv2

        if now < self._next_s:
            return
        self._next_s += self._period_s
        bgr = self._picture()[:, :, ::-1]
        cv2.imwrite(str(self._folder / f"{now:07.1f}s.jpg"), bgr)
        self._frames.append(cv2.resize(bgr, (320, 240)))

    def close(self) -> None:
        """Write the contact sheet: six pictures a line."""
        import cv2

        if not self._frames:
            return
        columns = min(6, len(self._frames))
        blank = np.full_like(self._frames[0], 255)
        frames = self._frames + [blank] * (-len(self._frames) % columns)
        lines = [np.hstack(frames[k : k + columns]) for k in range(0, len(frames), columns)]
        cv2.imwrite(str(self._folder / "sheet.jpg"), np.vstack(lines))
