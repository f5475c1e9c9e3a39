"""Leaves of a tree: an action that advances once a tick, and a condition that is answered at once."""

from __future__ import annotations

import dataclasses
import enum
import traceback
from collections.abc import Generator
from typing import Any

import numpy as np
from py_trees.behaviour import Behaviour
from py_trees.common import Status as NodeStatus

from grape.actions.core import Action, Condition, Feedback, NoResult, Status
from grape.bt.blackboard import MissingEntry
from grape.bt.run import Failure, LeafCrashed, Run
from grape.bt.tree import Node
from grape.errors import ActionFailed, GoalRejected, InvalidInput, LeaseRevoked, Reason, StaleData


class Leaf(Behaviour):
    """What actions and conditions share: the goal from the ports, the outputs, and what happens at a crash."""

    def __init__(self, node: Node, run: Run) -> None:
        super().__init__(node.name)
        self.node = node
        self.path = node.path
        self._run = run

    def _goal(self) -> Any:
        """The goal with the present values of the ports; the mission's defaults stand in for those not given.

        Raises:
            GoalRejected: an entry is missing, its text does not fit, or the goal refuses the values.
        """
        leaf = self.node.leaf
        assert leaf is not None
        names = dict.fromkeys([*self.node.inputs, *self._run.ctx.config.get(self.node.tag, ())])
        try:
            return leaf.goal_type(**{name: self._run.read(self.node, name) for name in names})
        except (MissingEntry, InvalidInput) as error:
            raise GoalRejected(str(error)) from error

    def _output(self, port: str, value: Any) -> None:
        entry = self.node.outputs.get(port)
        if entry is not None:
            self._run.board.write(entry, value)

    def _crash(self, cause: Exception) -> LeafCrashed:
        """Stop the robot, write down where and why, and name the leaf."""
        log = self._run.ctx.log
        try:
            self._run.ctx.drivers.stop_all()
        except Exception as error:
            log.event("stop_failed", path=self.path, error=f"{type(error).__name__}: {error}")
        text = "".join(traceback.format_exception(cause))
        log.event("crash", name=self.node.tag, path=self.path, error=f"{type(cause).__name__}: {cause}", traceback=text)
        return LeafCrashed(self.path, cause)


