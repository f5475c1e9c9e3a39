"""What an action is: a typed generator that gets a goal and a context, yields feedback and returns a result.

    @action("DriveToPose")
    def drive_to_pose(goal: DriveGoal, ctx: Context) -> Generator[Feedback, None, DriveResult]:
        with ctx.base.lease("DriveToPose") as base:
            while not arrived:
                base.send(v, w)
                yield Feedback(status="driving", progress=0.4)
        return DriveResult(...)

One `yield` is one beat (100 Hz). Raising `ActionFailed` ends it ABORTED, `GoalRejected` REJECTED; the tree closes the
generator to preempt it. Leaving a lease stops its actuator, whatever the way out. Fields of goal and result are the
input and output ports of the node in a tree file. Actions compose with `result = yield from other(goal, ctx)`.

A question that is answered at once is a condition: a plain function that returns a bool.

    @condition("IsLocalized")
    def is_localized(goal: NoGoal, ctx: Context) -> bool:
        return ctx.world.localized
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, is_dataclass
from enum import StrEnum
from typing import Any, Generic, Protocol, TypeVar, cast

import numpy as np

from grape.actions.account import Ledger as Ledger
from grape.actions.account import Outcome as Outcome
from grape.actions.account import PlantTask as PlantTask
from grape.actions.account import Step as Step
from grape.clock import Clock
from grape.drivers import ArmDriver, BaseDriver, CameraDriver, Drivers, GripperDriver
from grape.errors import InvalidInput, LeaseRevoked
from grape.messages import Array
from grape.world import World

D = TypeVar("D")
G = TypeVar("G")
R = TypeVar("R")


class Status(StrEnum):
    """How an action stands; the names of the reference's action protocol."""

    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"
    PREEMPTED = "preempted"
    REJECTED = "rejected"


@dataclass(frozen=True, kw_only=True)
class Feedback:
    """What a running action tells: a short phrase for a person, and progress 0..1 where it is known."""

    status: str = ""
    progress: float | None = None


@dataclass(frozen=True, kw_only=True)
class NoGoal:
    """Goal of an action or condition that needs no inputs."""


@dataclass(frozen=True, kw_only=True)
class NoResult:
    """Result of an action that returns nothing."""


class Stoppable(Protocol):
    """Any actuator driver."""

    def stop(self) -> None: ...


class _Leased:
    """A driver as seen through one lease: forwards while the lease holds, refuses after."""

    def __init__(self, driver: object, owner: str) -> None:
        self._driver = driver
        self._owner = owner
        self._revoked_by: str | None = None

    def __getattr__(self, name: str) -> Any:
        if self._revoked_by is not None:
            raise LeaseRevoked(f"{self._owner} lost its lease to {self._revoked_by}")
        return getattr(self._driver, name)


class Actuator(Generic[D]):
    """One actuator that at most one action holds at a time; a newer lease revokes the older one."""

    def __init__(self, driver: D) -> None:
        self._driver = driver
        self._lease: _Leased | None = None

    @property
    def owner(self) -> str | None:
        """Who holds the actuator now."""
        return self._lease._owner if self._lease is not None else None

    @contextmanager
    def lease(self, owner: str) -> Iterator[D]:
        """Take the actuator for the length of a `with` block; leaving it stops the actuator.

        Raises (from the driver's methods, later):
            LeaseRevoked: a newer lease has taken the actuator.
        """
        if self._lease is not None:
            self._lease._revoked_by = owner
            cast(Stoppable, self._driver).stop()
        lease = self._lease = _Leased(self._driver, owner)
        try:
            yield cast(D, lease)
        finally:
            if self._lease is lease:
                self._lease = None
                lease._revoked_by = "the end of its block"
                cast(Stoppable, self._driver).stop()


class Jobs(Protocol):
    """Heavy work beside the beat."""

    def run(self, function: Callable[..., R], *args: Any, **kwargs: Any) -> Generator[Feedback, None, R]:
        """`result = yield from ctx.jobs.run(plan, ...)`: yields while the work runs, returns its result."""
        ...


class InlineJobs:
    """Runs the work at once, within the beat, so that a seed repeats byte for byte."""

    def run(self, function: Callable[..., R], *args: Any, **kwargs: Any) -> Generator[Feedback, None, R]:
        yield Feedback(status=f"computing {function.__name__}")
        return function(*args, **kwargs)


