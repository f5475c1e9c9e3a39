"""The command line: quick to answer, clear about wrong input, exit codes as documented."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import grape
from grape import cli

HEAVY = ("numpy", "scipy", "mujoco", "open3d", "pinocchio", "numba", "matplotlib", "cv2", "ompl", "toppra", "pydantic")


def grape_command(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, output and error text of `grape ARGUMENTS`."""
    argv, sys.argv = sys.argv, ["grape", *arguments]
    try:
        cli.main()
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.argv = argv
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_importing_the_command_line_loads_nothing_heavy() -> None:
    program = f"import sys, grape.cli; print([name for name in {HEAVY} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_runs_as_a_module() -> None:
    run = subprocess.run([sys.executable, "-m", "grape", "--version"], capture_output=True, text=True, check=True)
    assert run.stdout == f"grape {grape.__version__}\n"


def test_help_names_commands_and_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = grape_command(capsys, "--help")
    assert code == 0
    for word in ("run", "list", "check", "render", "Exit codes", "130"):
        assert word in out


def test_each_set_option_says_which_file_it_changes(capsys: pytest.CaptureFixture[str]) -> None:
    assert "key of the mission file" in grape_command(capsys, "run", "--help")[1]
    assert "key of the configuration" in grape_command(capsys, "filter", "--help")[1]


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert grape_command(capsys, "--version")[:2] == (0, f"grape {grape.__version__}\n")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "dispenser_deploymnt"], "did you mean 'dispenser_deployment'?"),
        (["run", "--set", "world.stile=cordon"], "did you mean 'style'?"),
        (["run", "a" * 5000], "File name too long"),
        (["run", "--set", "site=" + "a" * 5000], "File name too long"),
        (["run", "--seed", "x"], "Invalid value"),
        (["run", "--sed", "3"], "No such option"),
        (["runn"], "No such command"),
        (["check"], "Missing argument"),
        (["check", "--task", "prune", "husky_jaco2"], "'prune' is not installed; there are dispenser"),
        (["render", "vinyard"], "did you mean 'vineyard'?"),
        (["run", "--set", "seed"], "got 'seed'; allowed: KEY=VALUE"),
        (["run", "--set", "world=3"], "world: got 3; allowed: key: value lines"),
        (["run", "--set", "plants.9.mode=nail"], "plants is a list of 4: got '9'; allowed: 0 to 3"),
        (["run", "--world", "nowhere.yaml"], "cannot be read"),
        (["run", "--robot", "robi_jaco"], "did you mean 'robi_jaco2'?"),
        (["render", "--robot", "huski_jaco2", "vineyard"], "did you mean 'husky_jaco2'?"),
        (["render", "vineyard", "--out", "/dev/null/pictures"], "/dev/null is no folder"),
        (["run", "--out", "/dev/null"], "--out /dev/null: it exists and is no folder"),
        (["bench", "navigation", "--html", "/dev"], "it is a folder; name a file"),
    ],
)
def test_wrong_input_exits_with_1_and_no_traceback(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    expected: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = grape_command(capsys, *arguments)
    assert code == 1
    assert expected in err and "Traceback" not in out + err
    assert list(tmp_path.iterdir()) == [], "nothing half-written"


def test_check_lists_every_problem_of_every_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    mission, site, tree, model = (tmp_path / name for name in ("m.yaml", "s.geojson", "t.xml", "r.xml"))
    mission.write_text("name: m\nrobott: husky_jaco2\ndispensers: 99\n")
    site.write_text('{"type": "FeatureCollection"')
    tree.write_text('<root BTCPP_format="4"><BehaviorTree ID="A"><Sequenze/></BehaviorTree></root>')
    model.write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    code, out, err = grape_command(
        capsys, "check", str(mission), str(site), str(tree), str(model), "dispenser_deployment"
    )
    assert code == 1
    assert f"{mission}:2:1: robott: unknown key" in err
    assert f"{mission}:3:1: dispensers: got 99" in err
    for path in (site, tree, model):
        assert f"{path}:" in err
    assert "dispenser_deployment: ok" in out


@pytest.mark.parametrize(
    ("open_tag", "close_tag"),
    [('<replicate count="1000" offset="1 0 0">' * 4, "</replicate>" * 4), ('<flexcomp count="900 900 900"/>', "")],
)
def test_check_refuses_a_model_that_would_never_be_built(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, open_tag: str, close_tag: str
) -> None:
    model = tmp_path / "endless.xml"
    model.write_text(f'<mujoco><worldbody>{open_tag}<geom size="0.1"/>{close_tag}</worldbody></mujoco>')
    code, _, err = grape_command(capsys, "check", str(model))
    assert code == 1
    assert f"{model}:1:" in err and "too many elements; allowed: at most 50000 with all copies" in err


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        ('<size nkey="2000000000"/>', "3:7: size: nkey is '2000000000'; allowed: at most 1000"),
        ('<size njmax="2000000000"/>', "3:7: size: njmax is '2000000000'; allowed: at most 10000"),
        ('<size memory="1T"/>', "3:7: size: memory is '1T'; allowed: at most 1073741824"),
        (
            '<asset><hfield name="h" nrow="3" ncol="100000" size="1 1 1 1"/></asset>',
            "3:34: hfield: ncol is '100000'; allowed: at most 5000",
        ),
        ('<asset><texture builtin="flat" width="1e6"/></asset>', "3:32: texture: width is '1e6'"),
        (
            '<asset><mesh name="m" builtin="cone" params="100000000 .5"/></asset>',
            "3:38: mesh: params is '100000000 .5'",
        ),
    ],
)
def test_check_refuses_a_model_that_asks_for_all_memory_where_it_does(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, part: str, expected: str
) -> None:
    model, room = tmp_path / "model.xml", tmp_path / "room.xml"
    model.write_text("<mujoco>\n<include file='room.xml'/>\n<worldbody/>\n</mujoco>")
    room.write_text(f"<mujoco>\n\n{part}\n</mujoco>")
    code, _, err = grape_command(capsys, "check", str(model))
    assert code == 1
    assert f"{room}:{expected}" in err


def test_check_accepts_what_is_built_in(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "husky_jaco2").mkdir()  # a folder of that name is not meant
    code, out, err = grape_command(capsys, "check", "dispenser_deployment", "husky_jaco2", "robi_jaco2")
    assert (code, err) == (0, "")
    assert "husky_jaco2: ok, robot husky_jaco2" in out and "robi_jaco2: ok, robot robi_jaco2" in out


@pytest.mark.parametrize(
    ("name", "expected"),
    [("husky_jaco", "did you mean 'husky_jaco2'?"), ("gone.yaml", "cannot be read"), ("grape", "allowed: mission")],
)
def test_check_refuses_names_it_does_not_know(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, expected: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "grape").touch()
    code, _, err = grape_command(capsys, "check", name)
    assert code == 1
    assert expected in err


def test_list_shows_missions_nodes_and_ports(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = grape_command(capsys, "list")
    assert code == 0
    for word in ("dispenser_deployment", "husky_jaco2", "robi_jaco2", "vineyard", "FinishPlant", "outcome"):
        assert word in out
