"""What every servo run shares: ages of frames and features, stages, the way in."""

import numpy as np
import pytest

from grape.control.servo_run import FeatureWatch, ServoStage, StageGate, descent
from grape.errors import ActionFailed, Reason


def watch():
    return FeatureWatch("it", fade_from_s=0.2, fade_to_s=0.3, lost_s=2.0)


def test_motion_fades_with_the_age_of_the_features():
    run = watch()
    run.frame(1.0)
    assert run.share(1.1) == 0.0, "nothing was seen yet"
    run.seen(1.0)
    assert [run.share(t) for t in (1.1, 1.2, 1.25, 1.3, 2.9)] == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0])


def test_a_run_without_frames_is_stale_and_one_without_features_is_lost():
    run = watch()
    run.beat(0.0)
    with pytest.raises(ActionFailed) as stale:
        run.share(2.1)
    assert stale.value.reason is Reason.STALE_DATA
    for stamp in np.arange(0.0, 2.1, 0.1):
        run.frame(stamp)
    with pytest.raises(ActionFailed) as lost:
        run.share(2.1)
    assert lost.value.reason is Reason.FEATURE_LOST
    assert run.share(2.1, blind=True) == 1.0


def test_a_frame_that_is_not_newer_does_not_count():
    run = watch()
    assert [run.frame(t) for t in (1.0, 1.0, 0.9, 1.1)] == [True, False, False, True]


def test_a_beat_is_the_time_since_the_last_one_but_never_long():
    run = watch()
    assert [run.beat(t) for t in (5.0, 5.01, 6.0, 5.5)] == pytest.approx([0.0, 0.01, 0.05, 0.0])


def test_a_stage_takes_its_frames_in_a_row():
    gate = StageGate(standoff_limit=2.0, standoff_frames=2, stop_limit=0.5, stop_frames=2)
    stage, seen = ServoStage.STAND_OFF, []
    for error, standoff in ((1, 0.05), (3, 0.05), (1, 0.05), (1, 0.05), (9, 0.02), (0.4, 0.0), (0.6, 0.0), (0.4, 0.0)):
        stage = gate.after(stage, error, standoff)
        seen.append(stage.value)
    assert seen == ["stand_off"] * 3 + ["descend"] * 2 + ["final"] * 3
    gate.miss()
    assert gate.after(stage, 0.4, 0.0) is ServoStage.FINAL, "a frame without features breaks the row"
    assert gate.after(stage, 0.4, 0.0) is ServoStage.CONVERGED


def test_the_way_in_slows_down_before_its_end():
    assert [descent(s, 0.05, 0.04) for s in (0.1, 0.04, 0.02, 0.001, 0.0)] == pytest.approx(
        [0.05, 0.05, 0.025, 0.02, 0]
    )
