"""A leaf from its ports to its end: results, failures, preemption, leases, crashes."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.actions.core import Action, Context, Feedback, NoGoal, NoResult, action, condition
from grape.bt import LeafCrashed
from grape.errors import ActionFailed, DriverError, GoalRejected, InvalidInput, Reason, StaleData


@dataclass(frozen=True, kw_only=True)
class DriveGoal:
    distance: float
    via: tuple[float, ...] = ()
    note: str = "none"

    def __post_init__(self) -> None:
        if self.distance < 0:
            raise InvalidInput(f"distance must not be negative, got {self.distance}")


@dataclass(frozen=True, kw_only=True)
class DriveResult:
    driven: float
    pose: Any


def drive_with(behaviour: Any) -> Action[DriveGoal, DriveResult]:
    """An action `Drive` with that behaviour."""

    @action("Drive")
    def drive(goal: DriveGoal, ctx: Context) -> Generator[Feedback, None, DriveResult]:
        """Drives."""
        return (yield from behaviour(goal, ctx))

    return drive


@action("Drive")
def drive(goal: DriveGoal, ctx: Context) -> Generator[Feedback, None, DriveResult]:
    """Drives for one beat a metre."""
    with ctx.base.lease("Drive") as base:
        for k in range(int(goal.distance)):
            base.send(1.0, 0.0)
            yield Feedback(status=f"{k} m", progress=k / goal.distance)
    return DriveResult(driven=goal.distance, pose=np.eye(4))


@action("Spin")
def spin(goal: NoGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Spins for ever."""
    with ctx.base.lease("Spin") as base:
        while True:
            base.send(0.0, 1.0)
            yield Feedback(status="spinning")


@dataclass(frozen=True, kw_only=True)
class SeenGoal:
    value: float = -1.0
    text: str = ""


def watch(seen: list[SeenGoal]) -> Any:
    @condition("Seen")
    def look(goal: SeenGoal, ctx: Context) -> bool:
        seen.append(goal)
        return True

    return look


def test_results_reach_later_leaves_through_their_ports(bench: SimpleNamespace) -> None:
    seen: list[SeenGoal] = []
    body = '<Sequence><Drive distance="2" driven="{d}"/><Seen value="{d}" text="{d_text}"/></Sequence>'
    xml = bench.root(body.replace(' text="{d_text}"', ""))
    running = bench.executor(xml, [drive, watch(seen)])
    # beats 1, 2: one metre each; beat 3: drive returns, the condition reads its result
    assert [running.tick() for _ in range(3)] == ["active", "active", "succeeded"]
    assert running.trace == ["Drive:running", "Drive:running", "Drive:success Seen:success"]
    assert seen == [SeenGoal(value=2.0)] and running.blackboard.entries() == {"d": 2.0}


def test_a_tree_that_has_ended_stays_ended(bench: SimpleNamespace) -> None:
    running = bench.executor(bench.root('<Drive distance="0"/>'), [drive])
    assert [running.tick(), running.tick()] == ["succeeded", "succeeded"]
    assert len(running.trace) == 1


def test_start_and_end_are_logged_with_the_goal(bench: SimpleNamespace) -> None:
    ctx = bench.context()
    running = bench.executor(bench.root('<Drive distance="1" via="1;2"/>'), [drive], ctx)
    running.tick()
    ctx.clock.time = 0.5
    running.tick()
    start, end = ctx.log.of("action")
    assert (start["name"], start["path"], start["status"], start["end"]) == ("Drive", "Main/Drive", "active", None)
    assert (end["status"], end["reason"], end["start"], end["end"]) == ("succeeded", "", 0.0, 0.5)
    assert end["goal"] == {"distance": 1.0, "via": [1.0, 2.0], "note": "none"}


def test_feedback_and_path_of_the_running_leaf_can_be_read(bench: SimpleNamespace) -> None:
    running = bench.executor(bench.root('<Sequence name="go"><Drive distance="4"/></Sequence>'), [drive])
    assert running.running_leaf == "" and running.feedback == Feedback()
    running.tick()
    running.tick()
    assert running.running_leaf == "Main/go/Drive"
    assert running.feedback == Feedback(status="1 m", progress=0.25)
    assert running.running[0].status_text == "1 m"


