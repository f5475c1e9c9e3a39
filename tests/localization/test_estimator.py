from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import rotation_from_rpy, rotation_to_quaternion, yaw_of
from grape.localization import EstimatorOptions, Measurement, PoseEstimator
from grape.messages import JointState


def run(drive, estimator, *, until: float = np.inf, gnss=None, wheels=True):
    """Feed a drive beat by beat; returns stamps, errors (n, 2) m and yaw errors (n,) where the pose was ready."""
    fixes = list(drive.gnss if gnss is None else gnss)
    stamps, errors, yaw_errors = [], [], []
    for k, stamp in enumerate(drive.stamps):
        if stamp > until:
            break
        due = tuple(f for f in fixes[:1] if f.stamp <= stamp)
        fixes = fixes[len(due) :]
        odometry = estimator.advance(stamp, wheels=(drive.wheels[k],) if wheels else (), imu=(drive.imu[k],), gnss=due)
        if estimator.initialized:
            stamps.append(stamp)
            errors.append(odometry.pose[:2, 3] - drive.poses[k, :2])
            yaw_errors.append(np.remainder(yaw_of(odometry.pose) - drive.poses[k, 2] + np.pi, 2 * np.pi) - np.pi)
    return np.array(stamps), np.array(errors), np.array(yaw_errors)


def test_rows_and_turns_with_slip_are_tracked_within_three_centimetres(drive, datum):
    estimator = PoseEstimator(EstimatorOptions(datum=datum))
    _, errors, yaw_errors = run(drive(7, 60.0, true_track=0.8), estimator)
    assert estimator.ready
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.03
    assert np.abs(yaw_errors).max() < np.radians(2.5)


def test_before_the_first_fix_the_pose_is_unknown_and_not_ready(drive, datum):
    estimator = PoseEstimator(EstimatorOptions(datum=datum))
    ride = drive(12, 1.0, slope=0.0)
    odometry = estimator.advance(0.5, wheels=tuple(ride.wheels[:20]), imu=tuple(ride.imu[:20]))
    assert not estimator.initialized and not estimator.ready
    assert odometry.pose_covariance[0, 0] >= 1e6


def test_one_jump_of_half_a_metre_moves_the_estimate_less_than_five_centimetres(drive, datum):
    ride = drive(7, 60.0, true_track=0.8)
    clean, jumped = PoseEstimator(EstimatorOptions(datum=datum)), PoseEstimator(EstimatorOptions(datum=datum))
    fixes = list(ride.gnss)
    fixes[12] = replace(fixes[12], latitude=fixes[12].latitude + 0.5 / 111_000)
    _, a, _ = run(ride, clean, until=15.0)
    _, b, _ = run(ride, jumped, gnss=fixes, until=15.0)
    assert np.abs(a - b).max() < 0.05
    assert jumped.verdicts["gnss", "gated"] == 1


def test_sixty_seconds_without_gnss_stay_within_thirty_centimetres(drive, datum):
    ride = drive(10, 66.0)
    fixes = [f for f in ride.gnss if f.stamp < 6.0]
    _, errors, _ = run(ride, PoseEstimator(EstimatorOptions(datum=datum)), gnss=fixes)
    assert np.hypot(*errors.T).max() < 0.30


def test_long_silence_makes_the_pose_unready(drive, datum):
    estimator = PoseEstimator(EstimatorOptions(datum=datum))
    run(drive(7, 60.0, true_track=0.8), estimator, until=6.0)
    assert estimator.ready_at(6.1)
    assert not estimator.ready_at(120.0)


def test_wheels_at_rest_hold_the_pose_still_against_noisy_fixes(drive, datum, fix):
    ride = drive(12, 1.0, slope=0.0)
    estimator = PoseEstimator(EstimatorOptions(datum=datum))
    rng = np.random.default_rng(12)
    still, seen = ride.wheels[0], []
    R = rotation_from_rpy(0, 0, 0)
    for k in range(1500):
        stamp = 0.02 * (k + 1)
        fixes = (fix(stamp, np.zeros(3), R, rng.normal(size=3)),) if k % 50 == 0 else ()
        imu = replace(ride.imu[0], stamp=stamp)
        odometry = estimator.advance(stamp, wheels=(replace(still, stamp=stamp),), imu=(imu,), gnss=fixes)
        seen.append(odometry.pose[:2, 3].copy())
    late = np.array(seen[750:])
    assert np.ptp(late, axis=0).max() < 0.015
    assert np.hypot(*late.T).max() < 0.02


def test_slope_does_not_shift_the_position(drive, datum):
    ride = drive(13, 20.0, slope=0.15)
    _, errors, _ = run(ride, PoseEstimator(EstimatorOptions(datum=datum)))
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.05


