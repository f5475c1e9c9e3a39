"""Runs a loaded tree, one tick a beat."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status as NodeStatus

from grape.actions.core import Action, Context, Feedback, Status
from grape.bt.blackboard import Blackboard
from grape.bt.builtin import BUILTIN
from grape.bt.leaf import ActionLeaf, ConditionLeaf, Leaf
from grape.bt.run import Failure, LeafCrashed, Run
from grape.bt.tree import Node, Tree
from grape.errors import InvalidInput

_STATUS = {NodeStatus.RUNNING: Status.ACTIVE, NodeStatus.SUCCESS: Status.SUCCEEDED, NodeStatus.FAILURE: Status.ABORTED}


class TreeExecutor:
    """One run of a tree: its own nodes and blackboard, nothing shared with another run.

    Args:
        inputs: values of the entries that `load_tree` was told of.
        trace: whether to keep what every leaf said, for tests.

    Attributes:
        trace: one line a tick, `A:success B:running`; a leaf that was preempted stands there as `B:halted`.

    Raises:
        InvalidInput: the inputs are not those that the tree was loaded with.
    """

    def __init__(self, tree: Tree, ctx: Context, inputs: Mapping[str, Any] | None = None, trace: bool = False) -> None:
        inputs = dict(inputs or {})
        if set(inputs) != set(tree.inputs):
            raise InvalidInput(f"{tree.name} takes the inputs {sorted(tree.inputs)}, got {sorted(inputs)}")
        self._events: list[str] = []
        self._tracing = trace
        self.trace: list[str] = []
        self.blackboard = Blackboard({**tree.constants, **inputs})
        self._run = Run(ctx=ctx, board=self.blackboard, halted=self._on_halt)
        self._leaves: list[Leaf] = []
        self._root = self._build(tree.root)
        self._name = tree.name
        self._status = Status.ACTIVE

    @property
    def status(self) -> Status:
        """ACTIVE until the tree ends (SUCCEEDED or ABORTED) or is halted (PREEMPTED)."""
        return self._status

    @property
    def last_failure(self) -> Failure | None:
        """The newest action that did not succeed."""
        return self._run.last_failure

    @property
    def running(self) -> tuple[ActionLeaf, ...]:
        """The actions that run now; more than one only below a Parallel."""
        found: list[ActionLeaf] = []
        open_nodes: list[Behaviour] = [self._root]
        while open_nodes:
            node = open_nodes.pop()
            if node.status != NodeStatus.RUNNING:
                continue
            if isinstance(node, ActionLeaf):
                found.append(node)
            open_nodes.extend(reversed(node.children))
        return tuple(found)

    @property
    def running_leaf(self) -> str:
        """Path of the first running action, empty when none runs."""
        running = self.running
        return running[0].path if running else ""

    @property
    def feedback(self) -> Feedback:
        """What the first running action said last."""
        running = self.running
        return running[0].feedback if running else Feedback()

    def tick(self) -> Status:
        """Advance every running action once; a tree that has ended stays as it is.

        Raises:
            LeafCrashed: a leaf raised; the robot is stopped, every other action closed, and the run is over.
        """
        if self._status is not Status.ACTIVE:
            return self._status
        try:
            for node in self._root.tick():
                if self._tracing and isinstance(node, Leaf):
                    self._events.append(f"{node.name}:{node.status.value.lower()}")
        except BaseException as error:
            self._abandon()
            if isinstance(error, Exception) and not isinstance(error, LeafCrashed):
                raise LeafCrashed(self._name, error) from error
            raise
        finally:
            self._keep_trace()
        self._status = _STATUS[self._root.status]
        return self._status

    def halt(self) -> None:
        """Preempt every running action; each leaves its leases and so stops what it held.

        Raises:
            LeafCrashed: an action raised while it was closed; the robot is stopped and the others are closed too.
        """
        if self._status is not Status.ACTIVE:
            return
        self._status = Status.PREEMPTED
        try:
            self._root.stop(NodeStatus.INVALID)
        except BaseException:
            self._abandon()
            raise
        finally:
            self._keep_trace()

    def _abandon(self) -> None:
        """End a run that cannot go on: stop the robot, then close what still runs, whatever it raises."""
        self._status = Status.ABORTED
        log = self._run.ctx.log
        try:
            self._run.ctx.drivers.stop_all()
        except Exception as error:
            log.event("stop_failed", path=self._name, error=f"{type(error).__name__}: {error}")
        for leaf in self._leaves:
            try:
                leaf.terminate(NodeStatus.INVALID)
            except Exception as error:
                log.event("close_failed", path=leaf.path, error=str(error))

    def _build(self, node: Node) -> Behaviour:
        if node.leaf is not None:
            leaf = (ActionLeaf if isinstance(node.leaf, Action) else ConditionLeaf)(node, self._run)
            self._leaves.append(leaf)
            return leaf
        return BUILTIN[node.tag].make(node, [self._build(child) for child in node.children], self._run)

    def _on_halt(self, name: str) -> None:
        if self._tracing:
            self._events.append(f"{name}:halted")

    def _keep_trace(self) -> None:
        if self._tracing:
            self.trace.append(" ".join(self._events))
            self._events.clear()
