"""Declaring actions and conditions, leases of actuators, inline jobs."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import pytest

from grape.actions.core import Actuator, Context, Feedback, InlineJobs, NoResult, action, condition
from grape.errors import InvalidInput, LeaseRevoked


class Motor:
    def __init__(self) -> None:
        self.calls: list[Any] = []

    def send(self, value: float) -> float:
        self.calls.append(value)
        return value

    def stop(self) -> None:
        self.calls.append("stop")


@dataclass(frozen=True, kw_only=True)
class TurnGoal:
    angle: float


def test_an_action_knows_its_types_and_its_summary() -> None:
    @action("Turn")
    def turn(goal: TurnGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
        """Turns.

        More about it.
        """
        yield Feedback()
        return NoResult()

    assert (turn.name, turn.goal_type, turn.result_type, turn.summary) == ("Turn", TurnGoal, NoResult, "Turns.")
    assert next(turn(TurnGoal(angle=1.0), None)) == Feedback()  # type: ignore[arg-type]


def test_an_action_that_returns_none_has_no_result() -> None:
    @action("Turn")
    def turn(goal: TurnGoal, ctx: Context) -> Generator[Feedback, None, None]:
        yield Feedback()

    assert turn.result_type is NoResult


def test_an_action_must_be_a_generator() -> None:
    def turn(goal: TurnGoal, ctx: Context) -> None:
        pass

    with pytest.raises(InvalidInput, match=r"action Turn: .*must be a generator function"):
        action("Turn")(turn)  # type: ignore[arg-type]


def test_goal_and_result_must_be_dataclasses() -> None:
    def number(goal: int, ctx: Context) -> Generator[Feedback, None, NoResult]:
        yield Feedback()
        return NoResult()

    def text(goal: TurnGoal, ctx: Context) -> Generator[Feedback, None, str]:
        yield Feedback()
        return ""

    with pytest.raises(InvalidInput, match="its goal type must be a dataclass"):
        action("Turn")(number)
    with pytest.raises(InvalidInput, match="its result type must be a dataclass"):
        action("Turn")(text)


def test_actions_compose() -> None:
    @action("Turn")
    def turn(goal: TurnGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
        yield Feedback(status=f"{goal.angle}")
        return NoResult()

    @action("TurnTwice")
    def twice(goal: TurnGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
        yield from turn(goal, ctx)
        return (yield from turn(goal, ctx))

    assert len(list(twice(TurnGoal(angle=1.0), None))) == 2  # type: ignore[arg-type]


def test_a_condition_answers_with_a_bool() -> None:
    @condition("IsWide")
    def is_wide(goal: TurnGoal, ctx: Context) -> bool:
        """Whether the angle is wide."""
        return goal.angle > 1

    assert is_wide(TurnGoal(angle=2.0), None) and is_wide.summary == "Whether the angle is wide."  # type: ignore[arg-type]


def test_a_condition_must_be_a_plain_function_of_a_dataclass() -> None:
    def generator(goal: TurnGoal, ctx: Context) -> Generator[Feedback, None, bool]:
        yield Feedback()
        return True

    def text(goal: TurnGoal, ctx: Context) -> str:
        return "yes"

    def number(goal: int, ctx: Context) -> bool:
        return True

    for wrong in (generator, text):
        with pytest.raises(InvalidInput, match="must be a plain function returning bool"):
            condition("Is")(wrong)  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="its goal type must be a dataclass"):
        condition("Is")(number)


def test_leaving_a_lease_stops_the_actuator() -> None:
    motor = Motor()
    actuator: Actuator[Motor] = Actuator(motor)
    with actuator.lease("a") as leased:
        assert actuator.owner == "a" and leased.send(1.0) == 1.0
    assert actuator.owner is None and motor.calls == [1.0, "stop"]


def test_an_exception_stops_the_actuator_too() -> None:
    motor = Motor()
    actuator: Actuator[Motor] = Actuator(motor)
    with pytest.raises(KeyError), actuator.lease("a"):
        raise KeyError
    assert actuator.owner is None and motor.calls == ["stop"]


def test_a_lease_is_of_no_use_after_its_block() -> None:
    actuator: Actuator[Motor] = Actuator(Motor())
    with actuator.lease("a") as leased:
        pass
    with pytest.raises(LeaseRevoked, match="a lost its lease to the end of its block"):
        leased.send(1.0)


def test_a_new_lease_stops_the_actuator_and_revokes_the_older_one() -> None:
    motor = Motor()
    actuator: Actuator[Motor] = Actuator(motor)
    with actuator.lease("old") as old:
        old.send(1.0)
        with actuator.lease("new") as new:
            with pytest.raises(LeaseRevoked, match="old lost its lease to new"):
                old.send(2.0)
            new.send(3.0)
    assert motor.calls == [1.0, "stop", 3.0, "stop"]


def test_the_end_of_a_revoked_lease_leaves_the_newer_one_alone() -> None:
    motor = Motor()
    actuator: Actuator[Motor] = Actuator(motor)

    def hold(name: str) -> Generator[Motor, None, None]:
        with actuator.lease(name) as leased:
            yield leased

    old, new = hold("old"), hold("new")
    next(old)
    leased = next(new)
    motor.calls.clear()
    old.close()
    leased.send(1.0)
    assert motor.calls == [1.0] and actuator.owner == "new"


def test_inline_jobs_run_within_the_beat_and_hand_back_the_result() -> None:
    job = InlineJobs().run(max, 1, 3, 2)
    assert next(job) == Feedback(status="computing max")
    with pytest.raises(StopIteration) as end:
        next(job)
    assert end.value.value == 3


def test_an_inline_job_that_raises_raises_in_the_action() -> None:
    job = InlineJobs().run(int, "x")
    next(job)
    with pytest.raises(ValueError, match="invalid literal"):
        next(job)
