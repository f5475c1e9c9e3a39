"""What the robot still believes when its sensors fall silent or tell nonsense."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from grape.errors import StaleData
from grape.mission.file import Mission
from grape.mission.sense import ARM_AGE_MAX_S, SILENCE_MAX_S, Sensing
from grape.world import World


@pytest.fixture
def world(mission: Mission) -> World:
    return World(site=mission.site)


def beat(backend: Any, sensing: Sensing, beats: int, *silent: str) -> None:
    for _ in range(beats):
        backend.beats += 1
        before = {name: backend.buffers[name].messages for name in silent}
        backend.sample()
        for name, messages in before.items():
            backend.buffers[name].messages = messages
        sensing.update(backend.now())


def test_joint_angles_that_grow_old_are_not_moved_by(backend: Any, world: World, robot: Any) -> None:
    sensing = Sensing(backend.drivers, world, robot)
    beat(backend, sensing, 5)
    beat(backend, sensing, round(100 * ARM_AGE_MAX_S), "arm")
    assert world.joints() == pytest.approx(np.zeros(6))
    beat(backend, sensing, 1, "arm")
    with pytest.raises(StaleData):
        world.joints()
    beat(backend, sensing, 1)
    assert world.joints() == pytest.approx(np.zeros(6))


def test_the_place_of_a_frame_taken_after_the_last_joint_angles_is_stale(
    backend: Any, world: World, robot: Any
) -> None:
    sensing = Sensing(backend.drivers, world, robot)
    beat(backend, sensing, 5)
    last = backend.now()
    beat(backend, sensing, 8, "arm")
    world.frames.lookup("base_link", "camera_optical", last + 0.02)
    with pytest.raises(StaleData, match="are known"):
        world.frames.lookup("base_link", "camera_optical", backend.now())


def test_joint_angles_that_are_no_numbers_are_not_taken_in(backend: Any, world: World, robot: Any) -> None:
    sensing = Sensing(backend.drivers, world, robot)
    beat(backend, sensing, 5)
    nonsense = replace(backend.buffers["arm"].messages[-1], position=np.full(6, np.nan))
    backend.buffers["arm"].messages.append(nonsense)
    sensing.update(backend.now())
    assert world.joints() == pytest.approx(np.zeros(6))


def stamped_ahead(buffer: Any) -> None:
    buffer.messages = [replace(buffer.messages[-1], stamp=1e9)]


def test_joint_angles_that_are_stamped_ahead_of_the_clock_are_not_moved_by(
    backend: Any, world: World, robot: Any
) -> None:
    sensing = Sensing(backend.drivers, world, robot)
    stamped_ahead(backend.buffers["arm"])
    beat(backend, sensing, 5, "arm")
    with pytest.raises(StaleData):
        world.joints()
    beat(backend, sensing, 1)
    assert world.joints() == pytest.approx(np.zeros(6))


def test_messages_that_are_stamped_ahead_of_the_clock_keep_no_pose_fresh(
    backend: Any, world: World, robot: Any
) -> None:
    sensing = Sensing(backend.drivers, world, robot)
    beat(backend, sensing, 150)
    for name in ("base", "imu", "gnss"):
        stamped_ahead(backend.buffers[name])
    beat(backend, sensing, 50, "base", "imu", "gnss")
    assert world.odometry is not None
    assert backend.now() - world.odometry.stamp >= 0.5 - SILENCE_MAX_S - 0.01
    beat(backend, sensing, 1)
    assert world.odometry.stamp == backend.now(), "the next good ones count"


@pytest.mark.parametrize(
    ("silent", "fresh"), [(("base", "imu", "gnss"), False), (("base",), True), (("imu",), True), (("gnss",), True)]
)
def test_the_pose_is_not_carried_on_without_any_sensor(
    backend: Any, world: World, robot: Any, silent: tuple[str, ...], fresh: bool
) -> None:
    sensing = Sensing(backend.drivers, world, robot)
    beat(backend, sensing, 150)
    beat(backend, sensing, 50, *silent)
    assert world.odometry is not None
    age = backend.now() - world.odometry.stamp
    assert age <= SILENCE_MAX_S if fresh else 0.5 - SILENCE_MAX_S - 0.01 <= age <= 0.5
