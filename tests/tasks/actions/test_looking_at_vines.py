"""Parking beside a plant, scanning a vine, and finding where a dispenser can hang."""

from __future__ import annotations

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.obstacles import OBSTACLES
from grape.errors import Reason
from grape.geometry import transform
from grape.tasks.dispenser.actions.drive_to_plant import PARKED, DriveToPlantGoal, drive_to_plant
from grape.tasks.dispenser.actions.find_deployment_points import FindDeploymentPointsGoal, find_deployment_points
from grape.tasks.dispenser.actions.scan_vine import ScanVineGoal, scan_vine

SHORT = ScanVineGoal(plant="n0", half_length_m=0.10)


def park_at(bench: Bench, plant: str) -> None:
    """Stand where `n0` is reached, but with a vine there."""
    x = bench.site.plant("n0").position[0] - bench.site.plant(plant).position[0]
    bench.base.pose = bench.base.pose - [x, 0.0, 0.0]
    bench.advance()


def test_robot_parks_with_the_plant_fore_of_the_arm(bench: Bench) -> None:
    bench.base.pose = np.array([-1.0, -0.955, 0.0])
    bench.advance(20)
    bench.world.committed[OBSTACLES] = "of the stop before"
    bench.run(drive_to_plant(DriveToPlantGoal(plant="n0"), bench.ctx))
    place = transform(np.linalg.inv(bench.base.T_map_base), np.array([*bench.site.plant("n0").position, 0.0]))
    assert place[0] - 0.25 == pytest.approx(0.22, abs=0.03)
    assert place[1] - 0.335 == pytest.approx(0.62, abs=0.03)
    assert bench.world.committed == {PARKED: ("n0", "fore")}, "what was seen from the last stop is forgotten"
    assert bench.ctx.base.owner is None and (bench.base.v, bench.base.w) == (0.0, 0.0)


def test_called_again_it_takes_the_other_stop(bench: Bench) -> None:
    bench.world.committed[PARKED] = ("n0", "fore")
    bench.run(drive_to_plant(DriveToPlantGoal(plant="n0"), bench.ctx))
    assert bench.world.committed[PARKED] == ("n0", "aft")
    assert bench.site.plant("n0").position[0] - bench.base.pose[0] == pytest.approx(0.25 - 0.22, abs=0.03)


def test_a_drive_that_fails_leaves_no_stop_behind(bench: Bench) -> None:
    bench.world.committed[PARKED] = ("n0", "fore")
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


def test_a_vine_without_spurs_has_no_deployment_point(bench: Bench) -> None:
    park_at(bench, "v0")
    scan = bench.run(scan_vine(ScanVineGoal(plant="v0", half_length_m=0.10), bench.ctx)).scan
    failure = bench.failure(find_deployment_points(FindDeploymentPointsGoal(plant="v0", scan=scan), bench.ctx))
    assert failure.reason is Reason.NO_DEPLOYMENT_POINT and "v0" in failure.detail