class Recorder(Protocol):
    """Where actions tell what happened, for the run folder; never read back by the robot."""

    def event(self, kind: str, /, **fields: Any) -> None:
        """One line of events.jsonl: JSON-able fields, arrays allowed."""
        ...

    def picture(self, name: str, bgr: Array) -> None:
        """A camera picture for the report, (h, w, 3) uint8."""
        ...


@dataclass(kw_only=True)
class Context:
    """Everything an action may touch, handed in, never looked up.

    Attributes:
        robot: description and models of the robot (`grape.robots.Robot`).
        config: the mission's defaults of goal fields by node name, for nodes of the tree that leave the field out.
    """

    clock: Clock
    world: World
    drivers: Drivers
    robot: Any
    jobs: Jobs
    log: Recorder
    ledger: Ledger
    rng: np.random.Generator
    config: Mapping[str, Any] = field(default_factory=dict)
    base: Actuator[BaseDriver] = field(init=False)
    arm: Actuator[ArmDriver] = field(init=False)
    gripper: Actuator[GripperDriver] = field(init=False)

    def __post_init__(self) -> None:
        self.base = Actuator(self.drivers.base)
        self.arm = Actuator(self.drivers.arm)
        self.gripper = Actuator(self.drivers.gripper)

    @property
    def camera(self) -> CameraDriver:
        """The wrist camera; reading is free for all, so it needs no lease."""
        return self.drivers.camera


@dataclass(frozen=True)
class Action(Generic[G, R]):
    """An action as the tree, the command line and other actions see it; calling it makes the generator."""

    name: str
    function: Callable[[G, Context], Generator[Feedback, None, R]]
    goal_type: type[G]
    result_type: type[R]
    summary: str

    def __call__(self, goal: G, ctx: Context) -> Generator[Feedback, None, R]:
        return self.function(goal, ctx)


def action(name: str) -> Callable[[Callable[[G, Context], Generator[Feedback, None, R]]], Action[G, R]]:
    """Declare a generator function as an action node called `name` in tree files.

    Raises:
        InvalidInput: the function is no generator, or its goal or result type is no dataclass.
    """

    def declare(function: Callable[[G, Context], Generator[Feedback, None, R]]) -> Action[G, R]:
        if not inspect.isgeneratorfunction(function):
            raise InvalidInput(f"action {name}: {function.__qualname__} must be a generator function")
        hints = typing.get_type_hints(function)
        goal_type = hints[next(iter(inspect.signature(function).parameters))]
        result_type = typing.get_args(hints["return"])[2]
        result_type = NoResult if result_type in (None, type(None)) else result_type
        for role, kind in (("goal", goal_type), ("result", result_type)):
            if not is_dataclass(kind):
                raise InvalidInput(f"action {name}: its {role} type must be a dataclass, got {kind}")
        summary = (inspect.getdoc(function) or "").split("\n", 1)[0]
        return Action(name, function, goal_type, result_type, summary)

    return declare


@dataclass(frozen=True)
class Condition(Generic[G]):
    """A question as the tree sees it: answered within one beat, moves nothing."""

    name: str
    function: Callable[[G, Context], bool]
    goal_type: type[G]
    summary: str

    def __call__(self, goal: G, ctx: Context) -> bool:
        return self.function(goal, ctx)


def condition(name: str) -> Callable[[Callable[[G, Context], bool]], Condition[G]]:
    """Declare a function as a condition node called `name` in tree files.

    Raises:
        InvalidInput: the function is a generator, does not return a bool, or its goal type is no dataclass.
    """

    def declare(function: Callable[[G, Context], bool]) -> Condition[G]:
        hints = typing.get_type_hints(function)
        if inspect.isgeneratorfunction(function) or hints.get("return") is not bool:
            raise InvalidInput(f"condition {name}: {function.__qualname__} must be a plain function returning bool")
        goal_type = hints[next(iter(inspect.signature(function).parameters))]
        if not is_dataclass(goal_type):
            raise InvalidInput(f"condition {name}: its goal type must be a dataclass, got {goal_type}")
        summary = (inspect.getdoc(function) or "").split("\n", 1)[0]
        return Condition(name, function, cast("type[G]", goal_type), summary)

    return declare
