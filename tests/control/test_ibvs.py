import numpy as np
import pytest

from grape.control import MarkerServo, MarkerServoOptions, ServoStage, marker_corners
from grape.control.features import adaptive_gain, interaction_matrix, project, square_depths
from grape.errors import ActionFailed, InvalidInput, Reason
from grape.geometry import inverse, pose, pose_error, rotation_exp, rotation_from_rpy, transform

from .conftest import MARKERS, SIDE, T_HAND_CAMERA, K, desired_view, goal_hand

OPTIONS = MarkerServoOptions(standoff_m=0.08, stop_px=0.5)


def make_servo(options=OPTIONS):
    return MarkerServo({i: desired_view(T) for i, T in MARKERS.items()}, SIDE, K, options)


def pixels(T_base_camera, i):
    return project(transform(inverse(T_base_camera) @ MARKERS[i], marker_corners(SIDE))) * K[0, 0] + K[:2, 2]


def hand_error(sim):
    error = pose_error(goal_hand(0.0), sim.arm.fk(sim.q))
    return np.linalg.norm(error[:3]), np.linalg.norm(error[3:])


@pytest.mark.parametrize("seed", range(4))
def test_eight_corners_converge_within_2_mm_from_5_cm_and_10_degrees(start, run, seed):
    sim = start(seed)
    believed = np.linalg.norm((sim.arm.fk(sim.measured) - sim.arm.fk(sim.q))[:3, 3])
    assert 0.02 < believed < 0.05
    states = run(make_servo(), sim)
    distance, angle = hand_error(sim)
    assert states[-1].converged
    assert distance < 0.002
    assert angle < np.radians(0.5)


def test_stages_run_in_order_and_the_second_starts_at_the_standoff(start, run):
    sim = start(2)
    states = run(make_servo(), sim)
    order = list(dict.fromkeys(state.stage for state in states))
    assert order == [ServoStage.STAND_OFF, ServoStage.DESCEND, ServoStage.FINAL, ServoStage.CONVERGED]
    assert {s.standoff_m for s in states if s.stage is ServoStage.STAND_OFF} == {0.08}
    assert states[-1].standoff_m == 0.0


def test_one_marker_is_enough(start, run):
    sim = start(3, visible=lambda t: (10,))
    assert run(make_servo(), sim, seconds=25.0)[-1].converged
    assert hand_error(sim)[0] < 0.005


@pytest.mark.parametrize(("switch_rate", "jumps"), [(6.0, False), (1e6, True)])
def test_a_second_marker_that_disagrees_takes_over_smoothly(switch_rate, jumps):
    T, last, steps = goal_hand(0.09) @ T_HAND_CAMERA, np.zeros(6), []
    options = MarkerServoOptions(standoff_m=0.08, switch_rate=switch_rate)
    moved = MARKERS[11] @ pose(translation=(0.0, 0.03, 0.0))  # its target is 3 cm off
    servo = MarkerServo({10: desired_view(MARKERS[10]), 11: desired_view(moved)}, SIDE, K, options)
    for k in range(200):
        if k % 7 == 0:
            i = 10 if k < 100 else 11
            servo.update(0.01 * k, {i: pixels(T, i)}, T)
        twist = servo.twist(0.01 * k + 0.001, T)
        if k > 90:
            steps.append(float(np.linalg.norm(twist[:3] - last[:3])))
        last = twist
    assert servo.state.visible == (11,)
    assert np.linalg.norm(last[:3]) > 0.02
    assert (max(steps) > 0.02) == jumps


def test_glare_on_one_marker_is_survived(start, run):
    sim = start(1)
    sim.visible = lambda t: (11,) if 1.0 < t < 3.0 else (10, 11)
    assert run(make_servo(), sim)[-1].converged
    assert hand_error(sim)[0] < 0.002


def settled_servo():
    """A servo that saw both markers at time 0 from 2 cm off."""
    servo = make_servo()
    T = goal_hand(0.10) @ T_HAND_CAMERA
    T[0, 3] += 0.02
    servo.update(0.0, {i: pixels(T, i) for i in MARKERS}, T)
    assert np.linalg.norm(servo.twist(0.01, T)) >= 0.0
    return servo, T


