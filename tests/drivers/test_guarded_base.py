from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from grape.drivers.guarded_base import FENCE, POSE, GuardedBase, GuardOptions
from grape.errors import InvalidInput, StaleData
from grape.geometry import pose as make_pose
from grape.messages import LaserScan, Twist
from grape.navigation.collision_monitor import SCAN, CollisionMonitor, CollisionOptions, Decision
from grape.navigation.fence_guard import FenceGuard
from grape.navigation.grid import Footprint
from grape.robots.husky_jaco2 import DESCRIPTION

PRINT = Footprint(front=0.495, rear=0.495, half_width=0.343)
T_BASE_LASER = make_pose(translation=(0.45, 0.0, 0.20))


class Yard:
    """A base with a laser whose beams all have the same length, and everything that was sent to its wheels."""

    def __init__(self, *fences: Any, effective_track: float = 0.2) -> None:
        self.time_s, self.range_m, self.stamp, self.blind = 5.0, np.inf, None, 0
        self.x, self.known = 0.0, True
        self.sent: list[tuple[float, float]] = []
        self.stops = 0
        self.told: list[Decision] = []
        self.base = GuardedBase(
            self,  # type: ignore[arg-type]
            self,
            CollisionMonitor(DESCRIPTION.base.zones, CollisionOptions(footprint=PRINT)),
            FenceGuard(fences, PRINT),
            {"front_laser": (self, T_BASE_LASER)},  # type: ignore[dict-item]
            lambda: (self.time_s, np.array([self.x, 0.0, 0.0])) if self.known else None,
            GuardOptions(velocity=(1.0, 2.0), effective_track=effective_track, acceleration=(3.0, 6.0)),
            self.told.append,
        )

    def now(self) -> float:
        return self.time_s

    def send(self, linear_x: float, angular_z: float) -> Twist:
        self.sent.append((linear_x, angular_z))
        return Twist(stamp=self.time_s, linear=np.array([linear_x, 0, 0]), angular=np.array([0, 0, angular_z]))

    def stop(self) -> None:
        self.stops += 1

    def latest(self, max_age_s: float | None = None) -> LaserScan:
        stamp = self.time_s if self.stamp is None else self.stamp
        if max_age_s is not None and self.time_s - stamp > max_age_s:
            raise StaleData("front_laser: too old")
        ranges = np.full(1081, self.range_m)
        ranges[: self.blind] = np.nan
        return LaserScan(
            stamp=stamp, angle_min=-2.356, angle_increment=0.00436, range_min=0.1, range_max=30.0, ranges=ranges
        )

    def drive(self, v: float, w: float = 0.0, beats: int = 1) -> tuple[float, float]:
        """What comes to the wheels after so many beats of the same wish."""
        for _ in range(beats):
            twist = self.base.send(v, w)
            assert self.sent[-1] == (twist.linear[0], twist.angular[2]), "send tells what was sent"
            self.time_s += 0.01
        return self.sent[-1]


def test_command_on_free_ground_that_the_base_can_follow_goes_through_to_the_bit():
    yard = Yard()
    wishes = [(0.0123456789 * k, 0.1 - 0.05 * k) for k in range(12)]
    for v, w in (*wishes, (0.01, 0.0), (-0.1, 0.2), (0.0, -0.25), (0.0, 0.0)):
        assert yard.drive(v, w, beats=5) == (v, w)
        assert yard.sent[-5:] == [(v, w)] * 5, "in the first beat"
    assert yard.told == []


def test_speeds_are_held_to_the_limits():
    assert Yard().drive(9.0, 0.0, beats=50) == (1.0, 0.0)
    assert Yard().drive(0.0, -9.0, beats=50) == (0.0, -2.0)


@pytest.mark.parametrize(
    ("wish", "sent"),
    [((0.9, 0.1), (0.9, 0.1)), ((0.8, 1.5), (0.1, 1.5)), ((-0.8, -1.5), (-0.1, -1.5)), ((0.5, 9.0), (0.0, 5 / 3))],
)
def test_no_wheel_is_asked_for_more_than_it_has_and_the_turn_wins(wish, sent):
    assert Yard(effective_track=1.2).drive(*wish, beats=60) == pytest.approx(sent)


