from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import pose as make_pose
from grape.messages import LaserScan
from grape.navigation.collision_monitor import (
    APPROACH,
    CollisionMonitor,
    CollisionOptions,
    Decision,
    MonitorState,
    Verdict,
    in_polygon,
    scan_hits,
    time_to_touch,
)
from grape.navigation.grid import Footprint
from grape.robots import SafetyZone
from grape.robots.husky_jaco2 import DESCRIPTION

OPTIONS = CollisionOptions(footprint=Footprint(front=0.495, rear=0.495, half_width=0.343))
START = MonitorState()


def cluster(x: float, y: float) -> np.ndarray:
    """Five points (5, 2) within a centimetre."""
    return np.array([x, y]) + 0.01 * np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0.5]])


@pytest.fixture
def monitor() -> CollisionMonitor:
    return CollisionMonitor(DESCRIPTION.base.zones, OPTIONS)


def judge(monitor: CollisionMonitor, v: float, w: float, points: np.ndarray, **more) -> Decision:
    return monitor.decide(v, w, points, more.get("now", 10.0), more.get("state", START))


def test_free_way_changes_nothing(monitor):
    decision = judge(monitor, 0.8, 0.2, cluster(2.5, 0.0))
    assert (decision.verdict, decision.factor, decision.zone, decision.point) == (Verdict.GO, 1.0, "", None)
    assert decision.state == START


def test_stop_zone_stops_whoever_drives_towards_it_and_tells_where(monitor):
    decision = judge(monitor, 0.1, 0.0, cluster(0.55, 0.3))
    assert (decision.verdict, decision.factor, decision.zone) == (Verdict.STOP, 0.0, "stop ahead")
    assert decision.point == pytest.approx((0.55, 0.3), abs=0.011)
    assert judge(monitor, -0.2, 0.0, cluster(0.55, 0.3)).factor == 1.0, "away from it"


def test_slow_zone_limits_the_speed_and_not_the_factor(monitor):
    ahead = cluster(0.9, 0.0)
    fast, slow = judge(monitor, 0.6, 0.1, ahead), judge(monitor, 0.2, 0.1, ahead)
    assert (fast.verdict, fast.zone) == (Verdict.SLOW, "slow ahead") and fast.factor == pytest.approx(0.5)
    assert slow.factor == 1.0


def test_approach_keeps_the_time_to_contact():
    contact_s, point = time_to_touch(0.9, 0.0, cluster(1.0, 0.0), OPTIONS)
    decision = judge(CollisionMonitor([], OPTIONS), 0.9, 0.0, cluster(1.0, 0.0))
    assert contact_s == pytest.approx((1.0 - 0.615) / 0.9, abs=0.06) and point is not None
    assert decision.zone == APPROACH and decision.factor == pytest.approx(contact_s / OPTIONS.approach_s)


def test_what_is_in_the_margin_beside_the_robot_stops_it_only_when_it_turns_into_it(monitor):
    beside = np.vstack([cluster(x, 0.347) for x in np.arange(-0.4, 0.45, 0.1)])
    assert judge(monitor, 0.5, 0.0, beside).factor == 1.0
    assert judge(monitor, 0.0, 0.6, beside).verdict is Verdict.STOP
    assert judge(monitor, 0.4, 0.5, beside).verdict is Verdict.STOP


def test_corner_that_sweeps_into_something_is_stopped(monitor):
    aside = cluster(0.43, 0.40)
    assert judge(monitor, 0.0, 0.8, aside).zone == APPROACH
    assert judge(monitor, 0.0, 0.8, aside).factor < 1.0
    assert judge(monitor, 0.0, 0.0, aside).factor == 1.0


def test_two_stray_points_are_noise(monitor):
    assert judge(monitor, 0.8, 0.0, cluster(0.55, 0.0)[:2]).factor == 1.0


def test_a_zone_lets_go_only_after_a_while_without_anything_in_or_near_it(monitor):
    held = judge(monitor, 0.02, 0.0, cluster(0.60, 0.0), now=1.0).state
    assert judge(monitor, 0.02, 0.0, cluster(0.64, 0.0), now=1.1).zone == "", "just outside"
    edge = judge(monitor, 0.02, 0.0, cluster(0.64, 0.0), now=1.1, state=held)
    assert (edge.verdict, edge.zone) == (Verdict.STOP, "stop ahead"), "still near"
    gone = judge(monitor, 0.02, 0.0, cluster(3.0, 0.0), now=1.35, state=edge.state)
    assert gone.verdict is Verdict.STOP and gone.point is None
    free = judge(monitor, 0.02, 0.0, cluster(3.0, 0.0), now=1.45, state=gone.state)
    assert free.verdict is Verdict.GO and free.state == START


def scan(ranges: np.ndarray) -> LaserScan:
    return LaserScan(
        stamp=0.0, angle_min=-np.pi / 2, angle_increment=np.pi / (len(ranges) - 1), range_min=0.1, range_max=30.0,
        ranges=ranges,
    )  # fmt: skip


def test_hits_are_in_base_link_and_leave_out_the_robot_itself():
    ranges = np.full(181, np.inf)
    ranges[90], ranges[0], ranges[180] = 1.0, 0.3, 0.5
    points, blind = scan_hits(scan(ranges), make_pose(translation=(0.45, 0.0, 0.2)), OPTIONS)
    np.testing.assert_allclose(points, [[1.45, 0.0], [0.45, 0.5]], atol=1e-9)
    assert blind == 0.0


def test_what_is_too_near_for_the_scanner_counts_and_nan_is_blindness():
    ranges = np.full(100, np.inf)
    ranges[49:52], ranges[:30] = -np.inf, np.nan
    points, blind = scan_hits(scan(ranges), make_pose(translation=(0.45, 0.0, 0.2)), OPTIONS)
    assert blind == pytest.approx(0.30)
    np.testing.assert_allclose(np.hypot(points[:, 0] - 0.45, points[:, 1]), 0.1)
    assert len(points) == 3


def test_polygon_may_be_concave_and_its_margin_is_round():
    corner = np.array([[0, 0], [2, 0], [2, 2], [1, 2], [1, 1], [0, 1]], dtype=float)
    points = np.array([[0.5, 0.5], [1.5, 1.5], [0.5, 1.5], [-0.05, 0.5], [-0.08, -0.08], [0.95, 1.05]])
    assert in_polygon(points, corner).tolist() == [True, True, False, False, False, False]
    assert in_polygon(points, corner, 0.1).tolist() == [True, True, False, True, False, True]


def test_bad_options_and_zones_are_refused():
    with pytest.raises(InvalidInput):
        replace(OPTIONS, stop_s=0.7)
    zone = SafetyZone(name=APPROACH, polygon=np.array([[0, 0], [1, 0], [0, 1]]), motions=("turn",))
    with pytest.raises(InvalidInput, match="names of their own"):
        CollisionMonitor([zone])
