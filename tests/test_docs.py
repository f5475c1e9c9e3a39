"""README, docs and examples say what is so: links lead somewhere, commands parse, code runs, tables match the code."""

from __future__ import annotations

import inspect
import json
import re
import runpy
import shlex
import shutil
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer

from grape import cli
from grape.campaign.watch import Standing
from grape.config import model_of
from grape.errors import Reason
from grape.mission.faults import MissionFault
from grape.mission.file import MissionFile, Refill, Selection, load_mission
from grape.mission.launch import refuse_changed, write_inputs
from grape.plugins import BUILT_IN
from grape.proof import Bench, Experiment, Proof
from grape.site import load_site, save_site

ROOT = Path(__file__).parents[1]
PAGES = {path.name: path.read_text(encoding="utf-8") for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")]}
PLACES = {path.name: path for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")]}
OWN_TEST = "writing_an_action.md"  # its code is one module: tests/bt/test_docs.py
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: str, *languages: str) -> list[str]:
    """Fenced blocks of a page in these languages."""
    return [text for language, text in FENCE.findall(PAGES[page]) if language in languages]


def headings(text: str) -> set[str]:
    """Anchors of a page's headings."""
    titles = re.findall(r"^#+ (.+)$", FENCE.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def tables(page: str, heading: str) -> list[list[list[str]]]:
    """Cells of the tables between a heading and the next one, without their head lines."""
    part = re.split(r"^#+ ", FENCE.sub("", PAGES[page]), flags=re.MULTILINE)
    section = next(text for text in part if text.startswith(heading + "\n"))
    found = re.findall(r"(?:^\|.*\n)+", section, re.MULTILINE)
    return [
        [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]] for table in found
    ]


def code(cell: str) -> list[str]:
    """What stands in backticks."""
    return re.findall(r"`([^`]+)`", cell)


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_somewhere(page: str) -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", PAGES[page]))
    for link in (link for link in links if not link.startswith(("http://", "https://"))):
        file, _, anchor = link.partition("#")
        target = (PLACES[page].parent / file).resolve() if file else PLACES[page]
        assert target.exists(), link
        assert not anchor or anchor in headings(target.read_text(encoding="utf-8")), link


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with every file that the pages name, as the present one."""
    monkeypatch.chdir(tmp_path)
    for text in (block for page in PAGES for block in blocks(page, "yaml")):
        if name := re.match(r"# (\S+\.yaml)\n", text):
            (tmp_path / name[1]).write_text(text)
    mission = load_mission("dispenser_deployment")
    folder = tmp_path / "runs" / "dispenser_deployment-seed0-1"
    folder.mkdir(parents=True)
    write_inputs(mission, folder)
    lines = [{"t": 0.0, "kind": "mission_started"}]
    late = {"name": "X", "reason": "timeout", "detail": "late", "start": 1.0, "end": 9.0}
    lines += [{"t": 9.0, "kind": "action", "status": "aborted", **late}]
    (folder / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    save_site(mission.site, tmp_path / "vineyard.geojson")
    shutil.copy(mission.tree, tmp_path / "my_tree.xml")
    return tmp_path


COMMANDS = sorted(
    {
        line.replace("./run", "grape run")
        for page in PAGES
        for block in blocks(page, "sh", "")
        for line in block.splitlines()
        if line.startswith(("grape ", "./run"))
    }
)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_in_a_block_is_accepted(
    command: str, desk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def dry_run(name: str, seed: int | None, out: Path | None, world: Path | None, given: list[str], film: bool) -> str:
        load_mission(name, [*given, *([f"seed={seed}"] if seed is not None else [])], world)
        return "succeeded"

    def no_resume(folder: Path) -> str:
        refuse_changed(folder)
        return "succeeded"

    def no_map(log: Path, *rest: Any) -> bool:
        return log.suffix == ".log"

    monkeypatch.setattr("grape.laser_logs.map_command.map_command", no_map)
    monkeypatch.setattr("grape.laser_logs.localize_command.localize_command", no_map)
    monkeypatch.setattr("grape.mission.command.run_command", dry_run)
    monkeypatch.setattr("grape.mission.command.resume_command", no_resume)
    monkeypatch.setattr("grape.mission.pictures._take", lambda *given: [])
    monkeypatch.setattr("grape.campaign.command.run_jobs", lambda jobs, *rest: Standing(jobs=jobs))
    nothing = Experiment(row="G8", summary="", seeds=range(1), run=lambda *given: Proof(quantities=()))
    monkeypatch.setattr("grape.proving.reproduce.experiment_of", lambda row: nothing)
    for name in ("manipulation", "navigation"):
        unmeasured = Bench(name=name, summary="", run=lambda progress: ())
        monkeypatch.setattr(f"grape.experiments.bench_{name}.BENCH", unmeasured)
    monkeypatch.setattr(sys, "argv", shlex.split(command))
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 0, capsys.readouterr().err


def test_commands_in_running_text_exist() -> None:
    commands: Any = typer.main.get_command(cli.app)
    for text in (text for page in PAGES.values() for text in code(FENCE.sub("", page))):
        words = text.replace("./run", "grape run").split()
        if words[0] != "grape" or len(words) == 1:
            continue
        assert words[1] in commands.commands, text
        options = {name for parameter in commands.commands[words[1]].params for name in parameter.opts} | {"--help"}
        assert {word for word in words if word.startswith("--")} <= options, text
    for name in ("run", "test", ".ci/run"):
        assert (ROOT / name).stat().st_mode & 0o111, name


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python") and page != OWN_TEST])
def test_python_on_a_page_runs(page: str, desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {}
    for text in blocks(page, "python"):
        exec(compile(text, page, "exec"), names)
    expected = {
        "first_steps.md": "X timeout late",
        "file_formats.md": "gobelet ['r0v1'",
        "proving_figures.md": "arm states without a collision",
        "deployment_points.md": "9 mm, score 1.00",
        "filter.md": "x 1.0 1 refused",
        "maps_and_localisation.md": "off by less than 0.1 m: True share True\nwho is out: [] None",
        "driving.md": "at the goal",
        "extending.md": "around the puddle: True, plants: 4",
        "own_robot.md": "[0.  0.9 0.9] 1",
    }[page]
    assert expected in capsys.readouterr().out


def test_the_site_on_the_page_is_read(tmp_path: Path) -> None:
    (text,) = blocks("file_formats.md", "json")
    (tmp_path / "site.geojson").write_text(text)
    site = load_site(tmp_path / "site.geojson")
    assert [plant.id for plant in site.plants] == ["r0v0", "r0n0"] and len(site.fences) == 1


def test_the_trees_on_the_page_are_accepted(tmp_path: Path) -> None:
    from grape.bt import load_tree
    from grape.bt.builtin import BUILTIN
    from grape.mission.catalog import nodes

    for text in blocks("file_formats.md", "xml"):
        (tmp_path / "tree.xml").write_text(text)
        load_tree(tmp_path / "tree.xml", nodes("dispenser"))
    named = {name for row in tables("file_formats.md", "Tree")[0] for name in code(row[1])}
    ports = {port for node in BUILTIN.values() for port in node.ports}
    assert named - ports - {"SubTree", "ID", "_autoremap"} == set(BUILTIN)


def literal(text: str) -> Any:
    """A JSON value, or the text itself."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def assert_rows_match(rows: list[list[str]], model: Any) -> None:
    """Each field of a model has a row with its default and its range, and no row is without a field."""
    schema = model.model_json_schema()["properties"]
    documented = {code(row[0])[0]: row for row in rows}
    assert set(documented) == set(schema)
    for name, row in documented.items():
        field = schema[name]
        kind = next((option for option in field.get("anyOf", [field]) if option.get("type") != "null"), field)
        if code(row[2]) and "default" in field:
            assert literal(code(row[2])[0]) == field["default"], name
        numbers = [float(n) for n in re.findall(r"-?\d+(?:\.\d+)?", row[1].replace("−", "-"))]
        if len(numbers) == 2 and "minimum" in kind:
            assert numbers == [kind["minimum"], kind["maximum"]], name


def test_keys_of_missions_and_worlds_are_those_of_the_code() -> None:
    from grape.sim.worlds import VineyardOptions, WalkerOptions

    mission, select, refill, faults = tables("file_formats.md", "Mission")
    assert_rows_match(mission, MissionFile)
    assert_rows_match(select, Selection)
    assert_rows_match(refill, Refill)
    assert_rows_match(faults, MissionFault)
    world, walkers = tables("file_formats.md", "World")
    assert_rows_match(world, model_of(VineyardOptions))
    assert_rows_match(walkers, model_of(WalkerOptions))


def sources() -> str:
    """The text of everything that runs in a mission."""
    return "\n".join(p.read_text() for folder in ("grape", "tasks", "sim") for p in (ROOT / folder).rglob("*.py"))


def test_every_event_and_reason_is_described() -> None:
    written = set(re.findall(r'\.event\(\s*"(\w+)"', sources()))
    (events,) = tables("file_formats.md", "events.jsonl")
    assert {name for row in events for name in code(row[0])} == written
    (reasons,) = tables("file_formats.md", "Reason codes")
    assert {name for row in reasons for name in code(row[1])} == {str(reason) for reason in Reason}


def test_every_field_of_the_result_is_described(tmp_path: Path) -> None:
    from grape.mission.ledger import SqliteLedger
    from grape.mission.result import build_result
    from grape.mission.runner import Finding
    from grape.sim.referee import Referee

    ledger = SqliteLedger.create(tmp_path / "ledger.sqlite", [("r0v1", "plant")], 8)
    result = build_result(load_mission("dispenser_deployment"), Finding(), ledger, [], None)
    top, plants, truth = tables("file_formats.md", "result.json")
    text = " ".join(cell for table in (top, plants) for row in table for cell in row)
    keys = {*result, *result["plants"][0], *result["plants"][0]["servo"], *result["dispensers"]}
    assert keys | {*result["localization"], *result["navigation"]} <= set(code(text))
    judged = set(re.findall(r'"(\w+)":', inspect.getsource(Referee.verdict)))
    assert judged - {"truth", "localization"} <= set(code(" ".join(cell for row in truth for cell in row)))


def test_every_field_of_a_campaign_is_described() -> None:
    from grape.campaign.failures import Failure
    from grape.campaign.plan import make_plan
    from grape.campaign.summary import build_summary, success

    (fields,) = tables("proving_figures.md", "Campaigns")
    text = " ".join(cell for row in fields for cell in row)
    summary = build_summary(make_plan("dispenser_deployment", [], []), range(1), [], [], [])
    assert {*summary, *success([]), *Failure.__annotations__} <= set(code(text))


def test_every_group_of_plugins_is_described() -> None:
    groups = [code(row[0])[0] for row in tables("extending.md", "What a package can add")[0]]
    assert sorted(groups) == sorted(BUILT_IN)


def test_every_library_has_its_job_and_range() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (rows,) = tables("decisions.md", "Libraries")
    documented = sorted(code(row[0])[0] + code(row[1])[0] for row in rows)
    assert documented == sorted(project["dependencies"])


def test_keys_of_a_filter_are_those_of_the_code() -> None:
    from grape.localization.filter_file import FilterFile, SensorFile
    from grape.localization.filter_log import COLUMNS

    log, sensor, whole = tables("filter.md", "On recorded data")[:1] + tables("filter.md", "The configuration")
    assert {name for row in sensor for name in code(row[0])} == set(SensorFile.model_fields)
    assert {name for row in whole for name in code(row[0])} == set(FilterFile.model_fields) - {"sensors"}
    named = {name for row in log for name in code(row[0])} - {"std_x", "std_az"}
    assert named == {name for name in COLUMNS if not name.startswith("std_")}


def run_example(name: str, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")


def test_example_finds_the_spurs_of_a_cloud(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_example("spurs_of_a_cloud.py", monkeypatch)
    lines = capsys.readouterr().out.splitlines()
    tips = sorted(float(line.split("[")[1].split()[0]) for line in lines)
    assert tips == pytest.approx([-0.18, 0.0, 0.17], abs=0.005)
    module = runpy.run_path(str(ROOT / "examples" / "spurs_of_a_cloud.py"))
    np.savetxt(tmp_path / "cloud.txt", module["made_up_vine"](np.random.default_rng(1)))
    run_example("spurs_of_a_cloud.py", monkeypatch, str(tmp_path / "cloud.txt"), "0", "-0.5", "0.8")
    assert len(capsys.readouterr().out.splitlines()) == 3


def test_example_filters_own_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_example("filter_own_data.py", monkeypatch)
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if "gated" in line] == [line for line in lines if line.startswith(" 30.0 s  pos")]
    x, y = (float(part.split()[1]) for part in lines[-1].split("  ")[1:] if part[:2] in ("x ", "y "))
    assert np.hypot(x - 2 * np.sin(12.5), y + 2 * np.cos(12.5)) < 0.1
    (tmp_path / "log.csv").write_text("0.1, wheels, 0.5, 0.0\n10.0, gyro, 0.0\n")
    run_example("filter_own_data.py", monkeypatch, str(tmp_path / "log.csv"))
    assert capsys.readouterr().out.startswith(" 10.0 s")


def test_example_servos_to_its_goal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    run_example("servo_to_markers.py", monkeypatch)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[2] for line in lines] == ["stand_off", "descend", "final", "converged"]
    assert float(lines[-1].split()[5]) < 1.0


def test_example_runs_a_mission(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def run_mission(mission: Any, *, on_progress: Any) -> Any:
        ids = [plant.plant for plant in mission.plants]
        plants = [{"id": id, "outcome": "deployed", "reason": ""} for id in ids]
        truth = {"plants": {id: {"hanging": True} for id in ids}}
        progress = {"plant": ids[0], "phase": "Retract", "done": 0, "plants": 1}
        on_progress(SimpleNamespace(percent=0.0, sim_time_s=1.0, **progress))
        result = {"status": "succeeded", "plants": plants, "truth": truth}
        return SimpleNamespace(folder=Path("runs/x"), result=result)

    monkeypatch.setattr("grape.mission.launch.run_mission", run_mission)
    run_example("run_a_mission.py", monkeypatch)
    assert "r0n0: deployed , hangs by the referee: True" in capsys.readouterr().out
