"""What another package brings through entry points reaches the command line."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from rich.console import Console

from grape.errors import FileError
from grape.mission.catalog import broken, missions, nodes, tasks, trees, world_type
from grape.mission.file import load_mission
from grape.mission.listing import print_catalog
from grape.plugins import PluginError

MODULE = """
from collections.abc import Generator
from pathlib import Path

from grape.actions.core import Context, Feedback, NoGoal, NoResult, action
from grape.plugins import Task


@action("PruneVine")
def prune_vine(goal: NoGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    '''Cuts last year's canes.'''
    yield Feedback()
    return NoResult()


HERE = Path(__file__).parent
TASK = Task(
    name="pruning",
    summary="Prunes vines.",
    actions=(prune_vine,),
    trees={"prune_row": HERE / "prune_row.xml"},
    missions={"winter_pruning": HERE / "winter_pruning.yaml"},
)
NO_TASK = 3
"""
TREE = """<root BTCPP_format="4" main_tree_to_execute="Prune">
  <BehaviorTree ID="Prune"><PruneVine/></BehaviorTree>
</root>
"""
MISSION = """name: winter_pruning
description: Prunes one vine.
task: pruning
tree: prune_row
plants: [{plant: r0v1, mode: plant}]
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Installs `vine-tools`, as pip leaves it on disk, with these entry points of the group grape.tasks."""

    def install(entries: str) -> None:
        info = tmp_path / "vine_tools-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: vine-tools\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[grape.tasks]\n{entries}\n")
        (tmp_path / "cane_pruning.py").write_text(MODULE)
        (tmp_path / "prune_row.xml").write_text(TREE)
        (tmp_path / "winter_pruning.yaml").write_text(MISSION)
        monkeypatch.syspath_prepend(str(tmp_path))

    forget()
    yield install
    forget()


def forget() -> None:
    for module in ("cane_pruning", "cane_trimming"):
        sys.modules.pop(module, None)


def listing() -> str:
    console = Console(record=True, width=200, file=open("/dev/null", "w"))  # noqa: SIM115
    print_catalog(console)
    return console.export_text()


def test_a_task_of_another_package_brings_its_nodes_trees_and_missions(package, tmp_path: Path) -> None:
    package("pruning = cane_pruning:TASK")
    assert list(nodes("pruning")) == ["PruneVine"]
    assert trees()["prune_row"] == tmp_path / "prune_row.xml" and "dispenser_deployment" in trees()
    mission = load_mission("winter_pruning")
    assert (mission.file.task, mission.tree) == ("pruning", tmp_path / "prune_row.xml")
    text = listing()
    for word in ("winter_pruning", "Prunes one vine.", "prune_row", "PruneVine", "Cuts last year's canes."):
        assert word in text


def test_its_nodes_are_no_nodes_of_our_task(package) -> None:
    package("pruning = cane_pruning:TASK")
    assert "PruneVine" not in nodes("dispenser")


def test_a_broken_package_leaves_ours_alone_and_is_listed(package) -> None:
    package("pruning = cane_pruning:GONE\ncounting = cane_pruning:NO_TASK")
    assert list(tasks()) == ["dispenser"] and "dispenser_deployment" in missions()
    gone, number = sorted(broken(), key=lambda text: "counting" in text)
    assert "'pruning' of vine-tools (cane_pruning:GONE) cannot be loaded" in gone
    assert "'counting' of vine-tools (cane_pruning:NO_TASK) must be a Task, got int" in number
    assert "cannot be loaded" in listing()
    with pytest.raises(PluginError, match="GONE"):
        nodes("pruning")


@pytest.fixture
def trimming(package, tmp_path: Path) -> Path:
    """Installs two tasks that bring a mission and a tree of the same names; the folder of the second's."""
    package("pruning = cane_pruning:TASK\ntrimming = cane_trimming:TASK")
    more = tmp_path / "more"
    more.mkdir()
    (more / "prune_row.xml").write_text(TREE)
    (more / "winter_pruning.yaml").write_text(MISSION.replace("task: pruning", "task: trimming"))
    module = MODULE.replace("Path(__file__).parent", "Path(__file__).parent / 'more'")
    (tmp_path / "cane_trimming.py").write_text(module.replace('name="pruning"', 'name="trimming"'))
    return more


def test_of_two_missions_of_one_name_each_has_its_task_before_it(trimming: Path, tmp_path: Path) -> None:
    text = listing()
    for name in ("pruning/winter_pruning", "trimming/winter_pruning", "pruning/prune_row", "trimming/prune_row"):
        assert name in text
    assert load_mission("dispenser_deployment").file.task == "dispenser"
    for task, folder in (("pruning", tmp_path), ("trimming", trimming)):
        mission = load_mission(f"{task}/winter_pruning")
        assert (mission.file.task, mission.tree) == (task, folder / "prune_row.xml")
    assert load_mission("dispenser/dispenser_deployment").name == "dispenser_deployment"


def test_a_name_that_two_tasks_bring_is_refused_when_it_is_asked_for(trimming: Path, tmp_path: Path) -> None:
    with pytest.raises(PluginError) as caught:
        load_mission("winter_pruning")
    assert str(caught.value) == (
        "mission 'winter_pruning' is brought by the tasks 'pruning' of vine-tools and 'trimming' of vine-tools;"
        " name pruning/winter_pruning or trimming/winter_pruning"
    )
    (tmp_path / "mine.yaml").write_text("name: mine\ntree: prune_row\n")
    with pytest.raises(FileError, match=r"mine.yaml:2:1: tree: tree 'prune_row' is brought by the tasks 'pruning' of"):
        load_mission(str(tmp_path / "mine.yaml"))
    assert load_mission(str(tmp_path / "mine.yaml"), ["task=pruning", "tree=trimming/prune_row"]).tree == (
        trimming / "prune_row.xml"
    )


def test_an_unknown_task_or_world_in_a_mission_lists_what_there_is(package) -> None:
    package("pruning = cane_pruning:TASK")
    with pytest.raises(FileError, match=r"task: got 'prunning'; allowed: dispenser, pruning; did you mean 'pruning'"):
        load_mission("winter_pruning", ["task=prunning"])
    with pytest.raises(PluginError, match="there are vineyard"):
        world_type("orchard")


def test_what_any_other_group_brings_is_listed_with_where_it_comes_from(package, tmp_path: Path) -> None:
    package("")
    info = tmp_path / "vine_tools-1.0.dist-info" / "entry_points.txt"
    info.write_text("[grape.costmap_layers]\npuddles = vine_tools:Puddles\n[grape.robots]\nrover = vine_tools:ROVER\n")
    (tmp_path / "vine_tools.py").write_text("class Puddles:\n    pass\nROVER = 'a robot'\n")
    text = listing()
    for line in (
        "inflation, puddles (vine-tools)",
        "Local planners: pure_pursuit, dwa, teb, mppi",
        "Global planners: legs",
        "robi_jaco2, rover (vine-tools)",
        "grape.robots plugin 'rover' of vine-tools (vine_tools:ROVER) must be a RobotDescription, got str",
    ):
        assert line in text


def test_a_mission_or_a_node_that_is_broken_keeps_nothing_else_from_being_listed(package, tmp_path: Path) -> None:
    package("pruning = cane_pruning:TASK")
    (tmp_path / "winter_pruning.yaml").unlink()
    (tmp_path / "cane_pruning.py").write_text(MODULE.replace('@action("PruneVine")', '@action("Sequence")'))
    text = listing()
    assert "error: mission 'winter_pruning': " in text and "error: task 'pruning': " in text
    assert "FinishPlant" in text and "dispenser_deployment" in text


def test_a_mission_of_a_broken_package_is_missed_with_the_cause(package) -> None:
    package("pruning = cane_pruning:GONE")
    with pytest.raises(FileError) as caught:
        load_mission("winter_pruning")
    assert "winter_pruning: no such mission; allowed: dispenser_deployment" in str(caught.value)
    assert "'pruning' of vine-tools (cane_pruning:GONE) cannot be loaded" in str(caught.value)