FAILURES = {
    "failed": (ActionFailed(Reason.BLOCKED, "a vine"), "aborted", Reason.BLOCKED, "a vine"),
    "failed for a reason of its own": (ActionFailed("too_dark", "3 of 255"), "aborted", "too_dark", "3 of 255"),
    "rejected": (GoalRejected("too far"), "rejected", Reason.REJECTED_GOAL, "too far"),
    "stale": (StaleData("no scan for 1 s"), "aborted", Reason.STALE_DATA, "no scan for 1 s"),
}


@pytest.mark.parametrize("kind", FAILURES)
def test_a_failure_keeps_its_reason_and_writes_it_where_the_tree_maps_it(bench: SimpleNamespace, kind: str) -> None:
    error, status, reason, detail = FAILURES[kind]

    def fail(goal: DriveGoal, ctx: Context) -> Generator[Feedback, None, DriveResult]:
        yield Feedback()
        raise error

    ctx = bench.context()
    body = '<Fallback><Drive distance="1" reason="{why}" detail="{more}"/><Drive distance="1" note="{why}"/></Fallback>'
    running = bench.executor(bench.root(body), [drive_with(fail)], ctx)
    assert [running.tick() for _ in range(3)] == ["active", "active", "aborted"]
    assert running.blackboard.entries() == {"why": reason, "more": detail}
    event = ctx.log.of("action")[1]
    assert (event["status"], event["reason"], event["detail"]) == (status, str(reason), detail)
    assert (running.last_failure.path, running.last_failure.reason) == ("Main/Fallback/Drive#2", reason)
    assert ctx.log.of("action")[-1]["goal"]["note"] == str(reason)


def test_a_goal_that_refuses_a_value_from_the_blackboard_is_rejected(bench: SimpleNamespace) -> None:
    running = bench.executor(bench.root('<Drive distance="{d}"/>'), [drive], d=-1.0)
    assert running.tick() == "aborted"
    assert running.last_failure.status == "rejected" and "got -1.0" in running.last_failure.detail


def test_a_required_entry_that_is_not_yet_written_rejects_the_goal(bench: SimpleNamespace) -> None:
    body = '<Fallback><Drive distance="{d}"/><Drive distance="0" driven="{d}"/></Fallback>'
    running = bench.executor(bench.root(body), [drive])
    assert running.tick() == "succeeded"
    assert running.trace == ["Drive:failure Drive:success"]
    assert "nothing has written the blackboard entry 'd' yet" in running.last_failure.detail


def test_a_leaf_that_was_rejected_runs_once_its_entry_is_there(bench: SimpleNamespace) -> None:
    body = (
        '<RetryUntilSuccessful num_attempts="2"><Fallback><Drive name="first" distance="{d}"/><ForceFailure>'
        '<Drive name="second" distance="0" driven="{d}"/></ForceFailure></Fallback></RetryUntilSuccessful>'
    )
    running = bench.executor(bench.root(body), [drive])
    # tick 1: {d} is missing, then written; tick 2: it is there
    assert [running.tick(), running.tick()] == ["active", "succeeded"]
    assert running.trace == ["first:failure second:success", "first:success"]


def test_an_optional_entry_that_is_not_yet_written_gives_the_default(bench: SimpleNamespace) -> None:
    seen: list[SeenGoal] = []
    body = '<Sequence><Seen value="{d}"/><Drive distance="0" driven="{d}"/></Sequence>'
    assert bench.executor(bench.root(body), [drive, watch(seen)]).tick() == "succeeded"
    assert seen == [SeenGoal(value=-1.0)]


def test_the_missions_default_stands_in_for_a_field_that_the_tree_leaves_out(bench: SimpleNamespace) -> None:
    seen: list[SeenGoal] = []
    ctx = bench.context()
    ctx.config = {"Seen": {"value": 5.0}, "Drive": {"via": (1.0,)}}
    body = (
        '<Sequence><Seen/><Seen value="3"/><Seen value="{d}"/><Drive distance="0" driven="{d}"/>'
        '<Seen value="{d}"/></Sequence>'
    )
    assert bench.executor(bench.root(body), [drive, watch(seen)], ctx).tick() == "succeeded"
    # left out; given by the tree; mapped, but not written yet; mapped and written
    assert [goal.value for goal in seen] == [5.0, 3.0, 5.0, 0.0]
    assert ctx.log.of("action")[0]["goal"] == {"distance": 0.0, "via": [1.0], "note": "none"}


