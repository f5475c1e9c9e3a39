"""Built-in plugins, those of other packages, and what is said when one is broken."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from paper_package import brought

from grape.errors import InvalidInput
from grape.plugins import ROBOTS, TASKS, WORLDS, Plugin, PluginError, Task, find, load


def test_built_in_plugins_are_found() -> None:
    assert {"dispenser"} <= set(find(TASKS)) and {"husky_jaco2"} <= set(find(ROBOTS)) and "vineyard" in find(WORLDS)


def test_a_built_in_robot_loads() -> None:
    assert load(ROBOTS, "husky_jaco2").name == "husky_jaco2"


def test_finding_names_imports_nothing() -> None:
    code = "import sys; from grape.plugins import TASKS, find; find(TASKS); print('grape.tasks' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "False", done.stderr


def test_a_task_of_another_package_is_found_and_loaded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "vine_pruning.py").write_text(
        "from grape.actions.recoveries import turn, wait\nfrom grape.plugins import Task\n"
        "TASK = Task(name='pruning', summary='', actions=(turn,), conditions=(wait,))\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    brought(monkeypatch, TASKS, "pruning", "vine_pruning:TASK")
    assert find(TASKS)["pruning"].origin == "vine-tools"
    task = load(TASKS, "pruning")
    assert isinstance(task, Task) and [leaf.name for leaf in task.leaves] == ["Turn", "Wait"]


def test_a_task_takes_nodes_alone() -> None:
    from grape.actions import drive_to_pose

    with pytest.raises(InvalidInput, match=r"task pruning: got <module 'grape\.actions\.drive_to_pose'.*@action"):
        Task(name="pruning", summary="", actions=(drive_to_pose,))


@pytest.mark.parametrize(
    ("line", "cause"),
    [
        ("import no_such_module", "ModuleNotFoundError: .*no_such_module"),
        ("def (:", r"SyntaxError: invalid syntax \(broken_vines_1.py, line 1\)"),
        ("raise SystemExit('usage: prune')", "SystemExit: usage: prune"),
        ("from grape.plugins import Task; Task(name='pruning', summary='', actions=(3,))", "InvalidInput: .* got 3"),
    ],
)
def test_a_plugin_that_cannot_be_imported_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, request: pytest.FixtureRequest, line: str, cause: str
) -> None:
    module = f"broken_vines_{request.node.callspec.indices['line']}"
    (tmp_path / f"{module}.py").write_text(line + "\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    brought(monkeypatch, TASKS, "pruning", f"{module}:TASK")
    with pytest.raises(PluginError, match=rf"'pruning' of vine-tools \({module}:TASK\) cannot be loaded: {cause}"):
        load(TASKS, "pruning")
    assert "dispenser" in find(TASKS)


def test_a_plugin_without_its_attribute_is_named() -> None:
    with pytest.raises(PluginError, match=r"'errors' of grape .*no attribute 'NOTHING'"):
        Plugin(group=TASKS, name="errors", target="grape.errors:NOTHING").load()


def test_of_two_plugins_of_one_name_none_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    brought(monkeypatch, TASKS, "dispenser", "vine_pruning:TASK")
    assert "dispenser" in find(TASKS)
    with pytest.raises(PluginError, match="'dispenser' is brought by grape and by vine-tools; remove one"):
        load(TASKS, "dispenser")


def test_an_unknown_name_gets_a_suggestion() -> None:
    with pytest.raises(PluginError, match=r"'husky_jaco' is not installed.*did you mean 'husky_jaco2'"):
        load(ROBOTS, "husky_jaco")


def test_an_unknown_group_is_refused() -> None:
    with pytest.raises(PluginError, match=r"no plugin group 'grape\.arms'"):
        find("grape.arms")
