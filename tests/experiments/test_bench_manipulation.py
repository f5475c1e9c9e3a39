"""The peers of the manipulation bench do the same as we do."""

from __future__ import annotations

import numpy as np
import pytest

from grape.experiments.bench_manipulation import NOW_S, _servo_near_its_end, seconds
from grape.experiments.bench_peers import BROADPHASES, BroadphaseChecker, jacobian_step, rrt_connect
from grape.experiments.bench_scene import CLOUD_POINTS, BenchScene, build_scene


@pytest.fixture(scope="module")
def scene() -> BenchScene:
    return build_scene()


@pytest.mark.parametrize("manager", BROADPHASES)
def test_the_broadphase_calls_the_same_states_free(scene: BenchScene, manager: str) -> None:
    peer = BroadphaseChecker(scene, manager)
    states = scene.states(200, np.random.default_rng(5))
    ours, theirs = (np.array([check(q) for q in states]) for check in (scene.checker.is_valid, peer.is_valid))
    assert 0.3 < ours.mean() < 0.8
    assert np.mean(ours == theirs) > 0.95
    assert not (ours & ~theirs).any(), "ours is the more careful one"


def test_the_peers_search_finds_a_path_and_none_through_walls(scene: BenchScene) -> None:
    planner = scene.robot.planner
    start, goal = scene.free_states(2, np.random.default_rng(3))
    limits = planner.bounds()
    assert rrt_connect(start, goal, limits, scene.checker.is_valid, 0.6, 1)
    free = np.abs(start - goal).max() / 3
    near = [start, goal]

    def only_at_the_ends(q: np.ndarray) -> bool:
        return min(np.abs(q - end).max() for end in near) < free

    assert not rrt_connect(start, goal, limits, only_at_the_ends, 0.6, 1, timeout_s=0.2)


def test_the_cloud_is_one_of_the_size_that_is_asked_for(scene: BenchScene) -> None:
    assert scene.vine.shape == (CLOUD_POINTS, 3)
    assert len(np.unique(scene.vine, axis=0)) == CLOUD_POINTS
    assert scene.vine[:, 2].min() > 0.1


def test_the_servo_run_of_the_bench_moves_the_camera() -> None:
    servo = _servo_near_its_end(np.eye(4))
    assert 1e-3 < np.linalg.norm(servo.twist(NOW_S, np.eye(4))[:3]) < 0.05


def test_joint_velocities_without_limits_give_the_wished_twist(scene: BenchScene) -> None:
    arm = scene.robot.arm
    q, twist = scene.robot.description.arm.poses["ready_left_fore"], np.array([0.01, 0.02, 0.0, 0.0, 0.1, 0.0])
    np.testing.assert_allclose(arm.jacobian(q) @ jacobian_step(arm)(q, twist), twist, atol=1e-9)


def test_times_are_those_of_one_call_and_both_sides_take_turns() -> None:
    calls: list[str] = []
    ours, theirs = seconds(lambda: calls.append("a"), lambda: calls.append("b"), rounds=3, repeats=4)
    assert 0.0 <= min(ours, theirs) < 0.01
    assert "".join(calls) == "ab" + 3 * "aaaabbbb"
