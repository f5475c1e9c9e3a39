"""`grape bench manipulation`: state check, first plan, servo cycle and clouds, beside peers that do the same."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import process_time
from typing import TYPE_CHECKING

import numpy as np

from grape.errors import ActionFailed, GrapeError
from grape.messages import Array
from grape.proof import Bench, Comparison

if TYPE_CHECKING:
    from grape.control import MarkerServo
    from grape.experiments.bench_scene import BenchScene
    from grape.planning import JointPlanner, StateChecker

AGREEMENT = 0.95
ROUNDS = 9
PLANS = 15
NOW_S = 1.1  # of the servo run, 0.1 s after its frame
Progress = Callable[[float, str], None]


class BenchError(GrapeError):
    """Two sides of a comparison do not do the same."""


def seconds(*works: Callable[[], object], rounds: int = ROUNDS, repeats: int = 1) -> list[float]:
    """Processor time of one call of each work: the least of some rounds in which they take turns.

    One call of each does not count. What else the machine does slows both sides of a round, and the least round least.
    """
    for work in works:
        work()
    times: list[list[float]] = [[] for _ in works]
    for _ in range(rounds):
        for work, row in zip(works, times, strict=True):
            start = process_time()
            for _ in range(repeats):
                work()
            row.append((process_time() - start) / repeats)
    return [min(row) for row in times]


def run(progress: Progress) -> tuple[Comparison, ...]:
    """Measure everything, one thing after the other."""
    from grape.experiments.bench_scene import build_scene

    progress(0.0, "building robot and vine")
    scene = build_scene()
    progress(0.2, "state checks")
    rows = [*state_checks(scene)]
    progress(0.4, "plans")
    rows += plans(scene, lambda share: progress(0.4 + 0.4 * share, "plans"))
    progress(0.8, "servo cycle")
    rows += servo_cycle(scene)
    progress(0.9, "clouds")
    return (*rows, *clouds(scene))


def state_checks(scene: BenchScene) -> list[Comparison]:
    """One state at a time from Python, and along motions as the planner checks them."""
    from grape.experiments.bench_peers import BROADPHASES, BroadphaseChecker

    rng = np.random.default_rng(1)
    states = scene.states(400, rng)
    checker = scene.checker
    said = np.array([checker.is_valid(q) for q in states])
    edges, count = _motions(checker, scene.free_states(40, rng))
    rows = []
    for name in BROADPHASES:
        peer = BroadphaseChecker(scene, name)
        agreement = float(np.mean(said == [peer.is_valid(q) for q in states]))
        if agreement < AGREEMENT:
            raise BenchError(f"our check and Pinocchio's {name} agree on {100 * agreement:.0f} % of the states only")
        single, along, theirs = seconds(
            partial(_check_all, checker.is_valid, states), edges, partial(_check_all, peer.is_valid, states), rounds=15
        )
        single, along, theirs = single / len(states), along / count, theirs / len(states)
        for what, ours in (("state check, one call", single), ("state check, along a motion", along)):
            rows.append(
                Comparison(
                    quantity=what, unit="µs", value=1e6 * ours, peer=f"Pinocchio, {name}", peer_value=1e6 * theirs,
                    ratio_goal=">= 20",
                )
            )  # fmt: skip
    return sorted(rows, key=lambda row: row.quantity, reverse=True)


def _check_all(is_valid: Callable[[Array], bool], states: Array) -> None:
    for q in states:
        is_valid(q)


def _motions(checker: StateChecker, states: Array) -> tuple[Callable[[], object], int]:
    """Checks of the motions between free states, the blocked ones up to where they are blocked; and how many states."""
    pairs = list(zip(states[::2], states[1::2], strict=True))
    before = checker.checked
    for a, b in pairs:
        checker.edge_valid(a, b)
    return lambda: [checker.edge_valid(a, b) for a, b in pairs], checker.checked - before


def plans(scene: BenchScene, progress: Callable[[float], None]) -> list[Comparison]:
    """First paths between free states that no straight motion joins; what either side cannot solve is left out."""
    from grape.experiments.bench_peers import PLAN_PEER, BroadphaseChecker, rrt_connect
    from grape.planning import JointPlanner

    whole, checker, rng = scene.robot.planner, scene.checker, np.random.default_rng(2)
    quick = replace(whole.options, attempts=1, simplify_steps=0)
    first = JointPlanner(whole.lower, whole.upper, whole.velocity, quick)
    peer, limits = BroadphaseChecker(scene, PLAN_PEER), whole.bounds()
    times: list[tuple[float, ...]] = []
    while len(times) < PLANS:
        start, goal = scene.free_states(2, rng)
        if checker.edge_valid(start, goal) or not (peer.is_valid(start) and peer.is_valid(goal)):
            continue
        seed = len(times) + 1
        search = partial(rrt_connect, start, goal, limits, peer.is_valid, quick.range_rad, seed)
        ours = [partial(_plan, planner, start, goal, checker, seed) for planner in (first, whole)]
        if all(work() for work in (search, *ours)):
            times.append(tuple(seconds(*ours, search, rounds=5)))
            progress(len(times) / PLANS)
    quickest, shortened, theirs = (1e3 * statistics.median(column) for column in zip(*times, strict=True))
    return [
        Comparison(
            quantity="first plan, median", unit="ms", value=quickest,
            peer=f"OMPL RRTConnect on Pinocchio, {PLAN_PEER}", peer_value=theirs, ratio_goal=">= 8",
        ),
        Comparison(quantity="plan of two searches, shortened, median", unit="ms", value=shortened),
    ]  # fmt: skip


def _plan(planner: JointPlanner, start: Array, goal: Array, checker: StateChecker, seed: int) -> bool:
    try:
        planner.plan(start, [goal], checker, np.random.default_rng(seed), absolute=True)
    except ActionFailed:
        return False
    return True


def servo_cycle(scene: BenchScene) -> list[Comparison]:
    """One beat of servoing on two markers, vision aside: control law, joint velocities, and a look at obstacles."""
    from grape.control import DifferentialIk, shift_twist
    from grape.experiments.bench_peers import jacobian_step, mink_step

    robot = scene.robot
    arm = robot.description.arm
    q = np.array(arm.poses["ready_left_fore"])
    T_base_hand = robot.hand_pose(q)
    T_base_camera = T_base_hand @ robot.description.mounts["camera_optical"].T_parent_sensor
    servo = _servo_near_its_end(T_base_camera)
    solver = DifferentialIk.for_arm(robot.arm, arm.velocity_max)
    careful = DifferentialIk.for_arm(robot.arm, arm.velocity_max, clearance=scene.checker.clearance)
    wish = shift_twist(servo.twist(NOW_S, T_base_camera), T_base_camera[:3, 3], T_base_hand[:3, 3])

    def beat() -> Array:
        hand = robot.hand_pose(q)
        camera = hand @ robot.description.mounts["camera_optical"].T_parent_sensor
        twist = shift_twist(servo.twist(NOW_S, camera), camera[:3, 3], hand[:3, 3])
        return careful.solve(q, twist).velocity

    step = mink_step(robot.description.mjcf, arm.joints, arm.tip_frame)
    name = "mink with daqp"
    if step is None:
        step, name = jacobian_step(robot.arm), "NumPy least squares on Pinocchio's Jacobian"
    velocity, theirs = solver.solve(q, wish).velocity, step(q, wish)
    if np.abs(velocity - theirs).max() > 0.02:
        raise BenchError(f"joint velocities differ: ours {velocity}, {name}: {theirs}")
    works = (beat, lambda: solver.solve(q, wish), lambda: step(q, wish))
    cycle_us, alone_us, peer_us = (1e6 * least for least in seconds(*works, repeats=100))
    return [
        Comparison(
            quantity="servo cycle: law, joint velocities, clearance", unit="µs",
            value=cycle_us, value_goal="<= 100",
        ),
        Comparison(
            quantity="joint velocities alone", unit="µs",
            value=alone_us, peer=name, peer_value=peer_us,
        ),
    ]  # fmt: skip


def _servo_near_its_end(T_base_camera: Array) -> MarkerServo:
    """A run on two markers 0.2 m before the camera, 5 mm beside where they should be."""
    from grape.control import MarkerServo
    from grape.control.features import marker_corners, project
    from grape.geometry import pose, transform

    K = np.array([[466.0, 0.0, 319.5], [0.0, 466.0, 239.5], [0.0, 0.0, 1.0]])
    flip = np.diag([1.0, -1.0, -1.0])
    views = {
        k: partial(lambda x, standoff: pose(flip, (x, 0.0, 0.2 + standoff)), x) for k, x in ((1, -0.06), (2, 0.06))
    }
    servo = MarkerServo(views, 0.04, K)
    seen = {}
    for k, view in views.items():
        corners = transform(view(0.05) @ pose(translation=(0.005, 0.003, 0.0)), marker_corners(0.04))
        seen[k] = project(corners) * 466.0 + np.array([319.5, 239.5])
    servo.update(1.0, seen, T_base_camera)
    servo.twist(1.0, T_base_camera)  # a run starts from standing
    return servo


def clouds(scene: BenchScene) -> list[Comparison]:
    """From points to deployment poses, and voxels beside Open3D's."""
    from grape.experiments.bench_peers import open3d_voxels
    from grape.perception.cloud import voxel_grid
    from grape.tasks.dispenser.perception.spurs import extract_poses

    points = scene.vine
    voxels = open3d_voxels(points, 0.005)
    counts = len(voxel_grid(points, 0.005)), voxels()
    if abs(counts[0] - counts[1]) > 0.05 * counts[1]:
        raise BenchError(f"voxels: ours {counts[0]}, Open3D's {counts[1]}")
    poses_s, ours_s, theirs_s = seconds(
        lambda: extract_poses(points, scene.eyes), lambda: voxel_grid(points, 0.005), voxels
    )
    return [
        Comparison(
            quantity=f"{len(points) // 1000}k points to deployment poses", unit="ms",
            value=1e3 * poses_s, value_goal="<= 150",
        ),
        Comparison(
            quantity=f"voxel grid of {len(points) // 1000}k points", unit="ms",
            value=1e3 * ours_s, peer="Open3D", peer_value=1e3 * theirs_s,
        ),
    ]  # fmt: skip


BENCH = Bench(
    name="manipulation",
    summary="Checks of arm states, plans, a servo cycle and clouds beside Pinocchio, OMPL, mink and Open3D.",
    run=run,
)
