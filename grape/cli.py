"""The command line. Heavy imports wait until a command needs them."""

from __future__ import annotations

import os
import sqlite3
import sys
from pathlib import Path
from typing import Annotated

import typer

from grape import __version__

EXIT = {"succeeded": 0, "partial": 2, "failed": 3, "aborted": 130}
INPUT_ERROR = 1

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # drawing the help with rich takes twice as long as everything else together
    help="Mobile-manipulation tasks as behaviour trees, in simulation and on real robots with the same trees.",
    epilog="Begin with `grape run`, then open report.html in the run folder that it names. Exit codes: 0 succeeded,"
    " 1 error in the input, 2 partial, 3 failed, 130 aborted (Ctrl-C).",
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"grape {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    os.environ.setdefault("MUJOCO_GL", "egl")


Assignments = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Change a key of the mission file, such as world.rows=5; repeatable."
    ),
]
FilterAssignments = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the configuration, such as rate=50; repeatable."),
]
WorldFile = Annotated[
    Path | None, typer.Option("--world", metavar="FILE", help="Use another world: a world's YAML, or a site's GeoJSON.")
]


Robot = Annotated[
    str | None, typer.Option(metavar="NAME", help="Another robot (see `grape list`); the same as --set robot=NAME.")
]


@app.command()
def run(
    mission: Annotated[
        str, typer.Argument(help="Name of a built-in mission (see `grape list`), or a YAML file.")
    ] = "dispenser_deployment",
    seed: Annotated[
        int | None, typer.Option(metavar="N", help="Seed of world and sensor noise; default: the mission's.", min=0)
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="New run folder; default: runs/<mission>-seed<N>-<n>.")
    ] = None,
    robot: Robot = None,
    world: WorldFile = None,
    assignments: Assignments = None,
    render: Annotated[
        bool, typer.Option("--render", help="Also film it from behind the robot: render/, and in the report.")
    ] = False,
) -> None:
    """Run a mission and write its run folder.

    In simulation, or on the drivers of a robot that the mission names.
    The folder holds report.html to look at, result.json for programs, events, pictures, and what ran.

    Exit codes: 0 every plant served, 1 error in the input, 2 some plants served, 3 none or a crash, 130 aborted.
    """
    from grape.mission.command import run_command

    raise typer.Exit(EXIT[run_command(mission, seed, out, world, _with_robot(robot, assignments), render)])


@app.command()
def campaign(
    mission: Annotated[str, typer.Argument(help="Name of a built-in mission (see `grape list`), or a YAML file.")],
    seeds: Annotated[str, typer.Option(metavar="A:B", help="Seeds A to B - 1, one mission each.")],
    workers: Annotated[int, typer.Option(metavar="N", help="Missions at the same time.", min=1)] = 1,
    engine: Annotated[str, typer.Option(metavar="local|ray", help="Where missions run: here, or on a cluster.")] = (
        "local"
    ),
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Campaign folder; an old one goes on. Default: runs/campaign-<mission>-<n>."),
    ] = None,
    assignments: Assignments = None,
    variations: Annotated[
        list[str] | None,
        typer.Option(
            "--vary",
            metavar="KEY=A,B,…",
            help="Give a key these values in turn, seed by seed; repeatable, then every combination has its turn.",
        ),
    ] = None,
) -> None:
    """Run a mission on many seeds and say how well it works.

    Each mission is a `grape run` in a process and a folder of its own. The campaign folder holds report.html to look
    at and campaign.json for programs. Missions that are finished there are read, others run again.

    Exit codes: 0 every mission has a result, 1 error in the input, 2 some have none, 130 stopped (Ctrl-C).
    """
    from grape.campaign.command import campaign_command

    raise typer.Exit(campaign_command(mission, seeds, workers, engine, out, assignments or [], variations or []))


@app.command()
def reproduce(
    row: Annotated[str, typer.Argument(help="Row of what is asked for, such as G8 (see `grape list`).")],
    seeds: Annotated[str | None, typer.Option(metavar="A:B", help="Seeds A to B - 1; default: the row's own.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder; an old one goes on. Default: runs/reproduce-<row>-<n>.")
    ] = None,
) -> None:
    """Run the experiment behind a row, beside its reference.

    The folder holds reproduce.html with the plots and reproduce.json for programs.

    Exit codes: 0 it ran, whether goals are met or not, 1 error in the input, 130 stopped (Ctrl-C); rows that missions
    prove then show the figures of those that are done.
    """
    from grape.proving.reproduce import reproduce_command

    raise typer.Exit(reproduce_command(row, seeds, out))


