import numpy as np
import pytest

from grape.control import TrackingOptions, TrajectoryTracker
from grape.errors import ActionFailed, InvalidInput, Reason
from grape.trajectory import Trajectory

from .conftest import VELOCITY


def trajectory():
    """One second from 0 to 0.3 rad in every joint, at rest at both ends."""
    t = np.linspace(0.0, 1.0, 101)
    s, ds = 3 * t**2 - 2 * t**3, 6 * t - 6 * t**2
    return Trajectory(times=t, positions=0.3 * s[:, None] * np.ones(6), velocities=0.3 * ds[:, None] * np.ones(6))


def follow(tracker, lag=0.03, seconds=4.0, brake=1.0):
    q, velocity, errors = np.zeros(6), np.zeros(6), []
    for k in range(int(seconds / 0.01)):
        command = tracker.step(0.01 * k, q)
        errors.append(command.error_rad)
        if command.done:
            return q, errors, command
        velocity = velocity + (brake * command.velocity - velocity) * 0.01 / (lag + 0.01)
        q = q + velocity * 0.01
    return q, errors, command


def test_a_lagging_arm_ends_on_the_goal():
    q, errors, command = follow(TrajectoryTracker(trajectory=trajectory(), velocity_max=VELOCITY))
    assert command.done
    assert command.progress == 1.0
    assert not command.velocity.any()
    assert np.allclose(q, 0.3, atol=0.01)
    assert max(errors) < 0.03


def test_looking_ahead_by_the_lag_makes_the_error_smaller():
    plain = follow(TrajectoryTracker(trajectory=trajectory(), velocity_max=VELOCITY), lag=0.07)[1]
    options = TrackingOptions(lag_s=0.07)
    ahead = follow(TrajectoryTracker(trajectory=trajectory(), velocity_max=VELOCITY, options=options), lag=0.07)[1]
    assert max(ahead) < 0.6 * max(plain)


def test_rest_after_the_end_brings_the_arm_nearer_to_the_goal():
    def left(rest_s):
        options = TrackingOptions(rest_s=rest_s)
        q = follow(TrajectoryTracker(trajectory=trajectory(), velocity_max=VELOCITY, options=options), lag=0.07)[0]
        return np.abs(q - 0.3).max()

    assert left(0.5) < 0.5 * left(0.0)


def test_speed_limits_hold():
    tracker = TrajectoryTracker(trajectory=trajectory(), velocity_max=0.1 * VELOCITY)
    assert (np.abs(tracker.step(0.5, np.full(6, 0.1)).velocity) <= 0.1 * VELOCITY).all()


def test_a_blocked_arm_ends_the_motion():
    with pytest.raises(ActionFailed) as failure:
        follow(TrajectoryTracker(trajectory=trajectory(), velocity_max=VELOCITY), brake=0.0)
    assert failure.value.reason is Reason.TRACKING_ERROR
    assert "joint" in failure.value.detail


def test_an_arm_that_does_not_settle_ends_the_motion():
    tracker = TrajectoryTracker(trajectory=trajectory(), velocity_max=VELOCITY)
    assert not tracker.step(2.0, np.full(6, 0.25)).done
    with pytest.raises(ActionFailed) as failure:
        tracker.step(2.6, np.full(6, 0.25))
    assert failure.value.reason is Reason.TRACKING_ERROR


def test_joint_angles_that_are_no_numbers_end_the_motion():
    q = np.zeros(6)
    q[2] = np.nan
    with pytest.raises(ActionFailed) as failure:
        TrajectoryTracker(trajectory=trajectory(), velocity_max=VELOCITY).step(0.1, q)
    assert failure.value.reason is Reason.TRACKING_ERROR


def test_limits_of_another_shape_are_refused():
    with pytest.raises(InvalidInput):
        TrajectoryTracker(trajectory=trajectory(), velocity_max=np.ones(3))
