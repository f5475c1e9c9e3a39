"""Puts every SubTree in its place and follows each blackboard entry from its writers to its readers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from grape.bt.blackboard import Scope
from grape.bt.document import Element
from grape.bt.parse import Parsed
from grape.bt.ports import fits, parse_literal, type_name
from grape.bt.tree import Entry, Literal, Node
from grape.errors import InvalidInput, Problem, did_you_mean

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

    def visit(tree: str, chain: tuple[str, ...]) -> None:
        root = trees.get(tree)
        if root is None or tree in done:
            return
        for node in _walk(root):
            if node.element.tag != "SubTree":
                continue
            if node.tag in (*chain, tree):
                loop = [*chain, tree][[*chain, tree].index(node.tag) :]
                got = f"SubTree cycle {' -> '.join([*loop, node.tag])}"
                problems.add(node.element.problem(got, "trees that do not call themselves", "", "ID"))
            else:
                visit(node.tag, (*chain, tree))
        done.add(tree)

    for tree in trees:
        visit(tree, ())
    return problems


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
    problems = set()
    for entry, readers in flow.reads.items():
        for read in readers:
            for write in flow.writes.get(entry, []):
                trouble = _conflict(write, read)
                if trouble:
                    problems.add(read.element.problem(trouble, type_name(read.type), "", read.port))
    return problems


def _conflict(write: Use, read: Use) -> str:
    place = f"{write.element.tag} at {write.element.file}:{write.element.line}"
    if write.text is not None:
        try:
            parse_literal(write.text, read.type)
        except InvalidInput as error:
            return f"port {read.port!r} reads {{{read.key}}}, which {place} sets to text that does not fit: {error}"
        return ""
    if fits(write.type, read.type):
        return ""
    return f"port {read.port!r} reads {{{read.key}}}, which {place} writes as {type_name(write.type)}"


def never_written(flow: Flow, given: Mapping[str, Any]) -> set[Problem]:
    """A problem for each reader of an entry that nothing writes and the caller does not give."""
    written = {use.key for uses in flow.writes.values() for use in uses} | set(given)
    problems = set()
    for entry, readers in flow.reads.items():
        if entry in flow.writes or entry in given:
            continue
        for read in readers:
            got = f"port {read.port!r} reads {{{read.key}}}, which nothing writes"
            hint = did_you_mean(read.key, written - {read.key})
            problems.add(read.element.problem(got, "an entry that a node writes, or text", hint, read.port))
    return problems
