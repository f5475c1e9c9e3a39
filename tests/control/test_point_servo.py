import numpy as np
import pytest

from grape.control import PointServo, PointServoOptions, ServoStage
from grape.errors import ActionFailed, InvalidInput, Reason
from grape.geometry import inverse, transform

from .conftest import NAIL_TIP, NAILS, R_LEVEL, T_HAND_CAMERA, K, goal_hand


def target(standoff):
    """The tip in the optical frame when the hand is level and stands off."""
    return transform(inverse(T_HAND_CAMERA), NAILS + R_LEVEL.T @ np.array([0.0, standoff, 0.0]))


def observe(T_true_camera, rng=None, blind_below=0.0):
    """Pixel and depth of the tip, noisy."""
    noise = np.zeros(3) if rng is None else rng.normal(0, [0.7, 0.7, 0.002])
    p = transform(inverse(T_true_camera), NAIL_TIP)
    pixel = K[:2, :2] @ (p[:2] / p[2]) + K[:2, 2] + noise[:2]
    return (pixel, p[2] + noise[2]) if p[2] >= blind_below else (pixel, None)


def make_run(run, start, seed, blind_below=0.0):
    sim = start(seed, off_deg=0.0)
    rng = np.random.default_rng(seed)
    servo = PointServo(target, K)
    poses = {}

    def feed(servo, frame):
        return servo.update(frame[0], *observe(poses[frame[0]], rng, blind_below), frame[2])

    detect = sim.detect

    def remember():
        poses[sim.t] = sim.camera(sim.q)
        return detect()

    sim.detect = remember
    return sim, run(servo, sim, feed=feed)


@pytest.mark.parametrize("seed", range(3))
def test_the_tip_is_reached_within_5_mm(start, run, seed):
    sim, states = make_run(run, start, seed)
    assert states[-1].converged
    assert np.linalg.norm(sim.arm.fk(sim.q)[:3, 3] + sim.arm.fk(sim.q)[:3, :3] @ NAILS - NAIL_TIP) < 0.005


def test_the_last_centimetres_go_by_kinematics_when_the_depth_ends(start, run):
    sim, states = make_run(run, start, 1, blind_below=0.28)
    assert states[-1].converged
    assert not states[-1].seen
    assert np.linalg.norm(sim.arm.fk(sim.q)[:3, 3] + sim.arm.fk(sim.q)[:3, :3] @ NAILS - NAIL_TIP) < 0.008


def test_the_orientation_is_held(arm, start, run):
    sim = start(2, off_deg=0.0)
    before = arm.fk(sim.measured)[:3, :3]
    servo = PointServo(target, K)

    def feed(servo, frame):
        return servo.update(frame[0], *observe(sim.camera(sim.q)), frame[2])

    run(servo, sim, seconds=2.0, feed=feed)
    assert np.allclose(arm.fk(sim.measured)[:3, :3], before, atol=0.02)


def level_camera(standoff, x=0.0):
    T = goal_hand(standoff)
    T[0, 3] += x
    return T @ T_HAND_CAMERA


def test_without_depth_at_the_start_nothing_moves_and_the_run_ends():
    servo, T = PointServo(target, K), level_camera(0.14)
    for t in np.arange(0.0, 1.95, 0.066):
        servo.update(float(t), observe(T)[0], None, T)
        assert not servo.twist(float(t), T).any()
    with pytest.raises(ActionFailed) as failure:
        servo.twist(2.01, T)
    assert failure.value.reason is Reason.FEATURE_LOST


def test_frames_that_stop_coming_end_the_run():
    servo, T = PointServo(target, K), level_camera(0.14)
    servo.update(0.0, *observe(T), T)
    servo.twist(0.05, T)
    assert not servo.twist(0.31, T).any()
    with pytest.raises(ActionFailed) as failure:
        servo.twist(2.05, T)
    assert failure.value.reason is Reason.STALE_DATA


def test_a_point_far_from_the_prediction_is_not_believed():
    servo, T = PointServo(target, K), level_camera(0.14)
    servo.update(0.0, *observe(T), T)
    pixel, depth = observe(T)
    assert not servo.update(0.066, pixel + 120.0, depth, T).seen
    assert not servo.update(0.132, pixel, depth + 0.1, T).seen
    assert servo.update(0.198, pixel, depth, T).seen


def test_a_point_that_moves_with_the_hand_is_not_followed():
    servo = PointServo(target, K)
    T = np.eye(4)
    assert servo.update(0.0, K[:2, 2], 0.4, T).seen
    seen = []
    for k in range(1, 9):  # it stands still in the image while the camera moves 8 mm a frame
        T[2, 3] = 0.008 * k
        seen.append(servo.update(0.066 * k, K[:2, 2], 0.4, T).seen)
    assert seen[:3] == [True] * 3 and not any(seen[4:])


def test_the_first_measurement_is_gated_by_the_first_guess():
    servo = PointServo(target, K, p_base_point=NAIL_TIP + np.array([0.0, 0.25, 0.0]))
    T = level_camera(0.14)
    assert not servo.update(0.0, *observe(T), T).seen
    near = PointServo(target, K, p_base_point=NAIL_TIP + np.array([0.03, 0.03, 0.0]))
    pixel, depth = near.predict(T)
    assert depth == pytest.approx(observe(T)[1], abs=0.05)
    assert np.abs(pixel - observe(T)[0]).max() < 70
    assert near.update(0.0, *observe(T), T).seen


def test_a_growing_distance_ends_the_run():
    servo = PointServo(target, K)
    with pytest.raises(ActionFailed) as failure:
        for k in range(40):
            T = level_camera(0.10 + 0.003 * k)
            servo.update(0.066 * k, *observe(T), T)
            servo.twist(0.066 * k + 0.01, T)
    assert failure.value.reason is Reason.DISTANCE_GROWS


def test_the_second_stage_waits_for_the_first():
    servo, far = PointServo(target, K), level_camera(0.10, x=0.03)
    for k in range(10):
        servo.update(0.066 * k, *observe(far), far)
        servo.twist(0.066 * k + 0.01, far)
    assert servo.state.stage is ServoStage.STAND_OFF
    assert servo.state.standoff_m == PointServoOptions().standoff_m


def test_a_wrong_camera_matrix_is_refused():
    with pytest.raises(InvalidInput):
        PointServo(target, np.eye(2))


def test_what_is_seen_nearer_than_it_is_trusted_changes_nothing():
    T = level_camera(0.14)
    servo = PointServo(target, K, PointServoOptions(standoff_m=0.04, trust_m=0.05), p_base_point=NAIL_TIP)
    assert not servo.update(0.0, *observe(T), T).seen
    servo = PointServo(target, K, PointServoOptions(standoff_m=0.06, trust_m=0.05), p_base_point=NAIL_TIP)
    assert servo.update(0.0, *observe(T), T).seen


def test_the_first_sights_are_averaged():
    T = level_camera(0.14)
    servo = PointServo(target, K, PointServoOptions(smoothing=0.05))
    pixel, depth = observe(T)
    for k, off in enumerate((-6.0, 0.0, 3.0, 3.0)):
        servo.update(0.1 * k, np.add(pixel, (off, 0.0)), depth, T)
    assert servo.predict(T)[0] == pytest.approx(pixel, abs=0.05)