def test_broken_messages_are_counted_and_do_no_harm(drive, datum):
    ride = drive(7, 60.0, true_track=0.8)
    estimator = PoseEstimator(EstimatorOptions(datum=datum))
    run(ride, estimator, until=6.0)
    before = estimator.odometry(6.0)
    broken = replace(ride.imu[-1], stamp=6.0, orientation=np.full(4, np.nan))
    lost = replace(ride.gnss[-1], stamp=6.0, status="none")
    after = estimator.advance(6.0, imu=(broken,), gnss=(lost,))
    assert estimator.verdicts["imu", "invalid"] == 1 and estimator.verdicts["gnss", "invalid"] == 1
    assert np.allclose(before.pose, after.pose)


def test_position_is_given_up_after_many_fixes_that_agree_elsewhere(drive, datum, fix):
    ride = drive(12, 1.0, slope=0.0)
    estimator = PoseEstimator(EstimatorOptions(datum=datum, relocate_after=5))
    R = rotation_from_rpy(0, 0, 0)
    for k in range(60):
        stamp = 1.0 + k
        place = np.array([0.0 if k < 30 else 4.0, 0.0, 0.0])
        imu, wheels = replace(ride.imu[0], stamp=stamp), replace(ride.wheels[0], stamp=stamp)
        estimator.advance(stamp, wheels=(wheels,), imu=(imu,), gnss=(fix(stamp, place, R, np.zeros(3)),))
    assert estimator.odometry(60.0).pose[0, 3] == pytest.approx(4.0, abs=0.05)


@pytest.mark.parametrize(
    ("left", "right", "rate", "speed"),
    [
        pytest.param(0.5, 0.5, 0.5, 0.3, id="wheels turn the bend at full speed and the base loses 0.2 m each second"),
        pytest.param(0.0, 1.7, 0.3, 0.0, id="on a side slope the outer wheels spin and the base only turns"),
    ],
)
def test_good_fix_after_a_slipping_bend_is_not_taken_for_a_jump(drive, datum, fix, left, right, rate, speed):
    ride = drive(12, 1.0, slope=0.0)
    estimator = PoseEstimator(EstimatorOptions(datum=datum))
    R, angle, yaw = rotation_from_rpy(0, 0, 0), np.zeros(4), 0.0
    turned = 0.02 / 0.1651 * np.array([left, right, left, right])
    for k in range(400):
        stamp = 0.02 * (k + 1)
        bend = k >= 300
        yaw += rate * 0.02 * bend
        R = rotation_from_rpy(0, 0, yaw)
        angle = angle + turned * bend
        wheels = replace(ride.wheels[0], stamp=stamp, position=angle)
        imu = replace(
            ride.imu[0],
            stamp=stamp,
            orientation=rotation_to_quaternion(R),
            angular_velocity=np.array([0.0, 0.0, rate * bend]),
        )
        true = np.array([max(0.0, 0.02 * (k - 300) * speed), 0.0, 0.0])
        fixes = (fix(stamp, true, R, np.zeros(3)),) if k % 50 == 49 else ()
        estimator.advance(stamp, wheels=(wheels,), imu=(imu,), gnss=fixes)
    assert estimator.verdicts["gnss", "gated"] == 0
    assert np.hypot(*(estimator.odometry(8.0).pose[:2, 3] - true[:2])) < 0.05


@pytest.mark.parametrize(("turned", "doubted", "given_up"), [(0.5, 2, 8), (0.0, 16, 64)])
def test_robot_stands_while_good_fixes_are_refused(drive, datum, fix, turned, doubted, given_up):
    """Its wheels have turned since the last good fix, or it has stood all the time."""
    ride = drive(12, 1.0, slope=0.0)
    estimator = PoseEstimator(EstimatorOptions(datum=datum))
    level, ready = rotation_from_rpy(0, 0, 0), []
    for k in range(750 + 50 * (given_up + 5)):
        stamp, place = 1.0 + 0.02 * k, np.array([0.0 if k < 750 else 3.0, 0.0, 0.0])
        angle = ride.wheels[0].position + turned * np.clip((k - 710) / 20, 0.0, 1.0) / 0.165
        imu, wheels = replace(ride.imu[0], stamp=stamp), replace(ride.wheels[0], stamp=stamp, position=angle)
        fixes = (fix(stamp, place, level, np.zeros(3)),) if k % 50 == 0 else ()
        estimator.advance(stamp, wheels=(wheels,), imu=(imu,), gnss=fixes)
        ready += [estimator.ready] * len(fixes)
    assert ready[14 : 14 + doubted] == [True] * doubted, "one fix elsewhere is a jump"
    assert ready[14 + doubted : 14 + given_up] == [False] * (given_up - doubted)
    assert ready[-1], "where fixes stay elsewhere, they win"


