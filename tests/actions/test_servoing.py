"""Every servo run leaves one `servo` event that tells how it ended."""

from __future__ import annotations

from collections.abc import Generator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.core import Feedback
from grape.actions.look_around import FRAME_AGE_MAX_S
from grape.actions.servo_tries import with_retries
from grape.actions.servoing import servo_on_point
from grape.errors import ActionFailed, LeaseRevoked, Reason, StaleData


class StubServo:
    """Stands still, takes `frames` frames, and then converges or raises `error`."""

    def __init__(self, frames: int, error: Exception | None = None, wish: Any = (0, 0, 0, 0, 0, 0)) -> None:
        self._frames, self._error, self.wish = frames, error, np.array(wish, float)
        self.state = SimpleNamespace(frames=0, converged=False, seen=True, error_m=0.0, standoff_m=0.0, stage="final")

    def predict(self, T_base_camera: Any) -> Any:
        return np.array([300.0, 236.0]), 0.5

    def update(self, stamp: float, pixel: Any, depth: Any, T_base_camera: Any) -> Any:
        self.state.frames += 1
        if self.state.frames == self._frames:
            if self._error is not None:
                raise self._error
            self.state.converged = True
        return self.state

    def twist(self, now: float, T_base_camera: Any) -> Any:
        return self.wish


def servoing(bench: Bench, servo: Any, clearance: Any = None) -> Generator[Feedback, None, Any]:
    def target(standoff_m: float) -> Any:
        return np.array([0.0, 0.0, 0.5])

    with bench.ctx.arm.lease("test") as arm:
        return (
            yield from servo_on_point(
                bench.ctx, arm, servo, lambda image, pixel, depth: (pixel, depth), target,
                name="Servo", status="servoing", timeout_s=3.0, clearance=clearance,
            )
        )  # fmt: skip


def ends(bench: Bench) -> list[dict[str, Any]]:
    return [fields for kind, fields in bench.log.events if kind == "servo"]


def test_a_run_that_converges_says_so(bench: Bench) -> None:
    outcome = bench.run(servoing(bench, StubServo(3)))
    (end,) = ends(bench)
    assert (end["action"], end["converged"], end["reason"], end["iterations"]) == ("Servo", True, "", 3)
    assert (end["error_px"], end["duration_s"]) == (outcome.error_px, outcome.duration_s)
    assert end["error_px"] == pytest.approx(np.hypot(19.5, 3.5), abs=0.1)


@pytest.mark.parametrize(
    ("error", "reason", "shown"),
    [
        (ActionFailed(Reason.FEATURE_LOST, "gone"), "feature_lost", True),
        (StaleData("no joints"), "stale_data", True),
        (LeaseRevoked("taken"), "preempted", False),
        (ZeroDivisionError(), "internal_error", True),
    ],
)
def test_a_run_that_breaks_off_tells_why(bench: Bench, error: Exception, reason: str, shown: bool) -> None:
    with pytest.raises(type(error)):
        bench.run(servoing(bench, StubServo(2, error)))
    (end,) = ends(bench)
    assert (end["converged"], end["reason"], end["iterations"]) == (False, reason, 2)
    assert bench.log.pictures == ([f"Servo_{reason}"] if shown else []), "of what it saw last"


def test_a_run_out_of_time_has_not_converged(bench: Bench) -> None:
    assert bench.failure(servoing(bench, StubServo(1000))).reason is Reason.NOT_CONVERGED
    (end,) = ends(bench)
    assert (end["converged"], end["reason"]) == (False, "not_converged") and end["duration_s"] > 3.0


def test_a_preempted_run_says_so(bench: Bench) -> None:
    run = servoing(bench, StubServo(1000))
    next(run)
    run.close()
    (end,) = ends(bench)
    assert (end["converged"], end["reason"]) == (False, "preempted")


def test_a_run_halts_before_an_obstacle_and_is_given_up(bench: Bench) -> None:
    start = bench.arm.q.copy()
    servo = StubServo(1000, wish=(0.05, 0, 0, 0, 0, 0))
    failure = bench.failure(servoing(bench, servo, clearance=lambda q: -0.001))
    assert failure.reason is Reason.IN_COLLISION
    assert bench.arm.q == pytest.approx(start), "nothing moved"
    assert ends(bench)[0]["duration_s"] == pytest.approx(1.0, abs=0.1)


def test_an_obstacle_that_is_left_hinders_nothing(bench: Bench) -> None:
    start = bench.hand[0, 3]
    servo = StubServo(8, wish=(0.05, 0, 0, 0, 0, 0))
    bench.run(servoing(bench, servo, clearance=lambda q: bench.robot.hand_pose(q)[0, 3] - start - 0.001))
    assert bench.hand[0, 3] > start + 0.01


def test_frames_that_are_too_old_are_not_servoed_on(bench: Bench) -> None:
    servo, late = StubServo(3), bench.camera.latest
    bench.camera.latest = lambda max_age_s=None: late(None if max_age_s is None else max_age_s - FRAME_AGE_MAX_S)
    run = servoing(bench, servo)
    for _ in range(50):
        next(run)
        bench.advance()
    assert servo.state.frames == 0, "every frame is older than is allowed"
    run.close()


def failing(*reasons: Reason) -> Any:
    """Attempts that fail for these reasons in turn, then succeed, and a list of what was done."""
    done: list[str] = []

    def attempt() -> Generator[Feedback, None, str]:
        done.append("try")
        yield Feedback()
        if len(done) // 2 < len(reasons):
            raise ActionFailed(reasons[len(done) // 2], "")
        return "servoed"

    def back() -> Generator[Feedback, None, None]:
        done.append("back")
        yield Feedback()

    return attempt, back, done


def test_there_is_no_run_when_looking_around_finds_nothing(bench: Bench) -> None:
    attempt, back, done = failing()

    def look() -> Generator[Feedback, None, None]:
        yield Feedback()
        raise ActionFailed(Reason.FEATURE_LOST, "nowhere")

    assert bench.failure(with_retries(bench.ctx, 2, attempt, back, look)).detail == "nowhere"
    assert not done


def test_a_lost_feature_is_looked_for_again_from_the_staging_pose(bench: Bench) -> None:
    attempt, back, done = failing(Reason.FEATURE_LOST)
    assert bench.run(with_retries(bench.ctx, 2, attempt, back)) == "servoed"
    assert done == ["try", "back", "try"]


@pytest.mark.parametrize(
    ("tries", "reasons", "expected"),
    [
        (2, (Reason.FEATURE_LOST, Reason.NOT_CONVERGED), ["try", "back"] * 2),
        (3, (Reason.STALE_DATA,), ["try", "back"]),
    ],
)
def test_after_the_last_try_or_a_failure_that_no_look_cures_the_reason_is_told(
    bench: Bench, tries: int, reasons: tuple[Reason, ...], expected: list[str]
) -> None:
    attempt, back, done = failing(*reasons)
    assert bench.failure(with_retries(bench.ctx, tries, attempt, back)).reason is reasons[-1]
    assert done == expected
