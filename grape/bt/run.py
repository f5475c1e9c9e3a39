"""What the nodes of one running tree share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from grape.actions.core import Context, Status
from grape.bt.blackboard import Blackboard, MissingEntry
from grape.bt.tree import Literal, Node
from grape.errors import GrapeError, InvalidInput


class LeafCrashed(GrapeError):
    """A leaf raised something it does not promise; the robot was stopped and the mission has to end.

    Args:
        path: names from the main tree down to the leaf.
        cause: what it raised.
    """

    def __init__(self, path: str, cause: BaseException) -> None:
        super().__init__(f"{path}: {type(cause).__name__}: {cause}")
        self.path = path
        self.cause = cause


@dataclass(frozen=True, kw_only=True)
class Failure:
    """How a leaf failed."""

    path: str
    status: Status
    reason: str | None
    detail: str


@dataclass(kw_only=True)
class Run:
    """What its nodes share.

    Attributes:
        last_failure: the newest action that did not succeed, None while there was none.
        halted: called with a leaf's name when the tree preempts it.
    """

    ctx: Context
    board: Blackboard
    last_failure: Failure | None = None
    halted: Callable[[str], None] = field(default=lambda name: None)

    def read(self, node: Node, port: str) -> Any:
        """The present value of an input port; what the tree does not give comes from the mission, else the field.

        Raises:
            MissingEntry: it reads an entry that nothing has written, and it has no default.
            InvalidInput: the entry's text does not fit the port.
        """
        value = node.inputs.get(port)
        declared = node.ports[port]
        default = self.ctx.config.get(node.tag, {}).get(port, declared.default)
        if value is None:
            return default
        if isinstance(value, Literal):
            return value.value
        if value.name not in self.board and not declared.required:
            return default
        return self.board.read(value.name, declared.type)

    def setting(self, node: Node, port: str) -> Any:
        """The present value of a port of a built-in node.

        Raises:
            LeafCrashed: it cannot be read; the tree is wrong, and the node is named.
        """
        try:
            return self.read(node, port)
        except (MissingEntry, InvalidInput) as error:
            raise LeafCrashed(node.path, error) from error