@app.command()
def bench(
    name: Annotated[str, typer.Argument(help="What to measure, such as manipulation (see `grape list`).")],
    file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the figures there too.")] = None,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a page with the plots there too.")] = None,
) -> None:
    """Measure how long things take, beside peers.

    Each peer does the same in the same run. Absolute figures depend on the machine; ratios hold. Exit codes: 0 it
    ran, 1 error in the input.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # threads on small matrices only cost
    from grape.proving.bench import bench_command

    bench_command(name, file, html)


@app.command("filter")
def filter_(
    log: Annotated[Path, typer.Argument(help="Recorded readings: .csv or .jsonl.")],
    config: Annotated[Path, typer.Option("--config", metavar="FILE", help="YAML with sensors, noise and datum.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Estimate, .csv or .jsonl; default: <LOG>.estimate.csv.")
    ] = None,
    assignments: FilterAssignments = None,
) -> None:
    """Estimate where a robot was, from recorded readings.

    Wheels, IMU, odometry, GNSS and any other source of poses, velocities or accelerations, by one Kalman filter or a
    local and a global one. Formats: docs/filter.md. Exit codes: 0 it ran, 1 error in the input.
    """
    from grape.localization.filter_command import filter_command

    for line in filter_command(log, config, out, assignments or []):
        typer.echo(line)


LogFile = Annotated[Path, typer.Argument(metavar="LOG", help="Laser log in CARMEN's format (.log, .clf, also .gz).")]
LaserWord = Annotated[
    str | None,
    typer.Option(metavar="WORD", help="Message of the laser to take, such as FLASER; default: the most frequent."),
]
MaxRange = Annotated[float, typer.Option(metavar="M", help="Longer beams are not used.")]


@app.command("map")
def map_(
    log: LogFile,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder; default: runs/map-<log>-<n>.")] = None,
    poses: Annotated[
        str, typer.Option(metavar="slam|odometry|corrected", help="Which poses the map is drawn from.")
    ] = "slam",
    resolution: Annotated[float, typer.Option(metavar="M", help="Size of a cell.")] = 0.05,
    max_range: MaxRange = 25.0,
    laser: LaserWord = None,
) -> None:
    """Build a map of a recorded laser log.

    By matching scans and closing loops. The folder holds map.yaml and map.pgm (the ROS map format), map.png to look
    at, path.csv, and map.json with the error against the log's corrected poses, where it has them. Go on with
    `grape localize`.

    Exit codes: 0 the map is written, 1 error in the input, 130 stopped (Ctrl-C).
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # threads on small matrices only cost
    from grape.laser_logs.map_command import map_command

    map_command(log, out, poses, resolution, max_range, laser)


@app.command()
def localize(
    log: LogFile,
    map_file: Annotated[Path, typer.Option("--map", metavar="MAP", help="Map's YAML, as `grape map` writes it.")],
    start: Annotated[
        str, typer.Option(metavar="X,Y,YAW", help="Where the robot is at first, in m and rad; or anywhere.")
    ] = "anywhere",
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the particles.", min=0)] = 0,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder; default: runs/localize-<log>-<n>.")] = None,
    max_range: MaxRange = 25.0,
    laser: LaserWord = None,
) -> None:
    """Find where a robot was on a map, by a laser log.

    By Monte Carlo localisation, with laser and odometry. The folder holds localize.png to look at, path.csv, and
    localize.json with the error against the log's corrected poses, where it has them.

    Exit codes: 0 it found its place, 1 error in the input, 2 it was never sure of a place, 130 stopped (Ctrl-C).
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    from grape.laser_logs.localize_command import localize_command

    raise typer.Exit(0 if localize_command(log, map_file, start, seed, out, laser, max_range) else EXIT["partial"])


@app.command()
def resume(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder of a mission that was killed or aborted.")],
) -> None:
    """Go on with a mission that was killed or stopped.

    By a kill, a power cut or Ctrl-C. The robot localises again, looks what became of the plant and the dispenser it
    was at, and serves what is left. A mission that has ended by itself stays as it is. Exit codes as of `grape
    run`.
    """
    from grape.mission.command import resume_command

    raise typer.Exit(EXIT[resume_command(folder)])


@app.command("list")
def list_() -> None:
    """List what can be named.

    Missions, rows to reproduce, benches, trees, tasks, robots, worlds, costmap layers and planners; and the nodes
    (actions and conditions) that trees may use, with their ports and defaults. What packages bring is marked.
    """
    from grape.mission.listing import print_catalog

    print_catalog()


@app.command()
def check(
    files: Annotated[
        list[str],
        typer.Argument(help="Mission or world (.yaml), site (.geojson), tree or MJCF (.xml), or a built-in name."),
    ],
    task: Annotated[str, typer.Option(metavar="NAME", help="Task whose nodes a tree may use.")] = "dispenser",
) -> None:
    """Check files without running them, and list every problem.

    Each with file, line and column, what was got and what is allowed. Exit code 1 when there is one.
    """
    from grape.mission.check import check_files

    kinds, problems = check_files(files, task)
    for name, kind in kinds.items():
        typer.echo(f"{name}: ok, {kind}")
    for problem in problems:
        typer.echo(str(problem), err=True)
    raise typer.Exit(INPUT_ERROR if problems else 0)


@app.command()
def render(
    subject: Annotated[str, typer.Argument(help="A mission or a world by name or YAML file, or a site's GeoJSON.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the pictures.")] = Path("renders"),
    seed: Annotated[int | None, typer.Option(metavar="N", help="Seed of the world.", min=0)] = None,
    robot: Robot = None,
    assignments: Assignments = None,
) -> None:
    """Take pictures of world and robot, without a mission."""
    from grape.mission.pictures import render_scene

    for path in render_scene(subject, out, seed, _with_robot(robot, assignments)):
        typer.echo(str(path))


def _with_robot(robot: str | None, assignments: list[str] | None) -> list[str]:
    return [*(assignments or []), *([f"robot={robot}"] if robot is not None else [])]


def main() -> None:
    """Entry point: errors in the input end with their text and exit code 1, never with a traceback."""
    from grape.errors import GrapeError

    try:
        code = app(standalone_mode=False)
    except GrapeError as error:
        typer.echo(f"error: {error}", err=True)
        code = INPUT_ERROR
    except OSError as error:  # no room on the disk, no right to write there, a name that is too long
        place = f"{error.filename}: " if error.filename is not None else ""
        typer.echo(f"error: {place}{error.strerror or error}", err=True)
        code = INPUT_ERROR
    except sqlite3.Error as error:  # the same, while the ledger was written
        typer.echo(f"error: ledger: {error}", err=True)
        code = INPUT_ERROR
    except typer.Abort:
        code = EXIT["aborted"]
    except Exception as error:
        show = getattr(error, "show", None)  # click's errors in the command line itself
        if show is None:
            raise
        show()
        code = INPUT_ERROR
    sys.exit(code if isinstance(code, int) else 0)