class ActionLeaf(Leaf):
    """Runs an action: starts its generator, advances it once a tick, closes it when the tree preempts it.

    Attributes:
        feedback: what the action yielded last.
        outcome: how it stands; reason and detail say why it did not succeed.
    """

    def __init__(self, node: Node, run: Run) -> None:
        super().__init__(node, run)
        assert isinstance(node.leaf, Action)
        self._action = node.leaf
        self._generator: Generator[Feedback, None, Any] | None = None
        self._rejected: GoalRejected | None = None
        self._goal_fields: dict[str, Any] = {}
        self._start = 0.0
        self.feedback = Feedback()
        self.outcome: Status | None = None
        self.reason: str | None = None
        self.detail = ""

    @property
    def status_text(self) -> str:
        """The newest phrase for a person, or the action's name while it has none."""
        return self.feedback.status or self.node.tag

    def initialise(self) -> None:
        """Read the goal from the ports and start the generator; nothing of the action runs yet."""
        self._start = self._run.ctx.clock.now()
        self.feedback, self._rejected, self._goal_fields = Feedback(), None, {}
        self.outcome, self.reason, self.detail = Status.ACTIVE, None, ""
        try:
            goal = self._goal()
            self._goal_fields = plain_fields(goal)
            self._generator = self._action(goal, self._run.ctx)
        except GoalRejected as rejected:
            self._rejected = rejected
        except Exception as error:
            raise self._crashed(error) from error
        self._report(end=None)

    def update(self) -> NodeStatus:
        """Advance the action by one beat."""
        try:
            if self._rejected is not None or self._generator is None:
                raise self._rejected or RuntimeError("ticked before it was started")
            feedback = next(self._generator)
            if not isinstance(feedback, Feedback):
                raise TypeError(f"an action must yield Feedback, got {type(feedback).__name__}")
            self.feedback = feedback
            return NodeStatus.RUNNING
        except StopIteration as stop:
            return self._succeed(stop.value)
        except GoalRejected as rejected:
            return self._fail(Status.REJECTED, rejected.reason, rejected.detail)
        except ActionFailed as failed:
            return self._fail(Status.ABORTED, failed.reason, failed.detail)
        except StaleData as stale:
            return self._fail(Status.ABORTED, Reason.STALE_DATA, str(stale))
        except LeaseRevoked as revoked:
            return self._fail(Status.PREEMPTED, None, str(revoked))
        except Exception as error:
            raise self._crashed(error) from error

    def terminate(self, new_status: NodeStatus) -> None:
        """Close the generator when the tree takes the leaf away while it runs."""
        generator, self._generator = self._generator, None
        if generator is None:
            return
        try:
            generator.close()
        except Exception as error:
            raise self._crashed(error) from error
        if new_status == NodeStatus.INVALID:
            self._run.halted(self.name)
            self._end(Status.PREEMPTED, None, "the tree took another branch or was halted")

    def _succeed(self, result: Any) -> NodeStatus:
        self._generator = None
        wanted = self._action.result_type
        if not isinstance(result, wanted) and not (result is None and wanted is NoResult):
            error = TypeError(f"the result must be a {wanted.__name__}, got {type(result).__name__}")
            raise self._crashed(error)
        if result is not None:
            for field in dataclasses.fields(result):
                self._output(field.name, getattr(result, field.name))
        self._end(Status.SUCCEEDED, None, "")
        return NodeStatus.SUCCESS

    def _fail(self, status: Status, reason: str | None, detail: str) -> NodeStatus:
        self._generator = None
        for port, value in (("reason", reason or status.value), ("detail", detail)):
            if port not in self._result_fields():
                self._output(port, value)
        self._end(status, reason, detail)
        return NodeStatus.FAILURE

    def _result_fields(self) -> set[str]:
        return {field.name for field in dataclasses.fields(self._action.result_type)}

    def _crashed(self, cause: Exception) -> LeafCrashed:
        generator, self._generator = self._generator, None
        if generator is not None:
            try:
                generator.close()
            except Exception as error:
                cause.add_note(f"and closing it raised {type(error).__name__}: {error}")
        crash = self._crash(cause)
        self._end(Status.ABORTED, Reason.INTERNAL_ERROR, f"{type(cause).__name__}: {cause}")
        return crash

    def _end(self, status: Status, reason: str | None, detail: str) -> None:
        self.outcome, self.reason, self.detail = status, reason, detail
        if status is not Status.SUCCEEDED:
            self._run.last_failure = Failure(path=self.path, status=status, reason=reason, detail=detail)
        self._report(end=self._run.ctx.clock.now())

    def _report(self, end: float | None) -> None:
        self._run.ctx.log.event(
            "action",
            name=self.node.tag,
            path=self.path,
            status=str(self.outcome),
            reason=str(self.reason) if self.reason is not None else "",
            detail=self.detail,
            start=self._start,
            end=end,
            goal=self._goal_fields,
        )


class ConditionLeaf(Leaf):
    """Asks a condition at every tick; true is SUCCESS. An answer is logged when it differs from the one before."""

    def __init__(self, node: Node, run: Run) -> None:
        super().__init__(node, run)
        assert isinstance(node.leaf, Condition)
        self._condition = node.leaf
        self._answer: bool | None = None
        self.detail = ""

    def update(self) -> NodeStatus:
        """Ask it; a question that cannot be answered (stale data, rejected goal) counts as false."""
        try:
            answer, self.detail = bool(self._condition(self._goal(), self._run.ctx)), ""
        except ActionFailed as failed:
            answer, self.detail = False, str(failed)
        except StaleData as stale:
            answer, self.detail = False, str(stale)
        except Exception as error:
            raise self._crash(error) from error
        if answer != self._answer:
            self._answer = answer
            self._run.ctx.log.event(
                "condition",
                name=self.node.tag,
                path=self.path,
                answer=answer,
                detail=self.detail,
            )
        return NodeStatus.SUCCESS if answer else NodeStatus.FAILURE


def plain_fields(value: Any) -> dict[str, Any]:
    """The fields of a dataclass as the event log takes them; objects are named by their type."""
    return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}


def _plain(value: Any) -> Any:
    if isinstance(value, enum.Enum):
        return value.value
    if value is None or isinstance(value, bool | int | float | str | np.ndarray):
        return value
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return f"<{type(value).__name__}>"
