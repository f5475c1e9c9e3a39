"""`grape render`: pictures of a world with the robot at its start."""

from __future__ import annotations

from pathlib import Path

from grape.errors import FileError, Problem, did_you_mean
from grape.folders import refuse_unwritable_folder
from grape.mission.catalog import mission_file, missions, robot_description, world_type, worlds
from grape.mission.file import Mission, load_mission

DEFAULT = "dispenser_deployment"
ANY_PLANT = "select={vines: 1}"  # a mission needs one; pictures do not


def render_scene(subject: str, out: Path, seed: int | None, assignments: list[str]) -> list[Path]:
    """Write pictures of a mission's world, or of a world file; returns their paths.

    Raises:
        GrapeError: the input has problems, or `out` cannot be written.
    """
    refuse_unwritable_folder(out)
    overrides = [*assignments, *([f"seed={seed}"] if seed is not None else [])]
    return _take(*_mission_of(subject, overrides), out)


def _mission_of(subject: str, overrides: list[str]) -> tuple[Mission, str]:
    """The mission whose world is shown, and what its pictures are called."""
    from grape.config import load_yaml

    path = Path(subject)
    if subject in worlds():
        return load_mission(DEFAULT, ["plants=null", ANY_PLANT, f"world={{type: {subject}}}", *overrides]), subject
    is_site = path.suffix in (".geojson", ".json")
    is_world = path.suffix in (".yaml", ".yml") and mission_file(subject) is None and path.is_file()
    if is_site or (is_world and "type" in load_yaml(path).data):
        return load_mission(DEFAULT, ["plants=null", ANY_PLANT, *overrides], path), path.stem
    if mission_file(subject) is None and not path.suffix and not path.is_file():
        known = [*missions(), *worlds()]
        allowed = f"{', '.join(known)}, or the path of a mission, a world or a site"
        raise FileError(
            [Problem(file=subject, got="no such name", allowed=allowed, suggestion=did_you_mean(subject, known))]
        )
    mission = load_mission(subject, overrides)
    return mission, mission.name


def _take(mission: Mission, name: str, out: Path) -> list[Path]:
    import cv2
    import numpy as np

    from grape.sim.render import View
    from grape.sim.simulation import Simulation, SimulationOptions

    world = world_type(mission.file.world.get("type", "vineyard")).grow(mission.site, mission.world)
    options = SimulationOptions(dispensers=mission.file.dispensers)
    simulation = Simulation(world, robot_description(mission.file.robot), seed=mission.seed, options=options)
    corners = np.vstack([row.line for row in mission.site.rows] + [mission.site.start[None]])
    middle, size = (corners.min(axis=0) + corners.max(axis=0)) / 2, float(np.ptp(corners, axis=0).max())
    views = {
        "robot": simulation.chase_view(),
        "robot_left": simulation.chase_view(2.4, 60.0, -15.0),
        "site": View(target=np.array([*middle, 0.0]), distance_m=0.9 * size, azimuth_deg=120.0, elevation_deg=-35.0),
    }
    try:
        out.mkdir(parents=True, exist_ok=True)
        paths = []
        for side, view in views.items():
            paths.append(out / f"{name}-{mission.file.robot}-seed{mission.seed}-{side}.png")
            cv2.imwrite(str(paths[-1]), simulation.render(view)[:, :, ::-1])
    finally:
        simulation.close()
    return paths
