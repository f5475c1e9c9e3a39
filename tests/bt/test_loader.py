"""Every mistake in a tree file is reported with its place, all of them at once."""

from __future__ import annotations

import re
from collections.abc import Generator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated

import pytest
from pydantic import AfterValidator, Field

from grape.actions.core import Context, Feedback, NoGoal, NoResult, action, condition
from grape.bt import check_tree, load_tree, node_library
from grape.errors import FileError, InvalidInput
from grape.xml_document import MAX_BYTES


class Colour(StrEnum):
    RED = "red"
    GREEN = "green"


class Cloud:
    """Something that only a blackboard can carry."""


@dataclass(frozen=True, kw_only=True)
class PaintGoal:
    plant: str
    colour: Colour = Colour.RED
    speed: float = 1.0
    coats: int = 1
    dry: bool = False
    point: tuple[float, float, float] | None = None
    cloud: Cloud | None = None

    def __post_init__(self) -> None:
        if self.speed < 0:
            raise InvalidInput(f"speed must not be negative, got {self.speed}")


@dataclass(frozen=True, kw_only=True)
class PaintResult:
    area: float


@action("Paint")
def paint(goal: PaintGoal, ctx: Context) -> Generator[Feedback, None, PaintResult]:
    """Paints."""
    yield Feedback()
    return PaintResult(area=1.0)


@dataclass(frozen=True, kw_only=True)
class CloudResult:
    cloud: Cloud


@action("Look")
def look(goal: NoGoal, ctx: Context) -> Generator[Feedback, None, CloudResult]:
    """Looks."""
    yield Feedback()
    return CloudResult(cloud=Cloud())


def known_brush(brush: str) -> str:
    if brush not in ("flat", "round"):
        raise InvalidInput(f"no brush {brush!r}")
    return brush


@dataclass(frozen=True, kw_only=True)
class BrushGoal:
    brush: Annotated[str, AfterValidator(known_brush)] = "flat"
    width: Annotated[float, Field(gt=0)] = 1.0


@condition("HasBrush")
def has_brush(goal: BrushGoal, ctx: Context) -> bool:
    """Whether it has a brush."""
    return True


@dataclass(frozen=True, kw_only=True)
class CountGoal:
    number: int


@condition("IsMany")
def is_many(goal: CountGoal, ctx: Context) -> bool:
    """Whether there are many."""
    return goal.number > 2


NODES = node_library([paint, look, is_many, has_brush])


def problems(bench: SimpleNamespace, xml: str) -> list[str]:
    """The problems without the folder, one string each."""
    return [str(p).replace(f"{bench.folder}/", "") for p in check_tree(bench.write(xml), NODES)]


def only(bench: SimpleNamespace, body: str, more: str = "") -> str:
    found = problems(bench, bench.root(body, more=more))
    assert len(found) == 1, found
    return found[0]


def test_a_right_file_has_no_problem(bench: SimpleNamespace) -> None:
    body = '<Sequence><Look cloud="{c}"/><Paint plant="v1" point="1;2.5;-3e-1" dry="true" cloud="{c}"/></Sequence>'
    assert problems(bench, bench.root(body)) == []
    tree = load_tree(bench.folder / "tree.xml", NODES)
    assert [node.path for node in tree.root.walk()] == ["Main/Sequence", "Main/Sequence/Look", "Main/Sequence/Paint"]
    assert tree.root.children[1].inputs["point"].value == (1.0, 2.5, -0.3)  # type: ignore[union-attr]


def test_nodes_may_be_written_in_the_explicit_notation(bench: SimpleNamespace) -> None:
    body = (
        '<Control ID="Sequence"><Decorator ID="Inverter"><Condition ID="IsMany" number="1"/></Decorator>'
        '<Action ID="Paint" plant="v1"/></Control>'
    )
    assert problems(bench, bench.root(body)) == []


