"""What is not in view is looked for from places around, where nothing stands in the way."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.core import Feedback
from grape.actions.look_around import LookAroundOptions, camera_looks, look_around
from grape.actions.move_arm import checker_for
from grape.actions.obstacles import UNSEEN
from grape.errors import Reason
from grape.geometry import inverse, pose, pose_error, rotation_x, transform
from grape.planning import StaticBox

AWAY = np.array([0.0, -1.0, 0.0])
START = pose(rotation_x(np.pi / 2), (0.48, 0.55, 0.75))  # level, before the row


def looking(bench: Bench, seen: Any, boxes: Any = (), options: Any = None) -> Generator[Feedback, None, None]:
    bench.ctx.world.committed[UNSEEN] = tuple(boxes)
    with bench.ctx.arm.lease("test") as arm:
        yield from look_around(
            bench.ctx, arm, seen, name="Servo", what="the thing", away=AWAY, checker=checker_for(bench.ctx),
            options=options,
        )  # fmt: skip


def thing(p_base: Any) -> Any:
    """Sees a point of base_link that lies within the middle of the picture."""

    def seen(image: Any, T_base_camera: Any) -> bool:
        x, y, z = transform(inverse(T_base_camera), np.asarray(p_base, float))
        return bool(z > 0.0 and max(abs(x / z), abs(y / z)) < 0.3)

    return seen


@pytest.fixture
def before_the_row(bench: Bench) -> Bench:
    bench.put_hand(START)
    return bench


def test_what_is_in_view_is_not_looked_for(before_the_row: Bench) -> None:
    bench, q = before_the_row, before_the_row.arm.q.copy()
    start = bench.now()
    bench.run(looking(bench, lambda image, T: True))
    assert bench.arm.q == pytest.approx(q) and bench.now() - start < 0.02
    assert not [kind for kind, _ in bench.log.events if kind == "look_around"]


def test_what_is_beside_the_picture_is_found(before_the_row: Bench) -> None:
    bench = before_the_row
    T = bench.world.frames.lookup("base_link", "camera_optical")
    seen = thing(transform(T, np.array([0.17, 0.0, 0.4])))
    bench.run(looking(bench, seen))
    assert bench.log.last("look_around")["found"] is True
    assert bench.hand[1, 3] < START[1, 3] - 0.02, "it went back first"
    assert not bench.log.pictures


def test_what_is_nowhere_is_lost_and_the_hand_is_back_where_it_began(before_the_row: Bench) -> None:
    bench = before_the_row
    reached = [bench.hand[1, 3]]

    def seen(image: Any, T: Any) -> bool:
        reached.append(bench.hand[1, 3])
        return False

    failure = bench.failure(looking(bench, seen))
    assert failure.reason is Reason.FEATURE_LOST and "the thing not in view from 10 places" in failure.detail
    assert np.abs(pose_error(bench.hand, START)).max() < 0.005
    assert max(reached) < START[1, 3] + 0.002, "never nearer to the row than where it began"
    assert bench.log.pictures == ["Servo_feature_lost"] and bench.ctx.arm.owner is None


def test_places_behind_an_obstacle_are_left_out(before_the_row: Bench) -> None:
    bench = before_the_row
    wall = StaticBox(name="wall", center=(START[0, 3] + 0.24, 0.4, 0.75), half_size=(0.05, 0.3, 0.5), ignore_links=())
    least = []

    def seen(image: Any, T: Any) -> bool:
        least.append(checker_for(bench.ctx).clearance(bench.arm.q))
        return False

    bench.failure(looking(bench, seen, (wall,), LookAroundOptions(turn_rad=0.0, shift_m=0.2, frames=1)))
    assert 1 <= bench.log.last("look_around")["places"] < 10
    assert min(least) > min(0.0, least[0]) - 0.003


def test_a_silent_camera_is_left_to_servoing(before_the_row: Bench) -> None:
    bench, q = before_the_row, before_the_row.arm.q.copy()
    bench.camera.silent = True
    bench.run(looking(bench, thing((0.0, 0.0, 0.0))))
    assert bench.arm.q == pytest.approx(q)


def test_the_pattern_stays_within_its_bounds() -> None:
    options = LookAroundOptions(back_m=0.06, turn_rad=np.radians(17.0), shift_m=0.03)
    looks = camera_looks(np.eye(4), np.array([0.0, 0.0, -1.0]), options)
    assert len(looks) == 10 and looks[-1] == pytest.approx(np.eye(4))
    for T in looks[:-1]:
        assert T[2, 3] == pytest.approx(-0.06)
        assert np.linalg.norm(T[:2, 3]) < 0.031
        assert np.degrees(np.arccos(T[2, 2])) < 17.1