def test_after_wheels_spun_a_float_solution_does_not_make_the_estimate_believed(drive, datum, fix):
    """They turn for two metres on the spot, float solutions follow, and then each fix has the base where it was."""
    ride, level = drive(12, 1.0, slope=0.0), rotation_from_rpy(0, 0, 0)
    estimator, here = PoseEstimator(EstimatorOptions(datum=datum)), []
    for k in range(1800):
        stamp = 1.0 + 0.02 * k
        angle = ride.wheels[0].position + 2.0 * np.clip((k - 710) / 200, 0.0, 1.0) / 0.165
        imu, wheels = replace(ride.imu[0], stamp=stamp), replace(ride.wheels[0], stamp=stamp, position=angle)
        status, std = ("float", 0.3) if 800 < k < 1100 else ("fix", 0.015)
        fixes = (fix(stamp, np.zeros(3), level, np.zeros(3), status, std),) if k % 50 == 0 else ()
        estimator.advance(stamp, wheels=(wheels,), imu=(imu,), gnss=fixes)
        here.append(estimator.odometry(stamp).pose[0, 3])
    assert estimator.verdicts["gnss", "accepted"] > 15 and here[1100] > 0.6
    assert estimator.ready and abs(here[1550]) < 0.05, "eight fixes are enough, though it has stood since"


def test_a_robot_that_a_float_solution_holds_at_the_limit_does_not_start_and_stop(drive, datum, fix):
    """It drives a little whenever it is ready, as a mission does."""
    ride, level = drive(12, 1.0, slope=0.0), rotation_from_rpy(0, 0, 0)

    def changes(again: float) -> int:
        estimator, ready, travelled = PoseEstimator(EstimatorOptions(datum=datum, again=again)), [], 0.0
        for k in range(3500):
            stamp = 1.0 + 0.02 * k
            travelled += 0.01 if k > 250 and estimator.ready else 0.0
            angle = ride.wheels[0].position + travelled / 0.165
            imu, wheels = replace(ride.imu[0], stamp=stamp), replace(ride.wheels[0], stamp=stamp, position=angle)
            status, std = ("fix", 0.015) if k < 500 or k > 2800 else ("float", 0.2)
            here = fix(stamp, np.array([travelled, 0.0, 0.0]), level, np.zeros(3), status, std)
            estimator.advance(stamp, wheels=(wheels,), imu=(imu,), gnss=(here,) if k % 50 == 0 else ())
            ready.append(estimator.ready)
        assert ready[400] and not all(ready[600:2800]) and ready[-1]
        return int(np.count_nonzero(np.diff(ready[400:])))

    assert changes(0.8) == 2, "it stands until the solution is fixed"
    assert changes(1.0) > 10


def test_a_pose_of_another_source_holds_the_estimate_and_clears_the_doubt(drive, datum):
    ride = drive(7, 60.0, true_track=0.8)
    estimator = PoseEstimator(EstimatorOptions(datum=datum))
    pose = Measurement(
        stamp=20.0, source="amcl", index=np.array([0, 1, 5]), value=np.zeros(3), covariance=np.eye(3) * 1e-2
    )
    with pytest.raises(InvalidInput, match="no pose yet"):
        estimator.correct(pose)
    fixes = [replace(f, latitude=f.latitude + 0.5 / 111_000) if f.stamp > 17.0 else f for f in ride.gnss]
    run(ride, estimator, gnss=fixes, until=20.0)
    assert not estimator.ready, "GNSS says again and again that the robot is elsewhere"
    here = estimator.odometry(20.0).pose
    value = np.array([*here[:2, 3], yaw_of(here)])
    assert estimator.correct(replace(pose, value=value)).accepted
    assert estimator.ready and estimator.verdicts["amcl", "accepted"] == 1


def test_wheels_that_change_or_are_not_finite_are_refused_and_the_next_ones_count(drive, datum):
    ride = drive(12, 3.0, slope=0.0)
    estimator = PoseEstimator(EstimatorOptions(datum=datum))
    run(ride, estimator, until=2.0)
    last = next(m for m in reversed(ride.wheels) if m.stamp <= 2.0)
    two = JointState(stamp=2.1, name=last.name[:2], position=np.ones(2), velocity=np.zeros(2), effort=np.zeros(2))
    nan = replace(last, stamp=2.2, position=np.full(4, np.nan))
    good = [replace(last, stamp=stamp) for stamp in (2.3, 2.4)]
    accepted = estimator.verdicts["wheels", "accepted"]
    odometry = estimator.advance(2.4, wheels=(two, nan, *good))
    assert estimator.verdicts["wheels", "invalid"] == 2, "from four wheels to two, and back"
    assert estimator.verdicts["wheels", "accepted"] == accepted + 1, "the first good one after nan tells no speed"
    assert np.isfinite(odometry.pose).all()
