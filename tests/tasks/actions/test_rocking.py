"""A base that rocks on its wheels under the arm: what was seen before is followed to where it is now."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.obstacles import OBSTACLES, Obstacles, recall_obstacles, remember_obstacles
from grape.actions.rocking import follow_rocking, rocking, up_in_base
from grape.geometry import inverse, pose, pose_error, rotation_from_rpy, rotation_z, transform
from grape.messages import Array
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.actions.approach_spur import ApproachSpurGoal, approach_spur
from grape.tasks.dispenser.targets import HangTarget

FOOT = pose(None, (0.0, 0.0, -DESCRIPTION.base.height))
ROCKED = rotation_from_rpy(0.047, -0.049, 0.0)  # seed 764, as the arm reached out with a dispenser


@pytest.fixture
def rock(bench: Bench, monkeypatch: pytest.MonkeyPatch):
    """Turns the base by `R` (3, 3) in its own axes about where it stands."""
    standing = type(bench.base).T_map_base.fget

    def turn(R: Array) -> None:
        about_foot = FOOT @ pose(R) @ inverse(FOOT)
        monkeypatch.setattr(type(bench.base), "T_map_base", property(lambda base: standing(base) @ about_foot))
        bench.advance()

    return turn


def in_map(bench: Bench, points: Array) -> Array:
    return transform(bench.base.T_map_base, points)


def spur_seen(bench: Bench, task: SimpleNamespace) -> HangTarget:
    return replace(task.spur_target(bench), up=up_in_base(bench.ctx))


def test_what_was_seen_stays_where_it_is_on_the_ground(bench: Bench, rock) -> None:
    cloud = np.array([[0.4, 0.9, 0.7], [-0.3, 0.8, 0.2]])
    seen = Obstacles(cloud, up=up_in_base(bench.ctx))
    bench.world.committed[OBSTACLES] = seen
    before = in_map(bench, cloud)
    rock(ROCKED)
    assert np.linalg.norm(in_map(bench, cloud) - before, axis=1).min() > 0.03
    follow_rocking(bench.ctx)
    followed = bench.world.committed[OBSTACLES]
    assert in_map(bench, followed.cloud) == pytest.approx(before, abs=0.002)
    follow_rocking(bench.ctx)
    assert bench.world.committed[OBSTACLES] is followed, "once"
    rock(np.eye(3))
    follow_rocking(bench.ctx)
    assert bench.world.committed[OBSTACLES].cloud == pytest.approx(cloud, abs=1e-9), "and back"


@pytest.mark.parametrize("R", [np.eye(3), rotation_from_rpy(0.005, 0.005, 0.0), rotation_z(0.3)])
def test_a_base_that_stands_still_or_turns_about_the_vertical_has_not_rocked(bench: Bench, rock, R: Array) -> None:
    up = up_in_base(bench.ctx)
    rock(R)
    assert rocking(bench.ctx, up) is None


def test_where_nobody_knows_how_the_base_stood_nothing_is_moved(bench: Bench, rock) -> None:
    seen = bench.world.committed[OBSTACLES] = Obstacles(np.zeros((1, 3)))
    rock(ROCKED)
    follow_rocking(bench.ctx)
    assert bench.world.committed[OBSTACLES] is seen
    assert rocking(bench.ctx, None) is None
    up = up_in_base(bench.ctx)
    bench.world.odometry = None
    assert up_in_base(bench.ctx) is None and rocking(bench.ctx, up) is None


@pytest.mark.parametrize("after_s", [0.0, 0.8])
def test_the_hand_goes_to_where_the_spur_is_after_the_base_has_rocked(
    bench: Bench, task: SimpleNamespace, rock, after_s: float
) -> None:
    target = spur_seen(bench, task)
    tip = in_map(bench, target.tip[None])[0]
    begin, result = bench.now(), None
    run = approach_spur(ApproachSpurGoal(target=target), bench.ctx)
    rocked = False
    while result is None:
        try:
            next(run)
        except StopIteration as end:
            result = end.value.approached
        bench.advance()
        if not rocked and bench.now() - begin > after_s:
            rock(ROCKED)
            rocked = True
    assert in_map(bench, result.tip[None])[0] == pytest.approx(tip, abs=0.002)
    nails = bench.robot.hand.T_hand_nails(DESCRIPTION.gripper.open_angle)
    error = pose_error(result.hand_pose(nails, 0.10), bench.hand)
    assert np.linalg.norm(error[:3]) < 0.01 and np.linalg.norm(error[3:]) < 0.03
    assert np.linalg.norm(target.hand_pose(nails, 0.10)[:3, 3] - bench.hand[:3, 3]) > 0.03


def test_how_the_base_stood_survives_the_ledger(bench: Bench, task: SimpleNamespace) -> None:
    target = spur_seen(bench, task)
    bench.ledger.remember("seen", target.as_record())
    recalled = HangTarget(**bench.ledger.recall("seen"))
    assert recalled.up == pytest.approx(target.up) and recalled.tip == pytest.approx(target.tip)


def test_what_was_seen_before_an_interruption_follows_a_base_that_rocks_after_it(bench: Bench, rock) -> None:
    cloud = np.array([[0.4, 0.9, 0.7], [-0.3, 0.8, 0.2]])
    remember_obstacles(bench.ctx, Obstacles(cloud, up=up_in_base(bench.ctx)))
    before = in_map(bench, cloud)
    bench.world.committed[OBSTACLES] = recall_obstacles(bench.ctx)
    rock(ROCKED)
    follow_rocking(bench.ctx)
    assert in_map(bench, bench.world.committed[OBSTACLES].cloud) == pytest.approx(before, abs=0.002)
