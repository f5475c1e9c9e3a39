"""Beats of a clock that goes on by itself."""

from __future__ import annotations

import pytest

from grape.clock import Beats, MonotonicClock


class Wall:
    """A clock that goes on while somebody sleeps or works."""

    def __init__(self) -> None:
        self.time = 5.0

    def now(self) -> float:
        return self.time

    def work(self, seconds: float) -> None:
        self.time += seconds


def test_beats_come_in_their_period_whatever_a_beat_takes() -> None:
    wall = Wall()
    beats, due = Beats(wall, 0.01, sleep=wall.work), []
    for took in (0.0, 0.004, 0.009):
        wall.work(took)
        beats.wait()
        due.append(wall.time)
    assert due == pytest.approx([5.01, 5.02, 5.03])


def test_a_late_beat_is_not_made_up_for() -> None:
    wall = Wall()
    beats = Beats(wall, 0.01, sleep=wall.work)
    wall.work(0.5)
    beats.wait()
    assert wall.time == pytest.approx(5.5)
    beats.wait()
    assert wall.time == pytest.approx(5.51)


def test_a_clock_goes_on_from_where_it_is_told() -> None:
    assert 100.0 <= MonotonicClock(100.0).now() < 110.0