def test_motion_fades_to_zero_within_0_3_s_after_the_markers_are_lost():
    servo, T = settled_servo()
    moving = np.linalg.norm(servo.twist(0.19, T))
    for stamp in (0.066, 0.132, 0.198, 0.264):
        servo.update(stamp, {}, T)
    assert moving > 1e-3
    assert 0 < np.linalg.norm(servo.twist(0.25, T)) < moving
    assert not servo.twist(0.30, T).any()


def test_features_lost_for_2_s_end_the_run():
    servo, T = settled_servo()
    for stamp in np.arange(0.1, 2.1, 0.1):
        servo.update(float(stamp), {}, T)
    with pytest.raises(ActionFailed) as failure:
        servo.twist(2.05, T)
    assert failure.value.reason is Reason.FEATURE_LOST


def test_markers_never_seen_end_the_run():
    servo, T = make_servo(), goal_hand(0.1) @ T_HAND_CAMERA
    assert not servo.twist(0.0, T).any()
    servo.update(1.9, {}, T)
    with pytest.raises(ActionFailed) as failure:
        servo.twist(2.1, T)
    assert failure.value.reason is Reason.FEATURE_LOST


def test_frames_that_stop_coming_end_the_run():
    servo, T = settled_servo()
    with pytest.raises(ActionFailed) as failure:
        servo.twist(2.05, T)
    assert failure.value.reason is Reason.STALE_DATA


def test_frames_that_are_not_newer_and_unknown_markers_are_ignored():
    servo, T = settled_servo()
    before = servo.state
    assert servo.update(0.0, {}, T) == before
    assert servo.update(0.05, {49: pixels(T, 10)}, T) == before


def test_the_standoff_does_not_shrink_while_no_marker_is_seen():
    servo, T = make_servo(), goal_hand(0.08) @ T_HAND_CAMERA
    for k in range(5):
        servo.update(0.066 * k, {i: pixels(T, i) for i in MARKERS}, T)
        servo.twist(0.066 * k, T)
    assert servo.state.stage is ServoStage.DESCEND
    for t in np.arange(0.6, 1.5, 0.01):
        servo.update(float(t), {}, T)
        servo.twist(float(t), T)
    assert servo.state.standoff_m > 0.07


def test_interaction_matrix_agrees_with_finite_differences():
    T_camera_marker = pose(rotation_from_rpy(3.0, 0.2, 0.3), (0.03, -0.02, 0.3))
    points = transform(T_camera_marker, marker_corners(SIDE))
    L = interaction_matrix(project(points), points[:, 2])
    for k in range(6):
        twist = np.eye(6)[k] * 1e-6
        moved = transform(inverse(pose(rotation_exp(twist[3:]), twist[:3])), points)
        assert np.allclose((project(moved) - project(points)).ravel() / 1e-6, L[:, k], atol=1e-4)


def test_depths_of_a_slanted_square_are_exact_without_noise():
    points = transform(pose(rotation_from_rpy(2.8, 0.5, 0.3), (0.03, -0.02, 0.3)), marker_corners(SIDE))
    assert np.allclose(square_depths(project(points), SIDE), points[:, 2], atol=1e-9)


def test_gain_falls_from_its_value_at_zero_with_the_given_slope():
    assert adaptive_gain(0.0, 1.6, 0.8, 20.0) == pytest.approx(1.6)
    assert adaptive_gain(1.0, 1.6, 0.8, 20.0) == pytest.approx(0.8, abs=1e-6)
    assert (adaptive_gain(1e-6, 1.6, 0.8, 20.0) - 1.6) / 1e-6 == pytest.approx(-20.0, rel=1e-3)


@pytest.mark.parametrize("arguments", [({}, SIDE, K), ({1: desired_view(MARKERS[10])}, 0.0, K),
                                       ({1: desired_view(MARKERS[10])}, SIDE, np.eye(2))])  # fmt: skip
def test_wrong_input_is_refused(arguments):
    with pytest.raises(InvalidInput):
        MarkerServo(*arguments)
    with pytest.raises(InvalidInput):
        MarkerServoOptions(fade_from_s=0.4)
