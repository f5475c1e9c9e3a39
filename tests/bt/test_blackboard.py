"""Which entry a key means, and what text on the blackboard becomes."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from grape.actions.core import Context, condition
from grape.bt import LeafCrashed
from grape.bt.blackboard import Blackboard, MissingEntry, Scope, reference
from grape.errors import InvalidInput


@dataclass(frozen=True, kw_only=True)
class SeeGoal:
    value: int


def see(seen: list[int]) -> Any:
    @condition("See")
    def look(goal: SeeGoal, ctx: Context) -> bool:
        seen.append(goal.value)
        return True

    return look


def test_references_are_told_from_text() -> None:
    assert reference("{ plant }", "p") == "plant"
    assert reference("{=}", "p") == "p"
    assert reference("{@plant}", "p") == "@plant"
    assert reference("plant", "p") is None
    with pytest.raises(InvalidInput, match="no blackboard key"):
        reference("{1 2}", "p")


def test_a_scope_sees_only_what_is_mapped() -> None:
    main = Scope()
    inner = Scope(path="Main/Serve", parent=main, remapped={"plant": "current"})
    assert inner.entry("plant") == "current"
    assert inner.entry("other") == "Main/Serve/other"
    assert inner.entry("@other") == "other"


def test_autoremap_shares_all_but_private_keys() -> None:
    inner = Scope(path="Main/Serve", parent=Scope(), autoremap=True, own={"fixed"})
    assert inner.entry("plant") == "plant"
    assert inner.entry("_plant") == "Main/Serve/_plant"
    assert inner.entry("fixed") == "Main/Serve/fixed"


def test_text_is_read_as_the_type_of_the_port() -> None:
    board = Blackboard({"n": "3"})
    assert board.read("n", int) == 3 and board.read("n", str) == "3" and board.read("n") == "3"
    with pytest.raises(MissingEntry, match="'m'"):
        board.read("m", int)
    with pytest.raises(InvalidInput, match="no whole number"):
        Blackboard({"n": "x"}).read("n", int)


def test_two_runs_share_no_entry(bench: SimpleNamespace) -> None:
    body = '<SetBlackboard value="1" output_key="x"/>'
    first, second = bench.executor(bench.root(body)), bench.executor(bench.root(body))
    first.tick()
    assert first.blackboard.entries() == {"x": "1"} and second.blackboard.entries() == {}


SUBTREES = {
    "remapped": ('<SubTree ID="B" n="{x}"/>', 7),
    "text": ('<SubTree ID="B" n="5"/>', 5),
    "text beats autoremap": ('<SubTree ID="B" n="5" _autoremap="true"/>', 5),
}


@pytest.mark.parametrize("way", SUBTREES)
def test_a_subtree_reads_its_ports(bench: SimpleNamespace, way: str) -> None:
    call, value = SUBTREES[way]
    seen: list[int] = []
    body = f'<Sequence><SetBlackboard value="7" output_key="{{x}}"/>{call}</Sequence>'
    more = '<BehaviorTree ID="B"><See value="{n}"/></BehaviorTree>'
    assert bench.executor(bench.root(body, more=more), [see(seen)]).tick() == "succeeded"
    assert seen == [value]


def test_autoremap_and_main_references_reach_the_main_tree(bench: SimpleNamespace) -> None:
    seen: list[int] = []
    body = (
        '<Sequence><SetBlackboard value="7" output_key="n"/><SubTree ID="B" _autoremap="true"/><SubTree ID="C"/>'
        '<See value="{n}"/></Sequence>'
    )
    more = (
        '<BehaviorTree ID="B"><Sequence><See value="{n}"/><SetBlackboard value="8" output_key="n"/></Sequence>'
        '</BehaviorTree><BehaviorTree ID="C"><See value="{@n}"/></BehaviorTree>'
    )
    bench.executor(bench.root(body, more=more), [see(seen)]).tick()
    assert seen == [7, 8, 8]


def test_a_number_of_attempts_can_come_from_the_blackboard(bench: SimpleNamespace) -> None:
    body = '<RetryUntilSuccessful num_attempts="{n}"><AlwaysFailure/></RetryUntilSuccessful>'
    running = bench.executor(bench.root(body), n=3)
    assert [running.tick() for _ in range(3)] == ["active", "active", "aborted"]


def test_a_control_whose_port_is_not_yet_written_names_itself(bench: SimpleNamespace) -> None:
    body = (
        '<Sequence><Timeout name="limit" msec="{t}"><AlwaysSuccess/></Timeout>'
        '<SetBlackboard value="10" output_key="t"/></Sequence>'
    )
    with pytest.raises(LeafCrashed, match="Main/Sequence/limit: MissingEntry"):
        bench.executor(bench.root(body)).tick()


def test_inputs_must_be_those_that_were_declared(bench: SimpleNamespace) -> None:
    from grape.bt import TreeExecutor, load_tree

    tree = load_tree(
        bench.write(bench.root('<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>')), {}, inputs={"n": int}
    )
    with pytest.raises(InvalidInput, match=r"takes the inputs \['n'\], got \[\]"):
        TreeExecutor(tree, bench.context())
