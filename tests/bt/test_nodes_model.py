"""The TreeNodesModel that Groot2 reads, and the check of one that a tree file brings along."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Generator
from dataclasses import dataclass
from enum import StrEnum
from types import SimpleNamespace
from typing import Any

import pytest

from grape.actions.core import Context, Feedback, NoGoal, action, condition
from grape.bt import check_tree, node_library, nodes_model


class Side(StrEnum):
    LEFT = "left"


@dataclass(frozen=True, kw_only=True)
class ReachGoal:
    """Where to.

    Attributes:
        plant: id in the
            site file.
        side: of the robot.
    """

    plant: str
    side: Side = Side.LEFT
    speed: float = 0.5
    count: int = 2
    slow: bool = False
    via: tuple[float, ...] = (1.0, 2.5)
    thing: object = None
    targets: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ReachResult:
    error: float
    targets: tuple[str, ...]


@action("Reach")
def reach(goal: ReachGoal, ctx: Context) -> Generator[Feedback, None, ReachResult]:
    """Reaches somewhere."""
    yield Feedback()
    return ReachResult(error=0.0, targets=())


@condition("IsThere")
def is_there(goal: NoGoal, ctx: Context) -> bool:
    """Whether it is there."""
    return True


NODES = node_library([reach, is_there])


def ports() -> dict[str, ElementTree.Element]:
    root = ElementTree.fromstring(nodes_model(NODES))
    return {port.attrib["name"]: port for port in root.iterfind("TreeNodesModel/Action[@ID='Reach']/*[@name]")}


def test_the_model_names_every_node_with_its_kind() -> None:
    root = ElementTree.fromstring(nodes_model(NODES))
    assert root.attrib == {"BTCPP_format": "4"}
    assert [(node.tag, node.attrib["ID"]) for node in root[0]] == [("Condition", "IsThere"), ("Action", "Reach")]
    assert "Reaches somewhere." in nodes_model(NODES)


def test_ports_carry_direction_type_default_and_description() -> None:
    found: dict[str, tuple[Any, ...]] = {
        name: (port.tag, port.attrib["type"], port.attrib.get("default")) for name, port in ports().items()
    }
    assert found == {
        "plant": ("input_port", "std::string", None),
        "side": ("input_port", "Side", "left"),
        "speed": ("input_port", "double", "0.5"),
        "count": ("input_port", "int", "2"),
        "slow": ("input_port", "bool", "false"),
        "via": ("input_port", "tuple[float, ...]", "1.0;2.5"),
        "thing": ("input_port", "object", None),
        "targets": ("inout_port", "tuple[str, ...]", ""),
        "error": ("output_port", "double", None),
        "reason": ("output_port", "Reason", None),
        "detail": ("output_port", "std::string", None),
    }
    assert ports()["plant"].text == "id in the site file." and ports()["side"].text == "of the robot."


def test_a_file_may_carry_the_model_that_the_library_exports(bench: SimpleNamespace) -> None:
    model = nodes_model(NODES).split("<TreeNodesModel>")[1].split("</TreeNodesModel>")[0]
    xml = bench.root("<IsThere/>", more=f"<TreeNodesModel>{model}</TreeNodesModel>")
    assert check_tree(bench.write(xml), NODES) == ()


WRONG = {
    "unknown node": ('<Action ID="Rech"/>', "declares 'Rech', which no library has"),
    "wrong kind": ('<Action ID="IsThere"/>', "declares 'IsThere' as Action; allowed: Condition"),
    "no ID": ("<Action/>", "ID is missing"),
    "no node": ("<Leaf/>", "not expected in a TreeNodesModel"),
    "lacks a port": ('<Action ID="Reach"/>', "the model of 'Reach' lacks the port 'plant'"),
    "unknown port": (
        '<Action ID="Reach"><input_port name="plant"/><input_port name="sped"/></Action>',
        "'Reach' has no port 'sped'",
    ),
    "wrong direction": (
        '<Action ID="Reach"><output_port name="plant"/></Action>',
        "declared as output_port; allowed: in",
    ),
    "wrong type": (
        '<Action ID="Reach"><input_port name="plant" type="int"/></Action>',
        "port 'plant' of 'Reach' is declared as 'int'; allowed: std::string",
    ),
}


@pytest.mark.parametrize("mistake", WRONG)
def test_a_model_that_differs_from_the_library_is_reported(bench: SimpleNamespace, mistake: str) -> None:
    model, got = WRONG[mistake]
    xml = bench.root("<IsThere/>", more=f"<TreeNodesModel>{model}</TreeNodesModel>")
    found = check_tree(bench.write(xml), NODES)
    assert len(found) == 1 and got in str(found[0])
