import numpy as np
import pytest

from grape.errors import ActionFailed, InvalidInput, Reason
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.trajectory import (
    TimingOptions,
    Trajectory,
    VelocityLimiter,
    densify,
    time_path,
)

VELOCITY, ACCELERATION = DESCRIPTION.arm.velocity_max, DESCRIPTION.arm.acceleration_max
CORNERS = np.cumsum(np.random.default_rng(0).uniform(-1, 1, (5, 6)), axis=0)


def sampled(trajectory, dt=0.005):
    points = [trajectory.sample(t) for t in np.arange(0.0, trajectory.duration, dt)]
    return tuple(np.array([getattr(p, name) for p in points]) for name in ("position", "velocity", "acceleration"))


@pytest.mark.parametrize("count", [2, 3, 5])
def test_limits_hold_and_the_ends_are_met_at_rest(count):
    trajectory = time_path(CORNERS[:count], VELOCITY, ACCELERATION)
    _, velocity, acceleration = sampled(trajectory)
    assert (np.abs(velocity) / VELOCITY).max() < 1.01
    assert (np.abs(acceleration) / ACCELERATION).max() < 1.05
    assert np.allclose(trajectory.start, CORNERS[0])
    assert np.allclose(trajectory.end, CORNERS[count - 1])
    for t in (0.0, trajectory.duration):
        assert not trajectory.sample(t).velocity.any()


def test_a_straight_motion_is_as_quick_as_the_limits_allow():
    goal = np.array([2.0, 0, 0, 0, 0, 0])
    trajectory = time_path(np.array([np.zeros(6), goal]), VELOCITY, ACCELERATION)
    quickest = 2.0 / VELOCITY[0] + VELOCITY[0] / ACCELERATION[0]
    assert quickest <= trajectory.duration < 1.05 * quickest
    slow = time_path(np.array([np.zeros(6), goal]), VELOCITY, ACCELERATION, TimingOptions(speed=0.5))
    assert slow.duration > 1.8 * trajectory.duration


def test_the_path_stays_near_the_polyline_with_rounded_corners():
    position, _, _ = sampled(time_path(CORNERS, VELOCITY, ACCELERATION, TimingOptions(blend_rad=0.05)))
    line = densify(CORNERS, 1e-4, 0.002)
    assert max(np.linalg.norm(line - q, axis=1).min() for q in position) < 0.03


def test_sampled_speed_is_the_derivative_of_the_angle():
    trajectory = time_path(CORNERS[:3], VELOCITY, ACCELERATION)
    for t in np.linspace(0.1, trajectory.duration - 0.1, 17):
        before, now, after = (trajectory.sample(t + h) for h in (-1e-4, 0.0, 1e-4))
        assert np.allclose((after.position - before.position) / 2e-4, now.velocity, atol=1e-3)


def test_corners_are_rounded_less_where_the_way_is_narrow():
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])

    def near_the_corner(a, b):  # free within 1 cm (rad) of the polyline
        middle = 0.5 * (a + b)
        return min(abs(middle[1]), abs(middle[0] - 1.0)) < 0.01

    limits = np.ones(2)
    wide = sampled(time_path(corner, limits, limits))[0]
    tight = sampled(time_path(corner, limits, limits, edge_valid=near_the_corner))[0]
    assert np.minimum(np.abs(wide[:, 1]), np.abs(wide[:, 0] - 1)).max() > 0.02
    assert np.minimum(np.abs(tight[:, 1]), np.abs(tight[:, 0] - 1)).max() < 0.012


def test_a_path_that_is_never_free_is_a_typed_failure():
    with pytest.raises(ActionFailed) as failure:
        time_path(CORNERS, VELOCITY, ACCELERATION, edge_valid=lambda a, b: False)
    assert failure.value.reason is Reason.IN_COLLISION


def test_repeated_waypoints_and_a_path_of_no_length_are_fine():
    repeated = time_path(np.repeat(CORNERS[:2], 3, axis=0), VELOCITY, ACCELERATION)
    assert repeated.duration == pytest.approx(time_path(CORNERS[:2], VELOCITY, ACCELERATION).duration)
    still = time_path(np.array([CORNERS[0], CORNERS[0]]), VELOCITY, ACCELERATION)
    assert still.duration == 0.0
    assert still.progress(0.0) == 1.0
    assert np.array_equal(still.sample(1.0).position, CORNERS[0])


@pytest.mark.parametrize("change", [{"waypoints": np.full((2, 6), np.nan)}, {"velocity_max": np.ones(5)},
                                    {"acceleration_max": np.zeros(6)}, {"waypoints": np.zeros(6)}])  # fmt: skip
def test_wrong_input_is_refused(change):
    good = {"waypoints": CORNERS, "velocity_max": VELOCITY, "acceleration_max": ACCELERATION}
    with pytest.raises(InvalidInput):
        time_path(**{**good, **change})


def test_a_malformed_trajectory_is_refused():
    with pytest.raises(InvalidInput):
        Trajectory(times=np.array([0.0, 0.0]), positions=np.zeros((2, 6)), velocities=np.zeros((2, 6)))
    with pytest.raises(InvalidInput):
        Trajectory(times=np.array([0.0, 1.0]), positions=np.zeros((3, 6)), velocities=np.zeros((3, 6)))
    with pytest.raises(InvalidInput):
        Trajectory(times=np.array([0.0, 1.0]), positions=np.full((2, 6), np.inf), velocities=np.zeros((2, 6)))
    with pytest.raises(InvalidInput):
        TimingOptions(speed=0.0)


def test_a_velocity_is_reached_and_left_within_the_limits():
    limiter = VelocityLimiter(VELOCITY, ACCELERATION)
    speeds = [limiter.step(3.0 * VELOCITY) for _ in range(60)]
    steps = np.abs(np.diff([np.zeros(6), *speeds], axis=0)) / 0.01
    assert (steps <= ACCELERATION + 1e-6).all()
    assert np.allclose(speeds[-1], VELOCITY)
    count = 0
    while not limiter.at_rest:
        limiter.stop()
        count += 1
    assert count == np.ceil(round((VELOCITY / ACCELERATION).max() / 0.01, 6))


def test_too_fast_a_wish_keeps_its_direction():
    limiter = VelocityLimiter(VELOCITY, ACCELERATION)
    wish = np.array([2.0, 1.0, 0, 0, 0, 0])
    for _ in range(100):
        velocity = limiter.step(wish)
    assert velocity[0] == pytest.approx(VELOCITY[0])
    assert velocity[1] == pytest.approx(0.5 * VELOCITY[0])


def test_the_limiter_refuses_nonsense():
    with pytest.raises(InvalidInput):
        VelocityLimiter(VELOCITY, np.zeros(6))
    with pytest.raises(InvalidInput):
        VelocityLimiter(VELOCITY, ACCELERATION).step(np.full(6, np.nan))
