"""The node types that every tree file may use, with their ports, how many children they take and how they are made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Selector, Sequence
from py_trees.decorators import FailureIsSuccess, Inverter, SuccessIsFailure, SuccessIsRunning

from grape.bt.controls import Constant, Delay, Loop, Parallel, SequenceWithMemory, SetBlackboard, Timeout
from grape.bt.ports import Direction, Port
from grape.bt.run import Run
from grape.bt.tree import Node

Make = Callable[[Node, list[Behaviour], Run], Behaviour]


class Category(StrEnum):
    """The tags of BehaviorTree.CPP's explicit notation, and how many children each takes."""

    CONTROL = "Control"
    DECORATOR = "Decorator"
    ACTION = "Action"


@dataclass(frozen=True, kw_only=True)
class Builtin:
    """One built-in node type.

    Attributes:
        minimum: smallest value of its whole-number ports, beside -1 where `endless`.
    """

    category: Category
    make: Make
    ports: Mapping[str, Port] = field(default_factory=dict)
    minimum: int = 0
    endless: bool = False


def _port(name: str, kind: Any, **options: Any) -> dict[str, Port]:
    return {name: Port(name=name, type=kind, direction=Direction.INPUT, **options)}


def _reader(node: Node, run: Run, port: str) -> Callable[[], Any]:
    return lambda: run.setting(node, port)


def _control(make: Callable[[str, list[Behaviour]], Behaviour]) -> Builtin:
    return Builtin(category=Category.CONTROL, make=lambda node, children, run: make(node.name, children))


def _decorator(make: Callable[[str, Behaviour], Behaviour]) -> Builtin:
    return Builtin(category=Category.DECORATOR, make=lambda node, children, run: make(node.name, children[0]))


def _loop(port: str, again: Status) -> Builtin:
    def make(node: Node, children: list[Behaviour], run: Run) -> Behaviour:
        return Loop(node.name, children[0], _reader(node, run, port), again)

    ports = _port(port, int, description="how often the child runs at most; -1 without end")
    return Builtin(category=Category.DECORATOR, make=make, ports=ports, minimum=1, endless=True)


def _parallel(node: Node, children: list[Behaviour], run: Run) -> Behaviour:
    return Parallel(node.name, children, _reader(node, run, "success_count"), _reader(node, run, "failure_count"))


def _constant(outcome: Status) -> Builtin:
    return Builtin(category=Category.ACTION, make=lambda node, children, run: Constant(node.name, outcome))


BUILTIN: Mapping[str, Builtin] = {
    "Sequence": _control(lambda name, children: Sequence(name, True, children)),
    "ReactiveSequence": _control(lambda name, children: Sequence(name, False, children)),
    "SequenceWithMemory": _control(SequenceWithMemory),
    "Fallback": _control(lambda name, children: Selector(name, True, children)),
    "ReactiveFallback": _control(lambda name, children: Selector(name, False, children)),
    "Parallel": Builtin(
        category=Category.CONTROL,
        make=_parallel,
        ports=_port("success_count", int, default=-1) | _port("failure_count", int, default=1),
        minimum=-1_000,
    ),
    "Inverter": _decorator(Inverter),
    "ForceSuccess": _decorator(FailureIsSuccess),
    "ForceFailure": _decorator(SuccessIsFailure),
    "KeepRunningUntilFailure": _decorator(SuccessIsRunning),
    "RetryUntilSuccessful": _loop("num_attempts", Status.FAILURE),
    "Repeat": _loop("num_cycles", Status.SUCCESS),
    "Timeout": Builtin(
        category=Category.DECORATOR,
        make=lambda node, children, run: Timeout(node, children[0], run),
        ports=_port("msec", int, description="ms of the robot's clock; 0 is no limit"),
    ),
    "Delay": Builtin(
        category=Category.DECORATOR,
        make=lambda node, children, run: Delay(node, children[0], run),
        ports=_port("delay_msec", int, description="ms of the robot's clock"),
    ),
    "AlwaysSuccess": _constant(Status.SUCCESS),
    "AlwaysFailure": _constant(Status.FAILURE),
    "SetBlackboard": Builtin(
        category=Category.ACTION,
        make=lambda node, children, run: SetBlackboard(node, run),
        ports=_port("value", Any)
        | {"output_key": Port(name="output_key", type=Any, direction=Direction.OUTPUT, description="entry to write")},
    ),
}
