"""The same XML in the real BehaviorTree.CPP: same status and same leaf starts, tick by tick."""

from __future__ import annotations

import random
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import SimpleNamespace

import behaviortreepy
import pytest

import grape.trees

LEAVES = "ABCDE"
TICKS = 12


def cpp_trace(xml: str, scripts: dict[str, str], ticks: int = TICKS, beat_s: float = 0.0) -> list[str]:
    """As `bench.trace`, from BehaviorTree.CPP. Halts are noted at the tick in which they happen."""
    factory = behaviortreepy.BehaviorTreeFactory()
    events: list[str] = []
    for name, script in scripts.items():
        register(factory, name, script.split(), events)
    tree = factory.create_tree_from_text(xml)
    lines = []
    status = behaviortreepy.NodeStatus.RUNNING
    for _ in range(ticks):
        status = tree.tick_exactly_once()
        lines.append(" ".join(events))
        events.clear()
        if status != behaviortreepy.NodeStatus.RUNNING:
            break
        time.sleep(beat_s)
    names = {"RUNNING": "active", "SUCCESS": "succeeded", "FAILURE": "aborted"}
    return [*lines, names[status.name]]


def register(factory: object, name: str, runs: list[str], events: list[str]) -> None:
    state = SimpleNamespace(started=0, word="", beat=0)
    letters = {"R": "running", "S": "success", "F": "failure"}

    def advance(node: object) -> object:
        letter = state.word[state.beat]
        state.beat += 1
        events.append(f"{name}:{letters[letter]}")
        return getattr(behaviortreepy.NodeStatus, letters[letter].upper())

    def start(node: object) -> object:
        state.word, state.beat = runs[state.started % len(runs)], 0
        state.started += 1
        return advance(node)

    def halt(node: object) -> None:
        events.append(f"{name}:halted")

    factory.register_simple_stateful_action(name, start, advance, halt)  # type: ignore[attr-defined]


CONTROLS = [
    ("Sequence", {}),
    ("SequenceWithMemory", {}),
    ("Fallback", {}),
    ("ReactiveSequence", {}),
    ("ReactiveFallback", {}),
    ("Parallel", {}),
    ("Parallel", {"success_count": "1", "failure_count": "-1"}),
    ("Parallel", {"success_count": "1", "failure_count": "1"}),
    ("Parallel", {"success_count": "2", "failure_count": "2"}),
]
DECORATORS = [
    ("Inverter", {}),
    ("ForceSuccess", {}),
    ("ForceFailure", {}),
    ("KeepRunningUntilFailure", {}),
    ("RetryUntilSuccessful", {"num_attempts": "2"}),
    ("RetryUntilSuccessful", {"num_attempts": "-1"}),
    ("Repeat", {"num_cycles": "3"}),
]


def grow(rng: random.Random, unused: list[str], depth: int) -> ElementTree.Element:
    """A random tree in which every leaf occurs once."""
    kind = rng.random()
    if depth == 0 or not unused or kind < 0.15:
        return ElementTree.Element(unused.pop() if unused else rng.choice(["AlwaysSuccess", "AlwaysFailure"]))
    if kind < 0.45:
        tag, attributes = rng.choice(DECORATORS)
        element = ElementTree.Element(tag, attributes)
        element.append(grow(rng, unused, depth - 1))
        return element
    tag, attributes = rng.choice(CONTROLS)
    element = ElementTree.Element(tag, attributes)
    for _ in range(rng.randint(2, 3)):
        element.append(grow(rng, unused, depth - 1))
    return element


def random_script(rng: random.Random) -> str:
    return " ".join("R" * rng.choice([0, 0, 1, 2]) + rng.choice("SF") for _ in range(4))


def comparable(trace: list[str]) -> list[object]:
    """The trace with the halts of a tick sorted to its end: in which order siblings are halted is not specified."""
    lines: list[object] = []
    for line in trace[:-1]:
        words = line.split()
        lines.append(([w for w in words if "halted" not in w], sorted(w for w in words if "halted" in w)))
    return [*lines, trace[-1]]


@pytest.mark.parametrize("block", range(10))
def test_random_trees_tick_as_in_behaviortree_cpp(bench: SimpleNamespace, block: int) -> None:
    for seed in range(block * 40, block * 40 + 40):
        rng = random.Random(seed)
        unused = list(LEAVES)
        body = ElementTree.tostring(grow(rng, unused, 4), encoding="unicode")
        scripts = {name: random_script(rng) for name in LEAVES}
        ours = bench.trace(body, TICKS, **scripts)
        theirs = cpp_trace(bench.root(body), scripts)
        assert comparable(ours) == comparable(theirs), f"seed {seed}: {body} with {scripts}"


def test_a_timeout_halts_its_child_in_both(bench: SimpleNamespace) -> None:
    body = '<Fallback><Timeout msec="40"><A/></Timeout><B/></Fallback>'
    scripts = {"A": "R" * 50 + "S", "B": "S"}
    ours, theirs = bench.trace(body, **scripts), cpp_trace(bench.root(body), scripts, ticks=50, beat_s=0.01)
    #   ticks 1 to 4: A runs; tick 5, at 40 ms: A is halted, B succeeds
    assert ours == ["A:running"] * 4 + ["A:halted B:success", "succeeded"]
    assert theirs[0] == "A:running" and theirs[-1] == "succeeded"
    assert " ".join(theirs).count("A:halted") == 1 and theirs[-2].endswith("B:success")


def test_a_delay_waits_before_its_child_in_both(bench: SimpleNamespace) -> None:
    body, scripts = '<Delay delay_msec="30"><A/></Delay>', {"A": "RS"}
    ours, theirs = bench.trace(body, **scripts), cpp_trace(bench.root(body), scripts, ticks=50, beat_s=0.01)
    assert ours == ["", "", "", "A:running", "A:success", "succeeded"]
    assert [line for line in theirs if line] == ["A:running", "A:success", "succeeded"]


def portless(path: Path) -> tuple[str, set[str]]:
    """A tree file with every custom leaf as a SubTree around a stub, since the binding cannot declare ports."""
    root = ElementTree.parse(path).getroot()
    for model in root.findall("TreeNodesModel"):
        root.remove(model)
    known = {tag for tag, _ in [*CONTROLS, *DECORATORS]} | {
        "AlwaysSuccess",
        "AlwaysFailure",
        "SetBlackboard",
        "SubTree",
    }
    known |= {"Timeout", "Delay", "BehaviorTree", "root", "include"}
    custom = set()
    for element in root.iter():
        if element.tag not in known:
            custom.add(element.tag)
            element.attrib["ID"] = element.tag
            element.tag = "SubTree"
    for name in sorted(custom):
        definition = ElementTree.SubElement(root, "BehaviorTree", ID=name)
        ElementTree.SubElement(definition, f"Stub{name}")
    return ElementTree.tostring(root, encoding="unicode"), custom


SHIPPED = sorted(Path(grape.trees.__file__).parent.glob("*.xml"))


def test_there_are_shipped_trees() -> None:
    assert SHIPPED


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_trees_run_in_behaviortree_cpp(path: Path) -> None:
    xml, custom = portless(path)
    trace = cpp_trace(xml, {f"Stub{name}": "S" for name in custom}, ticks=3)
    assert custom and trace[0]
