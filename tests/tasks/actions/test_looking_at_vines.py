"""Parking beside a plant, scanning a vine, and finding where a dispenser can hang."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from paper_robot import Bench
from paper_scene import INFO, K

from grape.actions.obstacles import OBSTACLES
from grape.errors import Reason
from grape.geometry import pose, transform
from grape.messages import RgbdImage
from grape.perception.sweep import Sweep
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.drive_to_plant import PARKED, DriveToPlantGoal, drive_to_plant
from grape.tasks.dispenser.actions.find_deployment_points import (
    FindDeploymentPointsGoal,
    find_deployment_points,
    fuse,
    look,
    not_in,
    vine_box,
)
from grape.tasks.dispenser.actions.scan_vine import ScanVineGoal, VineScan, scan_vine, sweep_path
from grape.tasks.dispenser.stops import margins_of, orientations
from grape.tasks.dispenser.sweep_guard import SweepGuard
from grape.tasks.dispenser.targets import HangTarget, remember_spurs

SHORT = ScanVineGoal(plant="n0", half_length_m=0.10, return_pitch=0.0)


def park_at(bench: Bench, plant: str) -> None:
    """Stand where `n0` is reached, but with a vine there."""
    x = bench.site.plant("n0").position[0] - bench.site.plant(plant).position[0]
    bench.base.pose = bench.base.pose - [x, 0.0, 0.0]
    bench.advance()


def stands(bench: Bench, plant: str) -> tuple[float, float]:
    """How far the plant is before the arm's base, and the row from the robot's left side."""
    x, y, _ = transform(np.linalg.inv(bench.base.T_map_base), np.array([*bench.site.plant(plant).position, 0.0]))
    return x - 0.25, y - 0.335


def test_robot_parks_where_the_arm_reaches_the_nail_with_room_to_spare(bench: Bench) -> None:
    bench.base.pose = np.array([-1.0, -0.955, 0.0])
    bench.advance(20)
    bench.world.committed[OBSTACLES] = "of the stop before"
    bench.run(drive_to_plant(DriveToPlantGoal(plant="n0"), bench.ctx))
    assert stands(bench, "n0") == pytest.approx((0.30, 0.62), abs=0.03), "abreast of the arm a level hand is singular"
    assert bench.world.committed == {PARKED: ("n0", 0.30, 0.62)}, "what was seen from the last stop is forgotten"
    assert bench.ctx.base.owner is None and (bench.base.v, bench.base.w) == (0.0, 0.0)


def test_called_again_it_takes_another_stop(bench: Bench) -> None:
    bench.world.committed[PARKED] = ("n0", 0.30, 0.62)
    bench.run(drive_to_plant(DriveToPlantGoal(plant="n0"), bench.ctx))
    assert bench.world.committed[PARKED][:2] == ("n0", -0.30)
    assert stands(bench, "n0")[0] == pytest.approx(-0.30, abs=0.03)


def test_the_other_stop_is_chosen_by_the_spurs_that_were_found(bench: Bench) -> None:
    park_at(bench, "v0")
    bench.world.committed[PARKED] = ("v0", 0.22, 0.62)
    far = HangTarget(
        plant="v0", kind="spur", tip=np.array([1.05, 0.955, 0.75]), direction=np.array([0.0, 0.0, 1.0]), pitch=1.0
    )
    remember_spurs(bench.ctx, [far])
    assert margins_of(bench.robot, orientations(far)).max() == 0.0
    tip = transform(bench.base.T_map_base, far.tip)
    bench.run(drive_to_plant(DriveToPlantGoal(plant="v0"), bench.ctx))
    near = replace(far, tip=transform(np.linalg.inv(bench.base.T_map_base), tip))
    assert margins_of(bench.robot, orientations(near)).max() > 0.5, "it drove up to the spur"
    assert bench.ledger.recall("spurs") is None, "they hold for the stop before alone"


def test_a_drive_that_fails_leaves_no_stop_behind(bench: Bench) -> None:
    bench.world.committed[PARKED] = ("n0", 0.30, 0.62)
    bench.scanners["front_laser"].silent = True
    assert bench.failure(drive_to_plant(DriveToPlantGoal(plant="v0"), bench.ctx)).reason is Reason.STALE_DATA
    assert PARKED not in bench.world.committed


def test_sweep_gathers_scans_and_frames_in_base_link(bench: Bench) -> None:
    lidar = bench.scanners["wrist_lidar"]
    lidar.ranges = np.full(361, 0.5)
    scan = bench.run(scan_vine(SHORT, bench.ctx)).scan
    assert 4 <= len(scan.images) <= SHORT.images
    assert len(scan.T_base_camera) == len(scan.images)
    stamps = [image.stamp for image in scan.images]
    assert stamps == sorted(set(stamps))
    x = [T[0, 3] for T in scan.T_base_camera]
    assert max(x) - min(x) > 0.10 and (np.diff(x) > 0).all() | (np.diff(x) < 0).all(), "along the row, one way"
    turned = [T[:3, :3] for T in scan.T_base_camera]
    assert max(np.abs(R - turned[0]).max() for R in turned) < 0.02, "at constant orientation"
    assert scan.sweep.points[:, 1].max() > 0.5, "towards the row"
    assert scan.sweep.ranges == pytest.approx(0.5)
    assert bench.ctx.arm.owner is None and bench.log.last("scan")["plant"] == "n0"


def test_a_sweep_that_leads_away_from_its_end_is_broken_off(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    send, backwards = bench.arm.send, [False]
    monkeypatch.setattr(bench.arm, "send", lambda velocity: send(-velocity if backwards[0] else velocity))

    def watched():
        for feedback in scan_vine(SHORT, bench.ctx):
            backwards[0] = feedback.status == "scanning" and (feedback.progress or 0.0) > 0.3
            yield feedback

    failure = bench.failure(watched())
    assert failure.reason is Reason.DISTANCE_GROWS
    assert not bench.arm.velocity.any() and bench.ctx.arm.owner is None


def test_the_way_back_looks_farther_down(bench: Bench) -> None:
    goal = ScanVineGoal(plant="n0", half_length_m=0.10)
    scan = bench.run(scan_vine(goal, bench.ctx)).scan
    x, down = (np.array([T[k, 3 - k // 2] for T in scan.T_base_camera]) for k in (0, 2))
    turn = int(np.argmax(np.abs(x - x[0])))
    assert 2 < turn < len(x) - 2 and abs(x[-1] - x[0]) < 0.05, "forth and back"
    steep, level = sorted((down[:2].mean(), down[-2:].mean()))
    assert np.degrees(np.arcsin(level) - np.arcsin(steep)) == pytest.approx(20, abs=3)


@pytest.mark.parametrize("row_y", [0.86, 0.955, 1.05])
def test_a_sweep_takes_at_most_fifteen_seconds_and_keeps_off_the_arm(row_y: float) -> None:
    T_base_arm = pose(None, (0.25, 0.20, 0.458))
    path = sweep_path(ScanVineGoal(plant="n0"), T_base_arm, row_y)
    assert path.times[-1] <= 15.0 and len(path.poses) == len(path.times) == 4
    assert min(T[1, 3] for T in path.poses) >= 0.42
    back = path.backwards()
    for t in np.linspace(0.0, path.times[-1], 7):
        np.testing.assert_allclose(back.at(path.times[-1] - t), path.at(t), atol=1e-9)


def swept(bench: Bench, top: float, goal: ScanVineGoal) -> tuple[np.ndarray, float, VineScan]:
    """Scans a vine of which wood stands upright before the row, in the hand's way, up to a height (m in base_link).

    Returns the places of the hand (n, 3), its least distance to the wood, and the scan.
    """
    park_at(bench, "v0")
    foot, tip = np.array([0.45, 0.75, 0.50]), np.array([0.45, 0.75, top])
    bench.scene.rods = [(foot, tip, 0.008)]
    wood = SweepGuard(bench.robot.body)
    wood.add(np.repeat(foot + np.linspace(0.0, 1.0, 80)[:, None] * (tip - foot), 9, axis=0), np.eye(4))
    places, gaps, run = [], [], scan_vine(goal, bench.ctx)
    while True:
        try:
            feedback = next(run)
        except StopIteration as stop:
            return np.array(places), min(gaps) - 0.008, stop.value.scan
        bench.advance()
        if feedback.status in ("scanning", "passing over wood"):
            T = bench.robot.hand_pose(bench.world.joints())
            places.append(T[:3, 3])
            gaps.append(wood.clearance(T[None]))


def lifts(bench: Bench) -> list[float | None]:
    return [fields["lift_m"] for kind, fields in bench.log.events if kind == "sweep_hindered"]


LEVEL_TWICE = ScanVineGoal(plant="v0", return_pitch=np.radians(79.0), return_stand_off_m=0.44, return_height_m=0.40)


def test_sweep_goes_higher_over_wood_that_reaches_out(bench: Bench) -> None:
    places, gap, scan = swept(bench, 0.79, ScanVineGoal(plant="v0"))
    (lift,) = lifts(bench)
    assert lift is not None and 0.02 <= lift <= 0.08 and gap > 0.01
    assert np.ptp(places[:, 0]) == pytest.approx(0.68, abs=0.03) and len(scan.images) > 8, "all of the way"


def test_sweep_turns_back_before_wood_that_is_too_high_to_pass(bench: Bench) -> None:
    places, gap, scan = swept(bench, 1.0, LEVEL_TWICE)
    assert lifts(bench)[-1] is None and gap > 0.01
    assert 0.2 < np.ptp(places[:, 0]) < 0.6 and abs(places[-1, 0] - places[0, 0]) < 0.03, "forth and back on one side"
    assert len(scan.images) > 8, "all frames of a whole sweep"


def test_sweep_ends_before_such_wood_in_its_last_pass(bench: Bench) -> None:
    places, gap, scan = swept(bench, 1.0, ScanVineGoal(plant="v0"))
    assert lifts(bench) == [None] and gap > 0.01
    assert np.ptp(places[:, 0]) == pytest.approx(0.68, abs=0.03) and places[-1, 0] > 0.5 and len(scan.images) > 4


def test_lidar_sees_what_is_too_near_for_the_camera(bench: Bench) -> None:
    ranges = np.full(361, np.inf)
    ranges[170:190] = 0.15
    bench.scanners["wrist_lidar"].ranges = ranges
    park_at(bench, "v0")
    bench.run(scan_vine(ScanVineGoal(plant="v0", return_pitch=0.0), bench.ctx))
    assert lifts(bench)


def test_wood_behind_the_reach_of_the_hand_hinders_no_sweep(bench: Bench) -> None:
    park_at(bench, "v0")
    bench.scene.rods = [(np.array([0.45, 0.955, 0.50]), np.array([0.45, 0.87, 0.80]), 0.008)]
    bench.run(scan_vine(ScanVineGoal(plant="v0"), bench.ctx))
    assert not lifts(bench)


@pytest.mark.parametrize("t", [0.0, 7.0, 10.0])
def test_a_sweep_can_be_turned_back_in_its_first_pass_alone(t: float) -> None:
    path = sweep_path(ScanVineGoal(plant="n0"), pose(None, (0.25, 0.20, 0.458)), 0.955)
    back = path.turned_back(2.0)
    assert back is not None and back.times[-1] < path.times[-1] - 4.0
    np.testing.assert_allclose(back.at(0.0), path.at(2.0), atol=1e-9)
    assert back.poses[1][0, 3] == pytest.approx(path.at(2.0)[0, 3], abs=1e-9)
    np.testing.assert_allclose(back.at(back.times[-1]), path.poses[-1], atol=1e-9)
    assert path.turned_back(t) is None


def test_sweep_without_lidar_keeps_the_frames(bench: Bench) -> None:
    bench.scanners["wrist_lidar"].silent = True
    scan = bench.run(scan_vine(SHORT, bench.ctx)).scan
    assert len(scan.sweep.points) == 0 and len(scan.images) >= 4


def test_sweep_in_which_nothing_was_measured_is_stale(bench: Bench) -> None:
    bench.scanners["wrist_lidar"].silent = bench.camera.silent = True
    assert bench.failure(scan_vine(SHORT, bench.ctx)).reason is Reason.STALE_DATA


def test_sweep_out_of_reach_is_unreachable(bench: Bench) -> None:
    goal = ScanVineGoal(plant="n0", half_length_m=1.5)
    assert bench.failure(scan_vine(goal, bench.ctx)).reason is Reason.UNREACHABLE


def test_spurs_of_a_scanned_vine_become_reachable_targets(bench: Bench) -> None:
    park_at(bench, "v0")
    spurs = [np.array([x, 0.93, 0.56]) for x in (0.30, 0.50, 0.70)]
    bench.scene.rods = [(np.array([-0.2, 0.955, 0.44]), np.array([1.2, 0.955, 0.44]), 0.02)]
    bench.scene.rods += [(np.array([tip[0], 0.955, 0.44]), tip, 0.006) for tip in spurs]
    scan = bench.run(scan_vine(ScanVineGoal(plant="v0"), bench.ctx)).scan
    found = bench.run(find_deployment_points(FindDeploymentPointsGoal(plant="v0", scan=scan), bench.ctx)).targets
    assert found
    for target in found:
        assert target.plant == "v0" and target.kind == "spur"
        assert min(np.linalg.norm(target.tip - tip) for tip in spurs) < 0.03
    assert [t.score for t in found] == sorted((t.score for t in found), reverse=True)
    assert len(bench.world.committed[OBSTACLES].cloud) > 100


def test_what_was_seen_near_the_hand_is_an_obstacle_where_the_frames_show_nothing() -> None:
    cloud = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    near = np.array([[0.02, 0.0, 0.0], [0.5, 0.0, 0.0]])
    np.testing.assert_array_equal(not_in(cloud, near), near[1:])
    assert len(not_in(cloud, near[:0])) == 0 and len(not_in(cloud[:0], near)) == 2


def test_wood_too_near_for_the_camera_stays_an_obstacle(bench: Bench) -> None:
    park_at(bench, "v0")
    ranges = np.full(361, np.inf)
    ranges[170:190] = 0.15
    bench.scanners["wrist_lidar"].ranges = ranges
    scan = bench.run(scan_vine(ScanVineGoal(plant="v0", return_pitch=0.0), bench.ctx)).scan
    assert len(scan.near)
    failure = bench.failure(find_deployment_points(FindDeploymentPointsGoal(plant="v0", scan=scan), bench.ctx))
    assert failure.reason is Reason.NO_DEPLOYMENT_POINT, "there is no vine"
    gaps = np.linalg.norm(bench.world.committed[OBSTACLES].cloud[:, None] - scan.near[None, :40], axis=2).min(axis=0)
    assert gaps.max() < 0.03


@pytest.mark.parametrize("holding", [False, True])
def test_a_held_dispenser_is_no_wood(holding: bool) -> None:
    T_hand_camera = DESCRIPTION.mounts["camera_optical"].T_parent_sensor
    end_of_loop, wood = np.array([0.01, -0.15, -0.27]), np.array([0.05, -0.05, -0.60])
    depth = np.zeros((INFO.height, INFO.width), np.float32)
    for point in transform(np.linalg.inv(T_hand_camera), np.array([end_of_loop, wood])):
        u, v = np.rint(K[:2] @ point / point[2]).astype(int)
        depth[v - 3 : v + 4, u - 3 : u + 4] = point[2]
    bgr = np.zeros((INFO.height, INFO.width, 3), np.uint8)
    image = RgbdImage(stamp=0.0, frame_id="camera_optical", bgr=bgr, depth=depth, info=INFO)
    scan = VineScan(
        sweep=swept_spurs()[0], images=(image,), T_base_camera=(T_hand_camera,), T_hand_camera=T_hand_camera,
        holding=holding,
    )  # fmt: skip
    points = look(scan, 0, (np.full(3, -1.0), np.full(3, 1.0))).points
    assert np.linalg.norm(points - wood, axis=1).min() < 0.01
    assert (np.linalg.norm(points - end_of_loop, axis=1).min() > 0.1) == holding


def test_lidar_fills_in_beside_the_frames_and_is_enough_alone() -> None:
    sweep, tips = swept_spurs()
    nothing = VineScan(sweep=sweep, images=(), T_base_camera=(), T_hand_camera=np.eye(4))
    box = vine_box(FindDeploymentPointsGoal(plant="v0", scan=nothing), np.array([0.5, 0.955]), 0.132)
    alone, cloud = fuse([], sweep, box)
    assert len(alone) == 2 and len(cloud) > 500
    for tip in tips:
        assert min(np.linalg.norm(pose.tip - tip) for pose in alone) < 0.02


def swept_spurs() -> tuple[Sweep, list[np.ndarray]]:
    """A cordon with two spurs in the box of the vine and one on the neighbour, as a LiDAR at y = 0.5 sweeps it."""
    rng, xs, tips = np.random.default_rng(0), (0.3, 0.6, 1.2), []
    rods = [((0.0, 0.955, 0.65), (1.4, 0.955, 0.65), 0.018, 12000)]
    for x in xs:
        tips.append(np.array([x, 0.955, 0.80]))
        rods += [((x, 0.955, 0.65), (x, 0.955, 0.69), 0.012, 500), ((x, 0.955, 0.69), tips[-1], 0.005, 900)]
    parts = []
    for start, end, radius, n in rods:
        axis = (np.array(end) - start) / np.linalg.norm(np.subtract(end, start))
        side, angle = np.cross(axis, [0.0, 1.0, 0.0]), rng.uniform(-1.4, 1.4, (n, 1))
        around = np.sin(angle) * side - np.cos(angle) * np.array([0.0, 1.0, 0.0])
        parts.append(start + rng.uniform(0, 1, (n, 1)) * np.subtract(end, start) + radius * around)
    points = np.vstack(parts)
    origins = np.column_stack([points[:, 0], np.full(len(points), 0.5), np.full(len(points), 0.85)])
    rays = points - origins
    scan = np.floor(points[:, 0] / 0.005).astype(int)
    beam = np.floor(np.arctan2(rays[:, 2], rays[:, 1]) / np.radians(1 / 3)).astype(int)
    _, pick = np.unique(np.column_stack([scan, beam]), axis=0, return_index=True)
    ranges = np.linalg.norm(rays, axis=1)
    kept = (points[pick], origins[pick], ranges[pick], scan[pick], beam[pick])
    return Sweep(points=kept[0], origins=kept[1], ranges=kept[2], scan=kept[3], beam=kept[4]), tips[:2]


def test_a_vine_without_spurs_has_no_deployment_point(bench: Bench) -> None:
    park_at(bench, "v0")
    scan = bench.run(scan_vine(ScanVineGoal(plant="v0", half_length_m=0.10), bench.ctx)).scan
    failure = bench.failure(find_deployment_points(FindDeploymentPointsGoal(plant="v0", scan=scan), bench.ctx))
    assert failure.reason is Reason.NO_DEPLOYMENT_POINT and "v0" in failure.detail
