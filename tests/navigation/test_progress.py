from __future__ import annotations

import numpy as np

from grape.navigation.progress import ProgressChecker, ProgressOptions

AT = np.array([3.0, -1.0, 3.1])
OPTIONS = ProgressOptions(step=0.02, stuck_s=5.0, blocked_s=3.0, still_s=8.0)


def checker() -> ProgressChecker:
    return ProgressChecker(begun_s=10.0, options=OPTIONS)


def drive(
    progress: ProgressChecker,
    until: float,
    left,
    *,
    begin: float = 10.0,
    blocked=False,
    excused=False,
    pose=lambda t: AT,
) -> None:
    """Updates ten times a second; `left` and `pose` are functions of time."""
    for k in range(1, round(10 * (until - begin)) + 1):
        now = begin + 0.1 * k
        progress.update(now, left(now), pose(now), blocked=blocked, excused=excused)


def test_coming_nearer_is_progress_however_slowly():
    progress = checker()
    drive(progress, 40.0, lambda t: 5.0 - 0.01 * t)
    assert not progress.stuck(40.0) and not progress.given_up(40.0)


def test_wheels_that_spin_are_noticed_after_a_while():
    progress = checker()
    drive(progress, 14.0, lambda t: 5.0)
    assert not progress.stuck(14.0)
    drive(progress, 16.0, lambda t: 5.0 + 0.01 * (t % 1), begin=14.0)
    assert progress.stuck(16.0)


def test_manoeuvre_and_new_path_begin_the_patience_anew():
    progress = checker()
    drive(progress, 20.0, lambda t: 5.0, excused=True)
    assert not progress.stuck(20.0)
    drive(progress, 24.0, lambda t: 5.0, begin=20.0)
    progress.restart(24.0)
    drive(progress, 26.0, lambda t: 9.0, begin=24.0)
    assert not progress.stuck(26.0)


def test_who_is_blocked_waits_and_then_gives_up():
    progress = checker()
    drive(progress, 12.9, lambda t: 5.0, blocked=True)
    assert 2.8 < progress.blocked_for(12.9) < 3.0 and not progress.given_up(12.9) and not progress.stuck(12.9)
    drive(progress, 13.2, lambda t: 5.0, begin=12.9, blocked=True)
    assert progress.given_up(13.2)
    progress.update(13.3, 4.9, AT, blocked=False, excused=False)
    assert progress.blocked_for(13.3) == 0.0


def test_time_in_which_the_base_had_to_stand_does_not_count():
    progress = checker()
    drive(progress, 12.0, lambda t: 5.0)
    progress.pause(40.0)
    drive(progress, 42.0, lambda t: 5.0, begin=40.0)
    assert not progress.stuck(42.0)
    drive(progress, 44.0, lambda t: 5.0, begin=42.0)
    assert progress.stuck(44.0), "four seconds before the pause and four behind it"
    drive(progress, 46.0, lambda t: 5.0, begin=44.0, blocked=True)
    progress.pause(60.0)
    assert progress.blocked_for(60.0) < 2.1


def test_who_does_not_move_at_all_is_noticed_whatever_the_base_is_about():
    progress = checker()
    for k in range(1, 80):
        now = 10.0 + 0.1 * k
        progress.update(now, 5.0, AT + 0.01 * np.sin(now), blocked=k % 2 == 0, excused=k % 2 == 1)
    assert not progress.stuck(now) and not progress.given_up(now) and not progress.still(now)
    progress.update(18.2, 5.0, AT, blocked=False, excused=True)
    assert progress.still(18.2)


def test_turning_and_crawling_are_motions_and_ordered_rest_is_none_of_the_base():
    for step in (np.array([0.02, 0.0, 0.0]), np.array([0.0, 0.0, 0.02])):
        progress = checker()
        drive(progress, 30.0, lambda t: 5.0, excused=True, pose=lambda t, step=step: AT + step * (t - 10.0))
        assert not progress.still(30.0)
    progress.pause(60.0)
    assert not progress.still(60.0)