# One row a mistake: what stands in the tree, where the problem is, and what it says.
MISTAKES = {
    "unknown node": ('<Pant plant="a"/>', "3:1: Pant: unknown node 'Pant'", "did you mean 'Paint'?"),
    "tree used as node": ("<Main/>", "3:1: Main: unknown node 'Main'", '<SubTree ID="Main"/>'),
    "explicit without ID": ("<Action/>", "3:1: Action: ID is missing", ""),
    "explicit of the wrong kind": ('<Action ID="IsMany" number="3"/>', "'IsMany' is no Action", "Condition"),
    "missing port": ("<Paint/>", "3:1: Paint: port 'plant' is missing", "plant=... (str)"),
    "unknown port": ('<Paint plant="a"\n  colur="red"/>', "4:3: Paint: unknown port 'colur'", "did you mean 'colour'?"),
    "no whole number": (
        '<Paint plant="a" coats="2.5"/>',
        "3:18: Paint: coats: '2.5' is no whole number",
        "allowed: int",
    ),
    "no number": ('<Paint plant="a" speed="fast"/>', "speed: 'fast' is no finite number", "allowed: float"),
    "not finite": ('<Paint plant="a" speed="nan"/>', "speed: 'nan' is no finite number", ""),
    "too large a number": ('<Paint plant="a" speed="1e999"/>', "speed: '1e999' is no finite number", ""),
    "no choice": ('<Paint plant="a" colour="rad"/>', "colour: 'rad' is none of red, green", "did you mean 'red'?"),
    "no bool": ('<Paint plant="a" dry="maybe"/>', "dry: 'maybe' is none of true", ""),
    "wrong tuple length": ('<Paint plant="a" point="1;2"/>', "point: '1;2' has 2 values separated by ';'", "has 3"),
    "object as text": ('<Paint plant="a" cloud="big"/>', "a Cloud cannot be written as text", "{key}"),
    "output as text": ('<Paint plant="a" area="x"/>', "port 'area' is written, got the text 'x'", "{key}"),
    "bad key": ('<Paint plant="{a b}"/>', "'{a b}' is no blackboard key", ""),
    "refused goal": ('<Paint plant="a" speed="-1"/>', "the goal is refused: speed must not be negative, got -1.0", ""),
    "never written": ('<Paint plant="{plnt}"/>', "port 'plant' reads {plnt}, which nothing writes", ""),
    "script attribute": ('<Paint plant="a" _skipIf="x"/>', "'_skipIf' is not supported", ""),
    "leaf with children": ('<Paint plant="a"><AlwaysSuccess/></Paint>', "Paint: 1 children", "no children"),
    "decorator without child": ("<Inverter/>", "Inverter: 0 children", "exactly 1"),
    "decorator with two": ("<Inverter><AlwaysSuccess/><AlwaysSuccess/></Inverter>", "2 children", "exactly 1"),
    "control without child": ("<Sequence/>", "Sequence: 0 children", "at least 1"),
    "no attempts": (
        '<RetryUntilSuccessful num_attempts="0"><AlwaysSuccess/></RetryUntilSuccessful>',
        "num_attempts is 0",
        "at least 1, or -1",
    ),
    "negative time": ('<Timeout msec="-1"><AlwaysSuccess/></Timeout>', "msec is -1", "at least 0"),
    "time is missing": ("<Timeout><AlwaysSuccess/></Timeout>", "port 'msec' is missing", ""),
    "threshold too high": (
        '<Parallel success_count="2"><AlwaysSuccess/></Parallel>',
        "success_count is 2, but there are 1 children",
        "at most 1",
    ),
    "nothing to write to": ('<SetBlackboard value="1"/>', "port 'output_key' is missing", ""),
    "unknown tree": ('<SubTree ID="Mian"/>', "SubTree: no tree 'Mian'", "did you mean 'Main'?"),
    "stray text": ("<Sequence>oops<AlwaysSuccess/></Sequence>", "text 'oops' between elements", ""),
    "cycle": ('<SubTree ID="Main"/>', "SubTree cycle Main -> Main", "trees that do not call themselves"),
    "type conflict": (
        '<Sequence>\n<Paint plant="a" area="{x}"/>\n<IsMany number="{x}"/></Sequence>',
        "5:9: IsMany: port 'number' reads {x}, which Paint at",
        "writes as float; allowed: int",
    ),
    "text of the wrong type": (
        '<Sequence><SetBlackboard value="many" output_key="x"/><IsMany number="{x}"/></Sequence>',
        "sets to text that does not fit: 'many' is no whole number",
        "",
    ),
    "refused by a field's check": ('<HasBrush brush="flut"/>', "3:11: HasBrush: brush: no brush 'flut'", ""),
    "outside a field's bounds": ('<HasBrush width="-1"/>', "width: -1.0: Input should be greater than 0", ""),
    "text for a field that checks": (
        '<Sequence><SetBlackboard value="flut" output_key="b"/><HasBrush brush="{b}"/></Sequence>',
        "sets to text that does not fit: no brush 'flut'",
        "",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_reported_where_it_stands(bench: SimpleNamespace, mistake: str) -> None:
    body, got, hint = MISTAKES[mistake]
    found = only(bench, body)
    assert got in found and hint in found and found.startswith("tree.xml:")


def test_every_mistake_is_reported_at_once_in_the_order_of_the_file(bench: SimpleNamespace) -> None:
    body = '<Sequence>\n<Pant/>\n<Paint/>\n<Paint plant="a" coats="x" area="{a}"/>\n<IsMany number="{a}"/>\n</Sequence>'
    path = bench.write(bench.root(body))
    with pytest.raises(FileError) as caught:
        load_tree(path, NODES)
    assert [problem.line for problem in caught.value.problems] == [4, 5, 6, 7]


ROOTS = {
    "no format": ('<root main_tree_to_execute="A">{}</root>', "1:1: root: BTCPP_format is missing"),
    "old format": (
        '<root BTCPP_format="3" main_tree_to_execute="A">{}</root>',
        "1:7: root: format '3' is not supported",
    ),
    "no main tree": ('<root BTCPP_format="4">{}</root>', "main_tree_to_execute is missing"),
    "unknown main tree": (
        '<root BTCPP_format="4" main_tree_to_execute="B">{}</root>',
        "the main tree 'B' is not in the",
    ),
    "other root": ('<tree BTCPP_format="4" main_tree_to_execute="A">{}</tree>', "the outermost element is wrong"),
    "other attribute": ('<root BTCPP_format="4" main_tree_to_execute="A" x="1">{}</root>', "unknown attribute 'x'"),
    "other child": ('<root BTCPP_format="4" main_tree_to_execute="A">{}<Tree/></root>', "not expected under <root>"),
    "text": ('<root BTCPP_format="4" main_tree_to_execute="A">{}oops</root>', "text between elements"),
}


@pytest.mark.parametrize("mistake", ROOTS)
def test_a_mistake_at_the_root_is_reported(bench: SimpleNamespace, mistake: str) -> None:
    frame, got = ROOTS[mistake]
    found = problems(bench, frame.format('<BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>'))
    assert len(found) == 1 and got in found[0]


def test_a_tree_without_id_and_a_second_tree_of_one_id_are_reported(bench: SimpleNamespace) -> None:
    more = '<BehaviorTree ID="Main"><AlwaysFailure/></BehaviorTree><BehaviorTree><AlwaysFailure/></BehaviorTree>'
    found = problems(bench, bench.root("<AlwaysSuccess/>", more=more))
    assert "a second tree 'Main'; the first is at" in found[0] and "the tree has no ID" in found[1]


def test_a_tree_holds_exactly_one_node(bench: SimpleNamespace) -> None:
    assert "BehaviorTree: 2 children" in only(bench, "<AlwaysSuccess/><AlwaysSuccess/>")


def test_a_cycle_through_two_trees_is_named(bench: SimpleNamespace) -> None:
    more = '<BehaviorTree ID="B"><SubTree ID="Main"/></BehaviorTree>'
    assert "SubTree cycle Main -> B -> Main" in only(bench, '<SubTree ID="B"/>', more)


def test_trees_that_multiply_are_refused_before_they_fill_the_memory(bench: SimpleNamespace) -> None:
    doubling = "".join(
        f'<BehaviorTree ID="T{k}"><Sequence><SubTree ID="T{k + 1}"/><SubTree ID="T{k + 1}"/></Sequence></BehaviorTree>'
        for k in range(40)
    )
    more = doubling + '<BehaviorTree ID="T40"><AlwaysSuccess/></BehaviorTree>'
    assert "more than 5000 nodes" in only(bench, '<SubTree ID="T0"/>', more)


def test_a_tree_that_is_too_deep_is_refused(bench: SimpleNamespace) -> None:
    more = "".join(
        f'<BehaviorTree ID="T{k}"><Inverter><SubTree ID="T{k + 1}"/></Inverter></BehaviorTree>' for k in range(60)
    )
    more += '<BehaviorTree ID="T60"><AlwaysSuccess/></BehaviorTree>'
    assert "deeper than 100 levels" in only(bench, '<SubTree ID="T0"/>', more)


def test_a_long_chain_of_trees_is_refused(bench: SimpleNamespace) -> None:
    trees = [f'<BehaviorTree ID="T{k}"><SubTree ID="T{k + 1}"/></BehaviorTree>' for k in range(2000)]
    more = "".join([*trees, '<BehaviorTree ID="T2000"><AlwaysSuccess/></BehaviorTree>'])
    (problem,) = check_tree(bench.write(bench.root('<SubTree ID="T0"/>', more=more)), NODES)
    assert "deeper than 100 levels" in problem.got


@pytest.mark.parametrize(
    ("node", "got"),
    [
        ("<Nod/>", "unknown node"),
        ('<Paint plant="{p}"/>', "nothing writes"),
        ('<IsMany number="{m}"/>', "does not fit"),
    ],
)
def test_of_very_many_mistakes_the_first_are_reported(bench: SimpleNamespace, node: str, got: str) -> None:
    write = '<SetBlackboard value="a" output_key="m"/>'
    problems = check_tree(bench.write(bench.root(f"<Sequence>{write}{node * 1000}</Sequence>")), NODES)
    assert len(problems) == 100
    assert all(got in problem.got for problem in problems)


def test_each_of_very_many_attributes_has_its_place(bench: SimpleNamespace) -> None:
    attributes = "\n".join(f'{" " * (k % 7)}a{k}="é"' for k in range(20_000))
    problems = check_tree(bench.write(bench.root(f"\n<AlwaysSuccess\n{attributes}/>")), NODES)
    first = problems[0].line - int(re.findall(r"'a(\d+)'", problems[0].got)[0])
    for problem in problems:
        k = int(re.findall(r"'a(\d+)'", problem.got)[0])
        assert (problem.line, problem.column) == (first + k, 1 + k % 7)


def test_a_subtree_port_that_the_tree_does_not_use_is_reported(bench: SimpleNamespace) -> None:
    more = '<BehaviorTree ID="B"><Paint plant="{plant}"/></BehaviorTree>'
    found = only(bench, '<SubTree ID="B" plant="v1" plnt="v2"/>', more)
    assert "tree 'B' does not use the port 'plnt'" in found and "did you mean 'plant'?" in found


def test_a_subtree_that_lacks_a_port_is_reported_at_the_reader(bench: SimpleNamespace) -> None:
    more = '<BehaviorTree ID="B"><Paint plant="{plant}"/></BehaviorTree>'
    assert "Paint: port 'plant' reads {plant}, which nothing writes" in only(bench, '<SubTree ID="B"/>', more)


def test_included_trees_are_found_and_their_mistakes_named_by_file(bench: SimpleNamespace) -> None:
    bench.write('<root BTCPP_format="4"><BehaviorTree ID="B"><Pant/></BehaviorTree></root>', "other.xml")
    found = only(bench, '<SubTree ID="B"/>', '<include path="other.xml"/><include path="other.xml"/>')
    assert found.startswith("other.xml:1:") and "unknown node 'Pant'" in found


def test_files_that_include_each_other_are_read_once(bench: SimpleNamespace) -> None:
    other = (
        '<root BTCPP_format="4"><include path="tree.xml"/><BehaviorTree ID="B"><AlwaysSuccess/></BehaviorTree></root>'
    )
    bench.write(other, "other.xml")
    assert problems(bench, bench.root('<SubTree ID="B"/>', more='<include path="other.xml"/>')) == []


def test_an_include_of_a_missing_file_is_reported_where_it_stands(bench: SimpleNamespace) -> None:
    assert "5:10: include: no file" in only(bench, "<AlwaysSuccess/>", '<include path="nowhere.xml"/>')
    assert "an include needs a path" in only(bench, "<AlwaysSuccess/>", '<include ros_pkg="x" path="a.xml"/>')


HOSTILE = {
    "entity expansion": ('<!DOCTYPE r [<!ENTITY a "b">]><root>&a;</root>', "document type declaration"),
    "not closed": ("<root>", "not well-formed XML"),
    "no XML": ("plan: 1", "not well-formed XML"),
    "empty": ("", "not well-formed XML"),
    "too deep": ("<a>" * 200 + "</a>" * 200, "deeper than 100 levels"),
    "too many": ("<r>" + "<a/>" * 20_001 + "</r>", "more than 20000 elements"),
    "too large": ("<r>" + " " * MAX_BYTES + "</r>", "the file is too large"),
}


@pytest.mark.parametrize("attack", HOSTILE)
def test_hostile_files_are_refused(bench: SimpleNamespace, attack: str) -> None:
    source, got = HOSTILE[attack]
    found = problems(bench, source)
    assert len(found) == 1 and got in found[0]


def test_bytes_that_are_no_text_are_refused(bench: SimpleNamespace) -> None:
    path: Path = bench.folder / "tree.xml"
    path.write_bytes(b"<root>\xff\xfe</root>")
    assert "not well-formed" in str(check_tree(path, NODES)[0])
    path.write_bytes(b'<?xml version="1.0" encoding="no-such"?><root/>')
    assert len(check_tree(path, NODES)) == 1


def test_a_file_that_is_not_there_is_reported(bench: SimpleNamespace) -> None:
    assert "cannot be read" in str(check_tree(bench.folder / "none.xml", NODES)[0])


def test_two_nodes_of_one_name_and_names_of_built_in_nodes_are_refused() -> None:
    @action("Paint")
    def other(goal: NoGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
        yield Feedback()
        return NoResult()

    @condition("Sequence")
    def sequence(goal: NoGoal, ctx: Context) -> bool:
        return True

    with pytest.raises(InvalidInput, match="two nodes are called 'Paint'"):
        node_library([paint, other])
    with pytest.raises(InvalidInput, match="'Sequence' is a built-in node"):
        node_library([sequence])


@dataclass(frozen=True, kw_only=True)
class NamedGoal:
    name: str


@dataclass(frozen=True, kw_only=True)
class AreaGoal:
    area: str


def test_ports_that_a_file_cannot_carry_are_refused() -> None:
    @condition("Named")
    def named(goal: NamedGoal, ctx: Context) -> bool:
        return True

    @action("Area")
    def area(goal: AreaGoal, ctx: Context) -> Generator[Feedback, None, PaintResult]:
        yield Feedback()
        return PaintResult(area=1.0)

    with pytest.raises(InvalidInput, match="a port cannot be called 'name'"):
        node_library([named])
    with pytest.raises(InvalidInput, match="port 'area' is str in the goal and float in the result"):
        node_library([area])


def test_inputs_count_as_written_and_have_a_type(bench: SimpleNamespace) -> None:
    path = bench.write(bench.root('<IsMany number="{n}"/>'))
    assert check_tree(path, NODES, inputs={"n": int}) == ()
    assert "writes as str" in str(check_tree(path, NODES, inputs={"n": str})[0])


def test_another_main_tree_can_be_chosen(bench: SimpleNamespace) -> None:
    more = '<BehaviorTree ID="B"><AlwaysFailure/></BehaviorTree>'
    tree = load_tree(bench.write(bench.root("<AlwaysSuccess/>", more=more)), NODES, main="B")
    assert tree.root.tag == "AlwaysFailure"