PREEMPTIONS = {
    # the tree, ticks until the spin is preempted, and the last line of the trace
    "halt": ("<Spin/>", None, "Spin:halted"),
    "timeout": ('<Timeout msec="20"><Spin/></Timeout>', 3, "Spin:halted"),
    "a higher branch succeeds": ("<ReactiveFallback><Late/><Spin/></ReactiveFallback>", 3, "Late:success Spin:halted"),
    "a higher branch runs": (
        "<ReactiveFallback><Inverter><Soon/></Inverter><Spin/></ReactiveFallback>",
        2,
        "Soon:running Spin:halted",
    ),
    "a guard fails": ("<ReactiveSequence><Early/><Spin/></ReactiveSequence>", 3, "Early:failure Spin:halted"),
    "a parallel fails": ("<Parallel><Spin/><Late2/></Parallel>", 3, "Spin:running Late2:failure Spin:halted"),
    "a parallel has enough": (
        '<Parallel success_count="1"><Spin/><Late3/></Parallel>',
        3,
        "Spin:running Late3:success Spin:halted",
    ),
}
SCRIPTS = {
    "Late": "F F S",
    "Soon": "S RRRS",
    "Early": "S S F",
    "Late2": "RRF",
    "Late3": "RRS",
}


@pytest.mark.parametrize("way", PREEMPTIONS)
def test_preemption_closes_the_action_and_stops_its_actuator(bench: SimpleNamespace, way: str) -> None:
    body, ticks, last = PREEMPTIONS[way]
    ctx = bench.context()
    leaves = [spin, *(bench.scripted(name, script) for name, script in SCRIPTS.items())]
    running = bench.executor(bench.root(body), leaves, ctx)
    for _ in range(ticks or 2):
        running.tick()
        ctx.clock.time += 0.01
    if ticks is None:
        running.halt()
        assert running.status == "preempted" and running.tick() == "preempted"
    assert running.trace[-1] == last
    assert ctx.drivers.base.calls[-1] == "stop" and ctx.base.owner is None
    ends = [event for event in ctx.log.of("action") if event["name"] == "Spin" and event["end"] is not None]
    assert [event["status"] for event in ends] == ["preempted"]


def test_a_preempted_action_starts_afresh(bench: SimpleNamespace) -> None:
    ctx = bench.context()
    attempt = '<Timeout msec="20"><Drive distance="5"/></Timeout>'
    body = f'<RetryUntilSuccessful num_attempts="2">{attempt}</RetryUntilSuccessful>'
    running = bench.executor(bench.root(body), [drive], ctx)
    for _ in range(5):
        running.tick()
        ctx.clock.time += 0.01
    # ticks 1, 2: 0 m, 1 m; tick 3, at 20 ms: halted and begun again
    assert running.trace == [
        "Drive:running",
        "Drive:running",
        "Drive:halted Drive:running",
        "Drive:running",
        "Drive:halted",
    ]
    assert running.status == "aborted"


def test_a_newer_lease_preempts_the_older_action(bench: SimpleNamespace) -> None:
    ctx = bench.context()
    running = bench.executor(
        bench.root('<Parallel failure_count="2"><Drive distance="9"/><Spin reason="{r}"/></Parallel>'),
        [drive, spin],
        ctx,
    )
    running.tick()
    # tick 1: Drive takes the base, then Spin takes it away; tick 2: Drive finds out, and the tree cannot succeed
    assert running.tick() == "aborted"
    assert running.trace[-1] == "Drive:failure Spin:halted"
    drive_end = next(e for e in ctx.log.of("action") if e["name"] == "Drive" and e["end"] is not None)
    assert drive_end["status"] == "preempted" and drive_end["detail"] == "Drive lost its lease to Spin"
    assert ctx.drivers.base.calls[-1] == "stop" and ctx.base.owner is None


def crashing(kind: str) -> Any:
    def crash(goal: DriveGoal, ctx: Context) -> Generator[Any, None, Any]:
        with ctx.base.lease("Drive"):
            yield Feedback(status="fine")
            if kind == "raise":
                raise ZeroDivisionError("oops")
            if kind == "driver":
                raise DriverError("the bus is gone")
            if kind == "feedback":
                yield "half way"
        return "no DriveResult"

    return drive_with(crash)


