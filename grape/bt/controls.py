"""Controls and decorators with the semantics of BehaviorTree.CPP 4 where py_trees has none that match."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Composite
from py_trees.decorators import Decorator

from grape.bt.run import Run
from grape.bt.tree import Node
from grape.errors import InvalidInput

TIME_TOLERANCE_S = 1e-9  # a beat that falls on the limit up to rounding counts as reaching it


class SequenceWithMemory(Composite):
    """A sequence that, after a failure or a halt, goes on with the child where it stood.

    After a child that succeeds within the tick it was started in, the next one waits for the next tick.
    """

    def __init__(self, name: str, children: list[Behaviour]) -> None:
        super().__init__(name, children)
        self._index = 0

    def tick(self) -> Iterator[Behaviour]:
        """Tick children from the remembered one until one does not succeed."""
        new_status = Status.SUCCESS
        while self._index < len(self.children):
            child = self.current_child = self.children[self._index]
            fresh = child.status != Status.RUNNING
            yield from child.tick()
            if child.status != Status.SUCCESS:
                new_status = child.status
                break
            self._index += 1
            if fresh and self._index < len(self.children):
                new_status = Status.RUNNING
                break
        else:
            self._index = 0
        if new_status != Status.RUNNING:
            self.stop(new_status)
        self.status = new_status
        yield self


class Parallel(Composite):
    """Ticks every unfinished child until enough succeeded or failed.

    Args:
        success_count: how many have to succeed; -1 all, -2 all but one, ...
        failure_count: how many failures end it; counted alike.
    """

    def __init__(
        self, name: str, children: list[Behaviour], success_count: Callable[[], int], failure_count: Callable[[], int]
    ) -> None:
        super().__init__(name, children)
        self._read_success, self._read_failure = success_count, failure_count
        self._to_succeed = self._to_fail = 0
        self._finished: dict[int, Status] = {}

    def tick(self) -> Iterator[Behaviour]:
        """Tick the children in order; the first that decides the outcome ends the tick."""
        if self.status != Status.RUNNING:
            self._finished = {}
            self._to_succeed = self._threshold(self._read_success())
            self._to_fail = self._threshold(self._read_failure())
        new_status = Status.RUNNING
        for k, child in enumerate(self.children):
            if k not in self._finished:
                self.current_child = child
                yield from child.tick()
                if child.status != Status.RUNNING:
                    self._finished[k] = child.status
            new_status = self._verdict()
            if new_status != Status.RUNNING:
                break
        if new_status != Status.RUNNING:
            for child in self.children:
                if child.status == Status.RUNNING:
                    child.stop(Status.INVALID)
            self.stop(new_status)
        self.status = new_status
        yield self

    def _threshold(self, count: int) -> int:
        if count > len(self.children):
            raise InvalidInput(f"{self.name}: a Parallel of {len(self.children)} children cannot wait for {count}")
        return count if count >= 0 else max(len(self.children) + count + 1, 0)

    def _verdict(self) -> Status:
        outcomes = list(self._finished.values())
        succeeded, failed = outcomes.count(Status.SUCCESS), outcomes.count(Status.FAILURE)
        if succeeded >= self._to_succeed:
            return Status.SUCCESS
        if len(self.children) - failed < self._to_succeed or failed == self._to_fail:
            return Status.FAILURE
        return Status.RUNNING


class Wrapper(Decorator):
    """A decorator that decides itself when to tick its child."""

    def tick(self) -> Iterator[Behaviour]:
        """Begin if it was not running, then advance."""
        if self.status != Status.RUNNING:
            self._begin()
        new_status = yield from self._advance()
        if new_status != Status.RUNNING:
            self.stop(new_status)
        self.status = new_status
        yield self

    def update(self) -> Status:
        """The present status; `tick` sets it."""
        return self.status

    def _begin(self) -> None:
        raise NotImplementedError

    def _advance(self) -> Generator[Behaviour, None, Status]:
        raise NotImplementedError

    def _tick_child(self) -> Generator[Behaviour, None, Status]:
        yield from self.decorated.tick()
        return self.decorated.status


class Loop(Wrapper):
    """Runs its child again and again: RetryUntilSuccessful after failures, Repeat after successes.

    A child that ends within the tick it was started in waits for the next tick, so a loop never blocks a beat.

    Args:
        limit: how often the child runs; -1 without end.
        again: the child's outcome after which it runs again.
    """

    def __init__(self, name: str, child: Behaviour, limit: Callable[[], int], again: Status) -> None:
        super().__init__(name, child)
        self._read_limit = limit
        self._again = again
        self._limit = self._count = 0

    def _begin(self) -> None:
        self._limit, self._count = self._read_limit(), 0

    def _advance(self) -> Generator[Behaviour, None, Status]:
        """Tick the child, once more if a run that began in an earlier tick has just ended."""
        while True:
            fresh = self.decorated.status != Status.RUNNING
            outcome = yield from self._tick_child()
            if outcome != self._again:
                return outcome
            self._count += 1
            if self._count == self._limit:
                return outcome
            if fresh:
                return Status.RUNNING


class Timeout(Wrapper):
    """Halts its child and fails when the child is still running after `msec` of the robot's clock; 0 is no limit."""

    def __init__(self, node: Node, child: Behaviour, run: Run) -> None:
        super().__init__(node.name, child)
        self._node, self._run = node, run
        self._limit_s = self._start = 0.0

    def _begin(self) -> None:
        self._limit_s = self._run.setting(self._node, "msec") / 1000.0
        self._start = self._run.ctx.clock.now()

    def _advance(self) -> Generator[Behaviour, None, Status]:
        """Tick the child while there is time."""
        elapsed = self._run.ctx.clock.now() - self._start + TIME_TOLERANCE_S
        if self.status == Status.RUNNING and 0 < self._limit_s <= elapsed:
            self.decorated.stop(Status.INVALID)
            self._run.ctx.log.event("timeout", path=self._node.path, after_s=self._limit_s)
            return Status.FAILURE
        return (yield from self._tick_child())


class Delay(Wrapper):
    """Waits `delay_msec` of the robot's clock before it ticks its child."""

    def __init__(self, node: Node, child: Behaviour, run: Run) -> None:
        super().__init__(node.name, child)
        self._node, self._run = node, run
        self._wait_s = self._start = 0.0

    def _begin(self) -> None:
        self._wait_s = self._run.setting(self._node, "delay_msec") / 1000.0
        self._start = self._run.ctx.clock.now()

    def _advance(self) -> Generator[Behaviour, None, Status]:
        """Tick the child once the wait is over."""
        if self._run.ctx.clock.now() - self._start + TIME_TOLERANCE_S < self._wait_s:
            return Status.RUNNING
        return (yield from self._tick_child())


class Constant(Behaviour):
    """AlwaysSuccess and AlwaysFailure."""

    def __init__(self, name: str, outcome: Status) -> None:
        super().__init__(name)
        self._outcome = outcome

    def update(self) -> Status:
        """The same answer every time."""
        return self._outcome


class SetBlackboard(Behaviour):
    """Writes `value` (text, or the entry it names) into the entry `output_key`."""

    def __init__(self, node: Node, run: Run) -> None:
        super().__init__(node.name)
        self._node, self._run = node, run

    def update(self) -> Status:
        """Copy the value."""
        self._run.board.write(self._node.outputs["output_key"], self._run.setting(self._node, "value"))
        return Status.SUCCESS
