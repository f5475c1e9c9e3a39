"""Actions that follow a script, a robot that notes what it is told, and a way to run a tree with both."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.actions.core import Action, Context, Feedback, InlineJobs, NoGoal, NoResult
from grape.bt import TreeExecutor, load_tree, node_library
from grape.drivers import Drivers
from grape.errors import ActionFailed, Reason

BEAT_S = 0.01


class Clock:
    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time


class Log:
    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []

    def event(self, kind: str, /, **fields: Any) -> None:
        self.events.append({"kind": kind, **fields})

    def picture(self, name: str, bgr: Any) -> None:
        raise AssertionError("no pictures here")

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [event for event in self.events if event["kind"] == kind]


class Driver:
    def __init__(self) -> None:
        self.calls: list[str] = []

    def send(self, *values: Any) -> Any:
        self.calls.append(f"send {' '.join(str(v) for v in values)}")
        return values

    def stop(self) -> None:
        self.calls.append("stop")


def context() -> Context:
    unused: Any = None
    drivers: Any = Drivers(
        base=Driver(),
        arm=Driver(),
        gripper=Driver(),
        camera=unused,
        imu=unused,
        gnss=unused,  # type: ignore[arg-type]
    )
    return Context(
        clock=Clock(),
        world=unused,
        drivers=drivers,
        robot=None,
        jobs=InlineJobs(),
        log=Log(),
        ledger=unused,
        rng=np.random.default_rng(0),
    )


def scripted(name: str, script: str) -> Action[NoGoal, NoResult]:
    """An action that at each start follows the next word of `script`: R a beat, then S success or F failure."""
    runs = script.split()
    started = 0

    def follow(goal: NoGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
        nonlocal started
        word = runs[started % len(runs)]
        started += 1
        for _ in range(word.count("R")):
            yield Feedback(status="busy")
        if word.endswith("F"):
            raise ActionFailed(Reason.BLOCKED, "as the script says")
        return NoResult()

    return Action(name, follow, NoGoal, NoResult, "follows a script")


def root(body: str, main: str = "Main", more: str = "") -> str:
    return (
        f'<root BTCPP_format="4" main_tree_to_execute="{main}">\n'
        f'<BehaviorTree ID="Main">\n{body}\n</BehaviorTree>\n{more}\n</root>\n'
    )


@pytest.fixture
def bench(tmp_path: Path) -> SimpleNamespace:
    """Everything a tree needs to run, in a folder of its own."""

    def write(xml: str, name: str = "tree.xml") -> Path:
        (tmp_path / name).write_text(xml)
        return tmp_path / name

    def executor(xml: str, leaves: Iterable[Any] = (), ctx: Context | None = None, **inputs: Any) -> TreeExecutor:
        kinds = {name: type(value) for name, value in inputs.items()}
        tree = load_tree(write(xml), node_library(leaves), inputs=kinds)
        return TreeExecutor(tree, ctx or context(), inputs, trace=True)

    def trace(body: str, ticks: int = 20, ctx: Context | None = None, **scripts: str) -> list[str]:
        """What the leaves said at each tick until the tree ended, the tree's own status last."""
        ctx = ctx or context()
        running = executor(root(body), [scripted(name, script) for name, script in scripts.items()], ctx)
        for _ in range(ticks):
            if running.tick() != "active":
                break
            ctx.clock.time += BEAT_S  # type: ignore[attr-defined]
        return [*running.trace, str(running.status)]

    return SimpleNamespace(
        context=context, scripted=scripted, root=root, executor=executor, trace=trace, write=write, folder=tmp_path
    )
