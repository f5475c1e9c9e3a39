"""Puts every SubTree in its place and follows each blackboard entry from its writers to its readers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from grape.bt.blackboard import Scope
from grape.bt.parse import Parsed
from grape.bt.ports import fits, parse_literal, type_name
from grape.bt.tree import Entry, Literal, Node
from grape.errors import MOST_PROBLEMS, InvalidInput, Problem, did_you_mean
from grape.xml_document import Element

MAX_TREE_DEPTH = 100
MAX_TREE_NODES = 5_000


@dataclass(frozen=True, kw_only=True)
class Use:
    """One place of a file where an entry is read or written; `text` is set where text is written."""

    element: Element
    port: str
    key: str
    type: Any
    text: str | None = None


@dataclass(kw_only=True)
class Flow:
    """Who reads and writes each entry."""

    reads: dict[str, list[Use]] = field(default_factory=dict)
    writes: dict[str, list[Use]] = field(default_factory=dict)


class TooLarge(Exception):
    """The expanded tree is too deep or has too many nodes."""


def find_cycles(trees: Mapping[str, Parsed | None]) -> set[Problem]:
    """A problem for each SubTree element that closes a cycle."""
    problems: set[Problem] = set()
    done: set[str] = set()
    for first in trees:
        if first in done:
            continue
        chain = {first: _calls(trees.get(first))}  # the trees that are open, the last one called by that before
        while chain:
            tree = next(reversed(chain))
            node = next(chain[tree], None)
            if node is None:
                done.add(tree)
                del chain[tree]
            elif node.tag in chain:
                loop = [*chain][[*chain].index(node.tag) :]
                got = f"SubTree cycle {' -> '.join([*loop, node.tag])}"
                problems.add(node.element.problem(got, "trees that do not call themselves", "", "ID"))
            elif node.tag not in done:
                chain[node.tag] = _calls(trees.get(node.tag))
    return problems


def _calls(root: Parsed | None) -> Iterator[Parsed]:
    """The SubTree elements of a tree."""
    return (node for node in (_walk(root) if root is not None else ()) if node.element.tag == "SubTree")


def _walk(root: Parsed) -> list[Parsed]:
    return [root, *(node for child in root.children for node in _walk(child))]


class Expander:
    """Builds the nodes of the main tree.

    Args:
        trees: parsed trees by ID, without cycles.
    """

    def __init__(self, trees: Mapping[str, Parsed | None]) -> None:
        self._trees = trees
        self._count = 0
        self.flow = Flow()
        self.constants: dict[str, str] = {}
        self.unused: set[Problem] = set()

    def expand(self, main: str) -> Node | None:
        """The main tree with all SubTrees in place.

        Raises:
            TooLarge: it is deeper than 100 levels or has more than 5000 nodes.
        """
        root = self._trees[main]
        return self._node(root, Scope(), main, 1) if root is not None else None

    def _node(self, parsed: Parsed, scope: Scope, above: str, depth: int, suffix: str = "") -> Node | None:
        self._count += 1
        if depth > MAX_TREE_DEPTH or self._count > MAX_TREE_NODES:
            raise TooLarge(f"the tree is deeper than {MAX_TREE_DEPTH} levels or has more than {MAX_TREE_NODES} nodes")
        path = f"{above}/{parsed.name}{suffix}"
        if parsed.element.tag == "SubTree":
            return self._subtree(parsed, scope, path, depth)
        inputs: dict[str, Literal | Entry] = {k: Literal(value=v) for k, v in parsed.literals.items()}
        for port, key in parsed.reads.items():
            entry = scope.entry(key)
            inputs[port] = Entry(name=entry)
            self._note(self.flow.reads, entry, parsed, port, key)
        outputs = {port: scope.entry(key) for port, key in parsed.writes.items()}
        for port, entry in outputs.items():
            self._note(self.flow.writes, entry, parsed, port, parsed.writes[port], self._text(parsed))
        children, seen = [], dict[str, int]()
        for child in parsed.children:
            seen[child.name] = seen.get(child.name, 0) + 1
            mark = f"#{seen[child.name]}" if seen[child.name] > 1 else ""
            if (node := self._node(child, scope, path, depth + 1, mark)) is not None:
                children.append(node)
        return Node(
            tag=parsed.tag,
            name=parsed.name,
            path=path,
            leaf=parsed.leaf,
            ports=parsed.ports,
            inputs=inputs,
            outputs=outputs,
            children=tuple(children),
        )

    def _text(self, parsed: Parsed) -> str | None:
        return parsed.literals.get("value") if parsed.tag == "SetBlackboard" else None

    def _note(
        self, uses: dict[str, list[Use]], entry: str, parsed: Parsed, port: str, key: str, text: str | None = None
    ) -> None:
        kind = parsed.ports[port].type
        use = Use(element=parsed.element, port=port, key=key, type=kind, text=text)
        uses.setdefault(entry, []).append(use)

    def _subtree(self, parsed: Parsed, outer: Scope, path: str, depth: int) -> Node | None:
        root = self._trees.get(parsed.tag)
        if root is None:
            return None
        scope = Scope(path=path, parent=outer, remapped=parsed.reads, autoremap=parsed.autoremap)
        for key, text in parsed.texts.items():
            entry = f"{path}/{key}"
            scope.own.add(key)
            self.constants[entry] = text
            use = Use(element=parsed.element, port=key, key=key, type=str, text=text)
            self.flow.writes.setdefault(entry, []).append(use)
        node = self._node(root, scope, path, depth + 1)
        for key in (*parsed.reads, *parsed.texts):
            if key not in scope.used:
                got = f"tree {parsed.tag!r} does not use the port {key!r}"
                hint = did_you_mean(key, scope.used)
                allowed = ", ".join(sorted(scope.used)) or "no ports"
                self.unused.add(parsed.element.problem(got, allowed, hint, key))
        return node


def type_conflicts(flow: Flow) -> set[Problem]:
    """A problem for each reader whose type no value of one of the entry's writers has."""
    problems: set[Problem] = set()
    for entry, readers in flow.reads.items():
        misfits: dict[Any, list[str]] = {}  # by the type that is read: many read the same
        for read in readers:
            if len(problems) >= MOST_PROBLEMS:
                return problems
            if read.type not in misfits:
                writers = flow.writes.get(entry, [])
                misfits[read.type] = [text for write in writers if (text := _misfit(write, read.type))][:MOST_PROBLEMS]
            for text in misfits[read.type]:
                got = f"port {read.port!r} reads {{{read.key}}}, which {text}"
                problems.add(read.element.problem(got, type_name(read.type), "", read.port))
    return problems


def _misfit(write: Use, kind: Any) -> str:
    """What a writer does that a reader of type `kind` cannot take; empty when nothing."""
    place = f"{write.element.tag} at {write.element.file}:{write.element.line}"
    if write.text is not None:
        try:
            parse_literal(write.text, kind)
        except InvalidInput as error:
            return f"{place} sets to text that does not fit: {error}"
        return ""
    return "" if fits(write.type, kind) else f"{place} writes as {type_name(write.type)}"


def never_written(flow: Flow, given: Mapping[str, Any]) -> set[Problem]:
    """A problem for each reader of an entry that nothing writes and the caller does not give."""
    written = {use.key for uses in flow.writes.values() for use in uses} | set(given)
    problems: set[Problem] = set()
    for entry, readers in flow.reads.items():
        if entry in flow.writes or entry in given:
            continue
        for read in readers:
            if len(problems) >= MOST_PROBLEMS:
                return problems
            got = f"port {read.port!r} reads {{{read.key}}}, which nothing writes"
            hint = did_you_mean(read.key, written - {read.key})
            problems.add(read.element.problem(got, "an entry that a node writes, or text", hint, read.port))
    return problems
