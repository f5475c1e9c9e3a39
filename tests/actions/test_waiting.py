"""Waiting for a pose, for camera frames, keeping one, and letting frames vote."""

from __future__ import annotations

import pytest
from paper_robot import Bench

from grape.actions.looking import next_image, vote
from grape.actions.take_picture import TakePictureGoal, take_picture
from grape.actions.wait_for_localization import WaitForLocalizationGoal, wait_for_localization
from grape.errors import Reason


def test_localization_that_is_good_needs_no_wait(bench: Bench) -> None:
    start = bench.now()
    bench.run(wait_for_localization(WaitForLocalizationGoal(), bench.ctx))
    assert bench.now() == start


def test_localization_is_waited_for(bench: Bench) -> None:
    bench.localized = False
    bench.advance()
    run = wait_for_localization(WaitForLocalizationGoal(timeout_s=5.0), bench.ctx)
    for _ in range(100):
        next(run)
        bench.advance()
    bench.localized = True
    bench.advance()
    with pytest.raises(StopIteration):
        next(run)


def test_localization_that_never_comes_times_out(bench: Bench) -> None:
    bench.localized = False
    bench.advance()
    start = bench.now()
    failure = bench.failure(wait_for_localization(WaitForLocalizationGoal(timeout_s=2.0), bench.ctx))
    assert failure.reason is Reason.NOT_LOCALIZED and "2.0 s" in failure.detail
    assert bench.now() - start == pytest.approx(2.0, abs=0.05)


def test_next_image_is_newer_than_asked(bench: Bench) -> None:
    asked = bench.now()
    image = bench.run(next_image(bench.ctx, asked, status="looking"))
    assert image.stamp > asked
    assert bench.now() - asked < 0.2


@pytest.mark.parametrize("fault", ["frozen", "silent"])
def test_camera_that_stops_is_stale(bench: Bench, fault: str) -> None:
    setattr(bench.camera, fault, True)
    start = bench.now()
    failure = bench.failure(next_image(bench.ctx, start, status="looking", timeout_s=1.0))
    assert failure.reason is Reason.STALE_DATA and failure.detail.startswith("looking")
    assert bench.now() - start == pytest.approx(1.0, abs=0.1)


def test_a_picture_is_a_new_one_and_kept_by_its_label(bench: Bench) -> None:
    asked = bench.now()
    bench.run(take_picture(TakePictureGoal(label="post"), bench.ctx))
    assert bench.log.pictures == ["post"] and bench.now() > asked


def test_a_picture_needs_a_camera_that_shows_something(bench: Bench) -> None:
    bench.camera.silent = True
    failure = bench.failure(take_picture(TakePictureGoal(timeout_s=1.0), bench.ctx))
    assert failure.reason is Reason.STALE_DATA and not bench.log.pictures


def answers(*values: bool):
    """Decides frames in this order; the number of frames that were asked for is kept."""
    asked: list[float] = []

    def decide(image):
        asked.append(image.stamp)
        return values[len(asked) - 1], "" if values[len(asked) - 1] else f"frame {len(asked)} is empty"

    return decide, asked


@pytest.mark.parametrize(
    ("values", "result", "asked"),
    [
        ((True, True, True), True, 3),
        ((False, False, False), False, 3),
        ((True, False, True, False, True), True, 5),
        ((False, True, False, True, False), False, 5),
    ],
)
def test_majority_ends_a_vote_as_soon_as_it_is_sure(bench: Bench, values, result: bool, asked: int) -> None:
    decide, stamps = answers(*values)
    ballot = bench.run(vote(bench.ctx, decide, frames=5, status="voting"))
    assert (ballot.value, ballot.yes + ballot.no, len(stamps)) == (result, asked, asked)
    assert stamps == sorted(set(stamps)), "each frame votes once"


def test_half_of_an_even_number_is_no_majority(bench: Bench) -> None:
    decide, _ = answers(True, False, True, False)
    assert bench.run(vote(bench.ctx, decide, frames=4, status="voting")).value is False


def test_vote_tells_the_reason_of_the_last_no(bench: Bench) -> None:
    decide, _ = answers(False, False, False)
    ballot = bench.run(vote(bench.ctx, decide, frames=5, status="voting"))
    assert ballot.reason == "frame 3 is empty" and ballot.image is not None


def test_vote_fails_when_the_camera_stops(bench: Bench) -> None:
    bench.camera.silent = True
    failure = bench.failure(vote(bench.ctx, lambda image: (True, ""), frames=3, status="voting"))
    assert failure.reason is Reason.STALE_DATA
