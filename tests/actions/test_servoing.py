"""Every servo run leaves one `servo` event that tells how it ended."""

from __future__ import annotations

from collections.abc import Generator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.core import Feedback
from grape.actions.servoing import servo_on_point
from grape.errors import ActionFailed, LeaseRevoked, Reason, StaleData


class StubServo:
    """Stands still, takes `frames` frames, and then converges or raises `error`."""

    def __init__(self, frames: int, error: Exception | None = None) -> None:
        self._frames, self._error = frames, error
        self.state = SimpleNamespace(frames=0, converged=False, error_m=0.0, standoff_m=0.0, stage="final")

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
        return np.zeros(6)


def servoing(bench: Bench, servo: Any) -> Generator[Feedback, None, Any]:
    def target(standoff_m: float) -> Any:
        return np.array([0.0, 0.0, 0.5])

    with bench.ctx.arm.lease("test") as arm:
        return (
            yield from servo_on_point(
                bench.ctx, arm, servo, lambda image, pixel, depth: (pixel, depth), target,
                name="Servo", status="servoing", timeout_s=1.0,
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
    ("error", "reason"),
    [
        (ActionFailed(Reason.FEATURE_LOST, "gone"), "feature_lost"),
        (StaleData("no joints"), "stale_data"),
        (LeaseRevoked("taken"), "preempted"),
        (ZeroDivisionError(), "internal_error"),
    ],
)
def test_a_run_that_breaks_off_tells_why(bench: Bench, error: Exception, reason: str) -> None:
    with pytest.raises(type(error)):
        bench.run(servoing(bench, StubServo(2, error)))
    (end,) = ends(bench)
    assert (end["converged"], end["reason"], end["iterations"]) == (False, reason, 2)


def test_a_run_out_of_time_has_not_converged(bench: Bench) -> None:
    assert bench.failure(servoing(bench, StubServo(1000))).reason is Reason.NOT_CONVERGED
    (end,) = ends(bench)
    assert (end["converged"], end["reason"]) == (False, "not_converged") and end["duration_s"] > 1.0


def test_a_preempted_run_says_so(bench: Bench) -> None:
    run = servoing(bench, StubServo(1000))
    next(run)
    run.close()
    (end,) = ends(bench)
    assert (end["converged"], end["reason"]) == (False, "preempted")