@pytest.mark.parametrize(
    ("kind", "got"),
    [("raise", "oops"), ("driver", "bus is gone"), ("feedback", "must yield Feedback"), ("result", "must be a Drive")],
)
def test_a_leaf_that_raises_stops_the_robot_and_names_itself(bench: SimpleNamespace, kind: str, got: str) -> None:
    ctx = bench.context()
    body = '<Parallel name="both"><Wait/><ForceSuccess><Drive distance="1"/></ForceSuccess></Parallel>'
    running = bench.executor(bench.root(body), [crashing(kind), bench.scripted("Wait", "RRRRRS")], ctx)
    running.tick()
    with pytest.raises(LeafCrashed, match=got) as caught:
        running.tick()
    assert caught.value.path == "Main/both/ForceSuccess/Drive" and str(caught.value).startswith(caught.value.path)
    for driver in (ctx.drivers.base, ctx.drivers.arm, ctx.drivers.gripper):
        assert driver.calls[-1] == "stop"
    assert ctx.base.owner is None
    (crash,) = ctx.log.of("crash")
    assert crash["path"] == caught.value.path and got in crash["traceback"]
    ends = {e["name"]: (e["status"], e["reason"]) for e in ctx.log.of("action") if e["end"] is not None}
    assert ends == {"Drive": ("aborted", "internal_error"), "Wait": ("preempted", "")}
    assert running.status == "aborted" and running.tick() == "aborted"


def test_a_leaf_that_raises_while_it_is_closed_is_a_crash_too(bench: SimpleNamespace) -> None:
    def stubborn(goal: DriveGoal, ctx: Context) -> Generator[Feedback, None, DriveResult]:
        try:
            while True:
                yield Feedback()
        finally:
            raise OSError("cannot let go")

    ctx = bench.context()
    running = bench.executor(
        bench.root('<Parallel><Drive distance="1"/><Spin/></Parallel>'), [drive_with(stubborn), spin], ctx
    )
    running.tick()
    with pytest.raises(LeafCrashed, match="Main/Parallel/Drive: OSError: cannot let go"):
        running.halt()
    assert running.status == "aborted" and ctx.base.owner is None and ctx.drivers.arm.calls == ["stop"] * 2


def test_a_robot_that_cannot_stop_does_not_hide_the_crash(bench: SimpleNamespace) -> None:
    ctx = bench.context()

    def refuse() -> None:
        raise DriverError("no connection")

    ctx.drivers.arm.stop = refuse
    running = bench.executor(bench.root('<Drive distance="1"/>'), [crashing("raise")], ctx)
    running.tick()
    with pytest.raises(LeafCrashed, match="oops"):
        running.tick()
    assert "no connection" in ctx.log.of("stop_failed")[0]["error"]


def test_an_interrupt_from_the_keyboard_stops_the_robot(bench: SimpleNamespace) -> None:
    def interrupted(goal: DriveGoal, ctx: Context) -> Generator[Feedback, None, DriveResult]:
        yield Feedback()
        raise KeyboardInterrupt

    ctx = bench.context()
    running = bench.executor(bench.root('<Drive distance="1"/>'), [drive_with(interrupted)], ctx)
    running.tick()
    with pytest.raises(KeyboardInterrupt):
        running.tick()
    assert ctx.drivers.arm.calls == ["stop"] and running.status == "aborted"


def test_a_condition_answers_at_every_tick_and_logs_what_changes(bench: SimpleNamespace) -> None:
    answers: list[Any] = [True, True, False]

    @condition("Clear")
    def clear(goal: NoGoal, ctx: Context) -> bool:
        return answers.pop(0)

    ctx = bench.context()
    running = bench.executor(bench.root("<ReactiveSequence><Clear/><Spin/></ReactiveSequence>"), [clear, spin], ctx)
    assert [running.tick() for _ in range(3)] == ["active", "active", "aborted"]
    assert [event["answer"] for event in ctx.log.of("condition")] == [True, False]


@pytest.mark.parametrize("error", [ActionFailed(Reason.NOT_LOCALIZED, "no fix"), StaleData("no fix")])
def test_a_condition_that_cannot_be_answered_is_false(bench: SimpleNamespace, error: Exception) -> None:
    @condition("Clear")
    def clear(goal: NoGoal, ctx: Context) -> bool:
        raise error

    ctx = bench.context()
    assert bench.executor(bench.root("<Clear/>"), [clear], ctx).tick() == "aborted"
    assert "no fix" in ctx.log.of("condition")[0]["detail"]


def test_a_condition_that_raises_is_a_crash(bench: SimpleNamespace) -> None:
    @condition("Clear")
    def clear(goal: NoGoal, ctx: Context) -> bool:
        raise KeyError("plant")

    with pytest.raises(LeafCrashed, match="Main/Inverter/Clear: KeyError"):
        bench.executor(bench.root("<Inverter><Clear/></Inverter>"), [clear]).tick()
