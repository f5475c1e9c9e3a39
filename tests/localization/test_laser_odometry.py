"""Motion by scans: right among trunks, unknown along what looks the same farther on, heard before spinning wheels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import rotation_from_rpy
from grape.localization import (
    EstimatorOptions,
    Fusion,
    LaserMotion,
    LaserOdometry,
    LaserOdometryOptions,
    PoseEstimator,
    SensorOptions,
    components,
    reading_of_components,
)
from grape.mapping import between
from grape.mapping.planar import transform_points
from grape.messages import Array

STEP_S = 0.2
SPIN = np.array([0.5, 0.0, 0.0])


def trunks(rng: np.random.Generator) -> Array:
    """(n, 2) m, what a laser sees of two rows of trunks."""
    along = np.arange(-8.0, 12.0, 1.15)
    middles = np.vstack([np.column_stack([along, np.full_like(along, y)]) for y in (-1.3, 1.3)])
    middles = middles + rng.normal(0.0, 0.05, middles.shape)
    return np.repeat(middles, 4, axis=0) + rng.normal(0.0, 0.02, (4 * len(middles), 2))


def hedges(rng: np.random.Generator) -> Array:
    """(n, 2) m, two rows of leaves without an end; seen anew each time, for another leaf is hit from elsewhere."""
    along = rng.uniform(-6.0, 6.0, 300)
    return np.column_stack([along, np.where(np.arange(300) % 2, 1.3, -1.3) + rng.normal(0.0, 0.06, 300)])


def seen(points: Array, pose: Array, rng: np.random.Generator) -> Array:
    """What stands at points in map, as it is seen at a pose."""
    at = transform_points(between(pose, np.zeros(3)), points)
    return at[np.hypot(*at.T) < 6.0] + rng.normal(0.0, 0.01, (int((np.hypot(*at.T) < 6.0).sum()), 2))


def test_among_trunks_it_tells_the_motion_though_the_guess_is_that_of_spinning_wheels() -> None:
    rng, odometry = np.random.default_rng(1), LaserOdometry()
    world, pose, twist = trunks(rng), np.zeros(3), np.array([0.1, 0.0, 0.05])
    off, told = [], []
    for k in range(60):
        motion = odometry.take(STEP_S * k, seen(world, pose, rng), twist + SPIN)
        if motion is not None:
            told.append(motion)
            off.append((motion.twist - twist) / np.sqrt(np.diag(motion.covariance)))
        c, s = np.cos(pose[2]), np.sin(pose[2])
        pose = pose + STEP_S * np.array([c * twist[0], s * twist[0], twist[2]])
    assert len(told) > 45 and not any(motion.slides for motion in told)
    assert np.median(np.abs([motion.twist[0] - twist[0] for motion in told])) < 0.03
    assert np.sqrt(np.mean(np.square(off), axis=0)) == pytest.approx(np.ones(3), abs=0.8), "its covariance is true"


def test_along_hedges_it_says_that_it_slides_and_still_tells_the_way_across() -> None:
    rng, odometry = np.random.default_rng(2), LaserOdometry()
    told: list[LaserMotion] = []
    for k in range(40):
        leaves = hedges(rng)  # the base drives ahead at 0.4 m/s, which nothing shows, and to the left at 0.1
        motion = odometry.take(STEP_S * k, leaves - [0.0, 0.1 * STEP_S * k], np.zeros(3))
        told += [] if motion is None else [motion]
    assert len(told) > 25 and np.mean([motion.slides for motion in told]) > 0.9
    slid = [motion for motion in told if motion.slides]
    assert min(np.sqrt(motion.covariance[0, 0]) for motion in slid) > 1.0, "m/s, ahead it knows nothing"
    assert np.median([motion.twist[1] for motion in slid]) == pytest.approx(0.1, abs=0.05)
    assert np.median([np.sqrt(motion.covariance[1, 1]) for motion in slid]) < 0.2


def test_without_the_trial_a_slide_would_be_believed() -> None:
    rng = np.random.default_rng(2)
    odometry = LaserOdometry(LaserOdometryOptions(slide_share=1e9))
    stds = []
    for k in range(40):
        motion = odometry.take(STEP_S * k, hedges(rng), np.zeros(3))
        stds += [] if motion is None else [np.sqrt(motion.covariance[0, 0])]
    assert np.median(stds) < 0.2, "m/s; the base might drive at any speed"


@pytest.mark.parametrize("points", [np.zeros((3, 2)), np.full((50, 2), np.nan)])
def test_scans_that_show_nothing_tell_nothing_and_the_next_ones_begin_anew(points: Array) -> None:
    rng, odometry = np.random.default_rng(3), LaserOdometry()
    world = trunks(rng)
    assert odometry.take(0.0, seen(world, np.zeros(3), rng), np.zeros(3)) is None
    assert odometry.take(0.2, points, np.zeros(3)) is None
    assert odometry.take(0.4, seen(world, np.zeros(3), rng), np.zeros(3)) is None
    assert odometry.take(0.6, seen(world, np.zeros(3), rng), np.zeros(3)) is not None
    assert odometry.take(0.6, seen(world, np.zeros(3), rng), np.zeros(3)) is None, "time does not stand still"
    assert odometry.take(9.0, seen(world, np.zeros(3), rng), np.zeros(3)) is None, "after a silence"


def test_wrong_input_is_refused() -> None:
    with pytest.raises(InvalidInput, match=r"points \(n, 2\)"):
        LaserOdometry().take(0.0, np.zeros((5, 3)), np.zeros(3))
    with pytest.raises(InvalidInput, match="finite twist"):
        LaserOdometry().take(0.0, np.zeros((5, 2)), np.array([np.nan, 0.0, 0.0]))
    with pytest.raises(InvalidInput, match="5 points"):
        LaserOdometryOptions(least_points=2)


@pytest.mark.parametrize("laser", [False, True])
def test_wheels_that_spin_straight_on_carry_the_estimate_away_unless_the_laser_sees_it(
    drive, datum, fix, laser
) -> None:
    """In mud the wheels turn at 0.5 m/s for six seconds and the base stands."""
    ride, level = drive(12, 1.0, slope=0.0), rotation_from_rpy(0, 0, 0)
    rng, odometry, off = np.random.default_rng(4), LaserOdometry(), []
    world, estimator = trunks(rng), PoseEstimator(EstimatorOptions(datum=datum))
    for k in range(1050):
        stamp = 1.0 + 0.02 * k
        angle = ride.wheels[0].position + 0.5 * 0.02 * max(0, k - 750) / 0.1651
        imu, wheels = replace(ride.imu[0], stamp=stamp), replace(ride.wheels[0], stamp=stamp, position=angle)
        fixes = (fix(stamp, np.zeros(3), level, np.zeros(3)),) if k % 50 == 0 else ()
        here = estimator.advance(stamp, wheels=(wheels,), imu=(imu,), gnss=fixes)
        if laser and k % 10 == 9:
            twist = np.array([here.linear[0], here.linear[1], here.angular[2]])
            motion = odometry.take(stamp, seen(world, np.zeros(3), rng), twist)
            if motion is not None:
                assert estimator.take_motion(motion.measurement()).accepted
        off.append(np.hypot(*here.pose[:2, 3]))
    assert max(off) < 0.2 if laser else max(off) > 1.0
    assert (estimator.verdicts["gnss", "gated"] == 0) == laser


def test_a_filter_of_any_sensors_takes_it_too() -> None:
    options = SensorOptions(components=components("x", "y", "z", "roll", "pitch", "yaw"), std=np.full(15, 0.1))
    fusion = Fusion({"pose": options})
    fusion.take(reading_of_components(0.0, "pose", x=0.0, y=0.0, z=0.0, roll=0.0, pitch=0.0, yaw=0.0))
    motion = LaserMotion(stamp=0.1, twist=np.array([0.4, 0.0, 0.1]), covariance=np.eye(3) * 1e-4, slides=False)
    assert fusion.correct(motion.measurement()).accepted
    assert fusion.odometry(0.1).linear[0] == pytest.approx(0.4, abs=0.05)
