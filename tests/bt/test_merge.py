"""A tree file and the files it includes become one file that loads to the same tree."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import SimpleNamespace

import behaviortreepy
import pytest

from grape.bt import check_tree, load_tree, merge_includes, node_library, nodes_model
from grape.errors import FileError
from grape.xml_document import MAX_BYTES, MAX_ELEMENTS, read_document


def tree(name: str, body: str, more: str = "") -> str:
    return f'<root BTCPP_format="4">{more}<BehaviorTree ID="{name}">{body}</BehaviorTree></root>'


@pytest.fixture
def main(bench: SimpleNamespace) -> Path:
    """A file that includes one in a sub-folder, which includes one beside the first, twice and by two paths."""
    (bench.folder / "parts").mkdir()
    more = '<include path="parts/b.xml"/><include path="c.xml"/>'
    bench.write(tree("B", '<SubTree ID="C" name="deep"/>', '<include path="../c.xml"/>'), "parts/b.xml")
    bench.write(tree("C", '<Sequence><AlwaysSuccess name="end"/></Sequence><!-- no more -->'), "c.xml")
    path: Path = bench.write(bench.root('<Fallback><SubTree ID="B"/><SubTree ID="C"/></Fallback>', more=more))
    return path


def alone(xml: bytes, folder: Path) -> Path:
    """A file with this content in a new folder."""
    (folder / "alone").mkdir()
    (folder / "alone" / "tree.xml").write_bytes(xml)
    return folder / "alone" / "tree.xml"


def test_the_merged_file_loads_alone_to_the_same_tree(main: Path) -> None:
    nodes = node_library([])
    before, after = load_tree(main, nodes), load_tree(alone(merge_includes(main), main.parent), nodes)
    assert list(after.root.walk()) == list(before.root.walk())
    assert "Main/Fallback/B/deep/Sequence/end" in [node.path for node in after.root.walk()]


def test_the_merged_file_has_every_tree_once_and_the_root_of_the_main_file(main: Path) -> None:
    root = ElementTree.fromstring(merge_includes(main))
    assert root.attrib == {"BTCPP_format": "4", "main_tree_to_execute": "Main"}
    assert sorted((child.tag, child.attrib["ID"]) for child in root) == [
        ("BehaviorTree", name) for name in ("B", "C", "Main")
    ]


def test_behaviortree_cpp_reads_the_merged_file(main: Path) -> None:
    factory = behaviortreepy.BehaviorTreeFactory()
    status = factory.create_tree_from_text(merge_includes(main).decode()).tick_while_running()
    assert status == behaviortreepy.NodeStatus.SUCCESS


def test_a_merged_file_stays_as_it_is_when_merged_again(main: Path) -> None:
    merged = merge_includes(main)
    assert merge_includes(alone(merged, main.parent)) == merged


SOURCES = {
    "comments and layout": b"<!-- a -->\n<root  BTCPP_format=\"4\" main_tree_to_execute='A' >%s</root>",
    "line ends of Windows": b'<root BTCPP_format="4" main_tree_to_execute="A">\r\n%s\r\n</root>\r\n',
    "a byte order mark": b'\xef\xbb\xbf<root BTCPP_format="4" main_tree_to_execute="A">%s</root>',
    "another encoding": b'<?xml version="1.0" encoding="ISO-8859-1"?>'
    b'<root BTCPP_format="4" main_tree_to_execute="A" project_name="\xe9">%s</root>',
}


@pytest.mark.parametrize("source", SOURCES)
def test_a_file_without_includes_stays_byte_for_byte(bench: SimpleNamespace, source: str) -> None:
    content = SOURCES[source] % b'<BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>'
    assert merge_includes(alone(content, bench.folder)) == content


def test_a_file_that_includes_only_itself_no_longer_does(bench: SimpleNamespace) -> None:
    path = bench.write(bench.root("<AlwaysSuccess/>", more='<include path="tree.xml"/>'))
    assert b"include" not in merge_includes(path)


def test_values_of_attributes_survive_whatever_is_in_them(bench: SimpleNamespace) -> None:
    value = "<a> & \"b\" 'c' ]]> é 葡萄 🍇 \r\n\t; two  blanks "
    written = "&lt;a> &amp; &quot;b&quot; 'c' ]]> é &#33889;萄 🍇 &#13;&#10;&#9;; two  blanks "
    bench.write(tree("B", f'<SetBlackboard value="{written}" output_key="k"/>'), "b.xml")
    path = bench.write(bench.root('<SubTree ID="B"/>', more='<include path="b.xml"/>'))
    merged = read_document(alone(merge_includes(path), bench.folder))
    (node,) = merged.children[1].children
    assert node.attributes == {"value": value, "output_key": "k"}


def test_the_models_of_all_files_become_one_with_each_node_once(bench: SimpleNamespace) -> None:
    nodes = node_library([bench.scripted("Reach", "S"), bench.scripted("Grasp", "S")])
    model = nodes_model(nodes).split("?>")[1].replace('<root BTCPP_format="4">', "").replace("</root>", "")
    only_grasp = '<TreeNodesModel><Action ID="Grasp"><MetadataFields/></Action><SubTree ID="B"/></TreeNodesModel>'
    bench.write(tree("B", "<Grasp/>", only_grasp), "b.xml")
    path = bench.write(bench.root('<SubTree ID="B"/>', more=model + '<include path="b.xml"/>'))
    merged = merge_includes(path)
    assert check_tree(alone(merged, bench.folder), nodes) == ()
    (found,) = ElementTree.fromstring(merged).iterfind("TreeNodesModel")
    assert [(node.tag, node.attrib["ID"]) for node in found] == [
        ("Action", "Grasp"),
        ("Action", "Reach"),
        ("SubTree", "B"),
    ]
    texts = [port.text for port in ElementTree.fromstring(model).iter("output_port")]
    assert any(texts) and [port.text for port in found.iter("output_port")] == texts


def test_what_is_wrong_with_an_included_file_is_told(bench: SimpleNamespace) -> None:
    path = bench.write(bench.root("<AlwaysSuccess/>", more='<include path="nowhere.xml"/>'))
    with pytest.raises(FileError, match="include: no file"):
        merge_includes(path)


@pytest.mark.parametrize(
    "body",
    ["<Sequence>" + "<AlwaysSuccess/>" * (MAX_ELEMENTS // 2) + "</Sequence>", f'<A b="{"c" * (MAX_BYTES // 2)}"/>'],
)
def test_files_that_are_too_large_together_are_refused_by_the_loader_too(bench: SimpleNamespace, body: str) -> None:
    bench.write(tree("B", body), "b.xml")
    bench.write(tree("C", body), "c.xml")
    path = bench.write(bench.root("<AlwaysSuccess/>", more='<include path="b.xml"/><include path="c.xml"/>'))
    with pytest.raises(FileError, match="too large with those it includes"):
        merge_includes(path)
    assert any("too large with those it includes" in problem.got for problem in check_tree(path, node_library([])))
