import numpy as np
import pytest

from grape.control import DifferentialIk, LinearMotion, LinearMotionOptions
from grape.errors import ActionFailed, InvalidInput, Reason

from .conftest import VELOCITY


def run(motion, arm, q, seconds=12.0, velocity_of=lambda step: step.velocity):
    """Follow with a lag of 0.07 s like the arm's servo; returns hand positions, rotations and the last step."""
    velocity, positions, rotations, step = np.zeros(6), [], [], None
    for _ in range(int(seconds / 0.01)):
        step = motion.step(q, 0.01)
        if step.done:
            break
        velocity = velocity + (velocity_of(step) - velocity) * 0.01 / 0.08
        q = q + velocity * 0.01
        T = arm.fk(q)
        positions.append(T[:3, 3].copy())
        rotations.append(T[:3, :3].copy())
    return np.array(positions), rotations, step


def test_the_hand_follows_a_straight_line_at_constant_orientation(arm, q_front):
    start = arm.fk(q_front).copy()
    target = start[:3, 3] + [0.10, 0.05, 0.08]
    motion = LinearMotion(DifferentialIk.for_arm(arm, VELOCITY), q_front, target)
    positions, rotations, step = run(motion, arm, q_front)
    along = (target - start[:3, 3]) / motion.length
    off_line = (positions - start[:3, 3]) - np.outer((positions - start[:3, 3]) @ along, along)
    assert step.done
    assert step.distance_m < 0.002
    assert np.linalg.norm(off_line, axis=1).max() < 0.003
    assert max(np.abs(R - start[:3, :3]).max() for R in rotations) < 0.02
    assert np.linalg.norm(np.diff(positions, axis=0), axis=1).max() / 0.01 < 1.15 * LinearMotionOptions().speed


def test_a_motion_to_where_the_hand_is_ends_at_once(arm, q_front):
    motion = LinearMotion(DifferentialIk.for_arm(arm, VELOCITY), q_front, arm.fk(q_front)[:3, 3])
    step = motion.step(q_front, 0.01)
    assert step.done
    assert not step.velocity.any()


def test_a_growing_distance_ends_the_motion_only_after_the_first_centimetres(arm, q_front):
    target = arm.fk(q_front)[:3, 3] + [0.1, 0.0, 0.05]
    motion = LinearMotion(DifferentialIk.for_arm(arm, VELOCITY), q_front, target)
    travelled = []

    def backwards(step):
        travelled.append(step.distance_m - motion.length)
        return -0.5 * step.velocity

    with pytest.raises(ActionFailed) as failure:
        run(motion, arm, q_front, velocity_of=backwards)
    assert failure.value.reason is Reason.DISTANCE_GROWS
    assert travelled[-1] == pytest.approx(0.025, abs=0.005)


def test_an_arm_that_does_not_move_ends_the_motion(arm, q_front):
    target = arm.fk(q_front)[:3, 3] + [0.1, 0.0, 0.05]
    motion = LinearMotion(DifferentialIk.for_arm(arm, VELOCITY), q_front, target)
    with pytest.raises(ActionFailed) as failure:
        run(motion, arm, q_front, velocity_of=lambda step: np.zeros(6))
    assert failure.value.reason is Reason.UNREACHABLE


def test_wrong_input_is_refused(arm, q_front):
    with pytest.raises(InvalidInput):
        LinearMotion(DifferentialIk.for_arm(arm), q_front, np.array([0.1, np.nan, 0.0]))
    with pytest.raises(InvalidInput):
        LinearMotionOptions(speed=0.0)