def test_step_of_speed_becomes_a_ramp_that_the_base_can_follow():
    yard = Yard()
    yard.drive(0.8, -1.5, beats=60)
    sent = np.array(yard.sent)
    assert tuple(sent[-1]) == (0.8, -1.5)
    steps = np.abs(np.diff(np.vstack([[0.0, 0.0], sent]), axis=0))
    assert steps[:, 0].max() == pytest.approx(0.03) and steps[:, 1].max() <= 0.06 + 1e-9, "m/s, rad/s in a beat"
    assert np.count_nonzero(steps[:, 0]) == np.count_nonzero(steps[:, 1]) == 27, "both arrive together, the arc stays"


def test_braking_and_turning_back_are_not_delayed():
    yard = Yard()
    yard.drive(0.8, -1.5, beats=60)
    assert yard.drive(0.1, -1.5) == (0.1, -1.5)
    v, w = yard.drive(-0.6, 0.0)
    assert w == 0.0 and -0.04 <= v <= 0.0, "through rest, and on from there as fast as it can"
    assert yard.drive(0.0, 0.0) == (0.0, 0.0)


def test_something_in_the_stop_zone_stops_at_once_and_is_told_once():
    yard = Yard()
    yard.drive(0.3, beats=20)
    yard.range_m = 0.15
    assert yard.drive(0.3, 0.2, beats=30) == (0.0, 0.0)
    assert yard.sent[20] == (0.0, 0.0), "in the first beat"
    (decision,) = yard.told
    assert decision.zone == "stop ahead" and decision.point is not None


def test_speed_is_picked_up_smoothly_once_the_way_is_free():
    yard = Yard()
    yard.drive(0.8, beats=40)
    yard.range_m = 0.15
    yard.drive(0.8, beats=20)
    yard.range_m = np.inf
    assert yard.drive(0.8, beats=400) == (0.8, 0.0)
    speeds = np.array(yard.sent)[60:, 0]
    assert np.diff(speeds).min() >= -1e-9 and np.diff(speeds).max() < 0.7 * 0.01 + 1e-6, "m/s in a beat"
    assert np.abs(np.diff(speeds, 2)).max() < 3.0 * 0.01**2 + 1e-3


def test_silent_laser_stops_the_base_whoever_drives():
    yard = Yard()
    yard.drive(0.4, beats=30)
    yard.stamp = yard.time_s
    yard.time_s += 0.29
    assert yard.drive(0.4) == (0.4, 0.0)
    yard.time_s += 0.02
    assert yard.drive(0.4, 0.1) == (0.0, 0.0) and yard.told[-1].zone == SCAN


def test_scan_that_is_stamped_ahead_of_the_clock_stops_the_base():
    yard = Yard()
    yard.drive(0.4, beats=30)
    yard.stamp = yard.time_s + 1e9
    assert yard.drive(0.4) == (0.0, 0.0) and yard.told[-1].zone == SCAN


@pytest.mark.parametrize(("beams", "moves"), [(100, True), (400, False)])
def test_laser_that_says_nan_stops_the_base(beams, moves):
    yard = Yard()
    yard.blind = beams
    assert (yard.drive(0.4)[0] > 0.0) is moves


def test_fence_stops_the_base_though_nothing_is_seen():
    yard = Yard(np.array([[1.0, -3.0], [1.1, -3.0], [1.1, 3.0], [1.0, 3.0]]))
    yard.x = 0.49
    assert yard.drive(0.5) == (0.0, 0.0) and yard.told[-1].zone == FENCE
    assert yard.drive(-0.5, beats=200)[0] == -0.5


def test_base_does_not_move_among_fences_without_a_pose():
    far = np.array([[50.0, 0.0], [51.0, 0.0], [51.0, 1.0]])
    yard = Yard(far)
    yard.known = False
    assert yard.drive(0.5) == (0.0, 0.0) and yard.told[-1].zone == POSE
    free = Yard()
    free.known = False
    assert free.drive(0.5, beats=30) == (0.5, 0.0), "without fences no pose is needed"


def test_stop_reaches_the_wheels_and_nonsense_does_not():
    yard = Yard()
    yard.base.stop()
    assert yard.stops == 1
    with pytest.raises(InvalidInput):
        yard.base.send(np.nan, 0.0)
    assert yard.sent == []
