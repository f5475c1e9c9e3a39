"""The code of docs/writing_an_action.md runs, and does what the page says."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.bt import load_tree, node_library
from grape.errors import FileError, GoalRejected, Reason

PAGE = Path(__file__).parents[2] / "docs" / "writing_an_action.md"


@pytest.fixture
def page(tmp_path: Path) -> Iterator[ModuleType]:
    """Every Python block of the page as one module."""
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    path = tmp_path / "writing_an_action.py"
    path.write_text("\n\n".join(blocks))
    spec = importlib.util.spec_from_file_location("writing_an_action", path)
    assert spec is not None and spec.loader is not None
    module = sys.modules["writing_an_action"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules["writing_an_action"]


def moving(bench: SimpleNamespace, factor: float) -> Any:
    """A context whose clock advances a beat whenever the base is told to move, at `factor` times the speed."""
    ctx = bench.context()

    def send(linear_x: float, angular_z: float) -> Any:
        ctx.clock.time += 0.01
        return SimpleNamespace(linear=np.array([factor * linear_x, 0.0, 0.0]))

    ctx.drivers.base.send = send
    return ctx


def test_the_tree_of_the_page_runs(bench: SimpleNamespace, page: ModuleType) -> None:
    executor = page.run(page.load(bench.write(page.TREE)), moving(bench, 1.0))
    # beats 1, 2: Creep moves; beat 3: 0.02 s are over, and Within answers
    assert executor.trace == ["Creep:running", "Creep:running", "Creep:success Within:success"]
    assert executor.status == "succeeded" and executor.blackboard.entries()["took"] == pytest.approx(0.02)


def test_a_base_that_refuses_leaves_its_reason(bench: SimpleNamespace, page: ModuleType) -> None:
    executor = page.run(page.load(bench.write(page.TREE)), moving(bench, 0.0))
    assert executor.status == "aborted" and executor.blackboard.entries()["why"] == Reason.BLOCKED


def test_mistakes_in_the_tree_are_found_when_it_is_loaded(bench: SimpleNamespace, page: ModuleType) -> None:
    wrong = page.TREE.replace('distance="-0.002"', 'distance="-0.002" speed="7"').replace("<Within", "<Whitin")
    with pytest.raises(FileError) as caught:
        page.load(bench.write(wrong))
    assert [problem.path for problem in caught.value.problems] == ["Creep", "Whitin"]
    assert "at most 0.3 m/s" in caught.value.problems[0].got


def test_a_goal_that_is_too_far_is_rejected(bench: SimpleNamespace, page: ModuleType) -> None:
    with pytest.raises(GoalRejected, match="at most 1 m"):
        next(page.creep(page.CreepGoal(distance=2.0), bench.context()))


def test_the_task_of_the_page_names_its_nodes(page: ModuleType) -> None:
    names = [leaf.name for leaf in page.TASK.leaves]
    assert names == ["Creep", "DriveToPose", "WaitForLocalization", "Within"] and not page.TASK.serves_plants


def test_the_tree_that_waits_first_is_one_of_the_task(bench: SimpleNamespace, page: ModuleType) -> None:
    tree = bench.write(page.TREE.replace("<Fallback>", "<WaitForLocalization/><Fallback>", 1))
    load_tree(tree, node_library(page.TASK.leaves))
    with pytest.raises(FileError, match=r"unknown node 'WaitForLocalization'.*`--task` of `grape check`"):
        page.load(tree)
