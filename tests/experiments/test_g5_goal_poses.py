"""Row G5-goal: the vineyards it draws, how a drive is judged, what it counts, and going on after a stop."""

from __future__ import annotations

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

os.environ.setdefault("MUJOCO_GL", "egl")

from grape.actions.drive_to_pose import PURE_PURSUIT, DriveGoal
from grape.actions.shortest_way import footprint_of, site_surroundings
from grape.errors import Reason
from grape.experiments import g5_goal_poses as g5
from grape.experiments.base_bench import BaseBench, Driven
from grape.experiments.g5_goal_poses import GoalDrive, quantities
from grape.experiments.goal_vineyards import VEHICLE_M, VEHICLE_RADIUS_M, tour
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.areas import polygons_touch
from grape.sim.worlds import VineyardOptions, generate_vineyard

FOOTPRINT = footprint_of(DESCRIPTION.base.footprint)
FINE = Driven(
    reached=True, reason="", detail="", along_m=0.03, across_m=-0.02, yaw_deg=-1.5, estimate_off_m=0.01,
    estimate_off_deg=0.3, time_s=20.0, touched=(), fences=0, recoveries=(),
)  # fmt: skip


def drive(driven=FINE, kind="row change", slope_deg=7.0, occupied=True):
    return GoalDrive(seed=1, kind=kind, plant="r1v2", slope_deg=slope_deg, occupied=occupied, driven=driven)


def figure(drives, name):
    return next(q for q in quantities(drives) if q.name.startswith(name))


@pytest.mark.parametrize(
    "change",
    [{"along_m": 0.046}, {"yaw_deg": 2.01}, {"reached": False}, {"touched": [("base", "r0v1")]}, {"fences": 1}],
)
def test_a_drive_succeeds_near_its_goal_with_nothing_touched_and_no_fence_entered(change):
    assert drive().success
    assert not drive(replace(FINE, **change)).success


def test_errors_are_of_drives_that_arrived_and_rates_of_all():
    lost = replace(FINE, reached=False, along_m=3.0)
    drives = [*(drive(replace(FINE, along_m=0.001 * k, across_m=0.0)) for k in range(41)), drive(lost)]
    off = figure(drives, "off the goal, 95th percentile")
    assert off.n == 41 and off.value == pytest.approx(0.038) and off.met and off.ci95[0] < 0.038 < off.ci95[1]
    assert figure(drives, "drives that succeeded").value == pytest.approx(41 / 42)


def test_slopes_and_the_occupied_lane_are_counted_apart():
    bad = replace(FINE, yaw_deg=3.0)
    drives = [
        drive(), drive(bad), drive(slope_deg=-6.0, occupied=False), drive(bad, slope_deg=2.0, occupied=False),
        drive(kind="turn round"), drive(kind="row entry"),
    ]  # fmt: skip
    steep, passing = figure(drives, "changes of row and turns"), figure(drives, "changes of row past")
    assert (steep.value, steep.n) == (0.75, 4) and (passing.value, passing.n) == (0.5, 2)
    assert figure(drives, "row change: succeeded").value == 0.5


def test_nothing_was_driven_yet():
    assert figure([], "off the goal, 95th percentile").value is None
    assert figure([], "drives that succeeded").ci95 == (0.0, 1.0)


def test_odd_seeds_are_steep_and_two_of_four_have_a_vehicle():
    for seed in range(4):
        place = tour(seed, DESCRIPTION, PURE_PURSUIT)
        steepness = abs(place.slope_deg)
        assert 5.0 <= steepness <= 10.0 if seed % 2 else steepness <= 3.0
        assert np.degrees(np.arctan(place.world.terrain.slope)) == pytest.approx(place.slope_deg)
        assert (place.vehicle is not None) == (seed % 4 >= 2)
        assert tuple(task.kind for task in place.tasks) == g5.KINDS


def test_goals_keep_clear_of_fences_and_of_the_vehicle_which_stands_on_the_ground():
    for seed in (2, 7):
        place = tour(seed, DESCRIPTION, PURE_PURSUIT)
        for task in place.tasks:
            pose = np.array([task.goal.x, task.goal.y, task.goal.yaw])
            assert not site_surroundings(place.world.site, pose[None], DESCRIPTION.base).in_fence(pose)
            assert not polygons_touch(FOOTPRINT.corners(pose), place.vehicle)
        for fence in place.world.site.fences:
            assert not polygons_touch(place.vehicle, fence.polygon)
        rods = [c for c in place.world.capsules if c.name.startswith("vehicle/")]
        ends = [(end, rod.radius) for rod in rods for end in (rod.p0, rod.p1)]
        over_ground = [end[2] - radius - place.world.terrain.height(end[:2]) for end, radius in ends]
        assert min(over_ground) == pytest.approx(0.15)
        assert np.ptp([end[0] for end, _ in ends]) + 2 * VEHICLE_RADIUS_M == pytest.approx(VEHICLE_M)


def test_what_was_driven_is_read_and_a_stop_shows_it(tmp_path, monkeypatch):
    driven = []

    def pretend(seed, planner=PURE_PURSUIT):
        driven.append(seed)
        if len(driven) == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return [replace(drive(), seed=seed, kind=kind) for kind in g5.KINDS]

    monkeypatch.setattr(g5, "drive_tour", pretend)
    stopped = g5.EXPERIMENT.run(range(4), tmp_path, lambda fraction, sentence: None)
    assert not stopped.complete and driven == [0, 1] and stopped.quantities[0].n == 8
    done = g5.EXPERIMENT.run(range(4), tmp_path, lambda fraction, sentence: None)
    assert done.complete and driven == [0, 1, 2, 3] and done.quantities[0].n == 16
    assert all(figure.svg.count("<svg") == 1 for figure in done.figures) and len(done.figures) == 5


def test_a_drive_in_physics_is_judged_by_the_truth_and_not_by_the_estimate():
    world = generate_vineyard(VineyardOptions(seed=3, rows=1, vines_per_row=2, weeds=0.0, nails_per_row=0))
    x, y = world.site.start
    with BaseBench(DESCRIPTION, world, 3) as bench:
        driven = bench.drive(DriveGoal(x=x + 0.5, y=y, yaw=0.0))
        assert driven.reached and driven.off_m < 0.06 and not driven.touched and not driven.fences
        true, said = bench.true_pose(), bench.estimate()
        assert driven.off_m == pytest.approx(np.hypot(true[0] - x - 0.5, true[1] - y), abs=1e-9)
        assert driven.estimate_off_m == pytest.approx(np.hypot(*(true - said)[:2])) and driven.estimate_off_m > 1e-4
        refused = bench.drive(DriveGoal(x=0.0, y=0.0, yaw=0.0))
        assert not refused.reached and refused.reason == Reason.FENCE and refused.off_m > 1.0
