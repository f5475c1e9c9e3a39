"""A robot, a backend and a tree small enough to test the mission room without a simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.actions.core import Context, Outcome, Status
from grape.drivers import Drivers
from grape.errors import StaleData
from grape.geodesy import geodetic_from_enu
from grape.geometry import pose, rotation_z
from grape.messages import GripperState, Imu, JointState, NavSatFix
from grape.mission.catalog import robot_description
from grape.mission.file import Mission, load_mission
from grape.mission.launch import write_inputs
from grape.mission.runner import Runner

WHEELS = ("wheel_front_left", "wheel_front_right", "wheel_rear_left", "wheel_rear_right")


class Buffer:
    """A driver with a list of messages."""

    def __init__(self) -> None:
        self.messages: list[Any] = []
        self.stops = 0

    def latest(self, max_age_s: float | None = None) -> Any:
        if not self.messages:
            raise StaleData("nothing yet")
        return self.messages[-1]

    def since(self, stamp: float) -> tuple[Any, ...]:
        return tuple(message for message in self.messages if message.stamp > stamp)

    def stop(self) -> None:
        self.stops += 1


class FakeBackend:
    """A robot that stands at the site's start; every sensor works."""

    def __init__(self, mission: Mission) -> None:
        self.beats = 0
        names = ("base", "arm", "gripper", "camera", "imu", "gnss")
        self.buffers = {name: Buffer() for name in names}
        self.drivers = Drivers(**self.buffers)
        self.site = mission.site
        self.estimates: list[Any] = []
        self.witnessed: list[tuple[str, str]] = []
        self.sample()

    @property
    def clock(self) -> FakeBackend:
        return self

    def now(self) -> float:
        return self.beats / 100

    def advance(self) -> None:
        self.beats += 1
        self.sample()

    def sample(self) -> None:
        t = self.now()
        zeros = np.zeros(4)
        self._add("base", JointState(stamp=t, name=WHEELS, position=zeros, velocity=zeros, effort=zeros))
        joints = tuple(f"joint_{k}" for k in range(1, 7))
        six = np.zeros(6)
        self._add("arm", JointState(stamp=t, name=joints, position=six, velocity=six, effort=six))
        self._add("gripper", GripperState(stamp=t, position=np.zeros(3), velocity=np.zeros(3)))
        upright = np.array([1.0, 0.0, 0.0, 0.0])
        gravity = np.array([0.0, 0.0, 9.81])
        imu = Imu(stamp=t, orientation=upright, angular_velocity=np.zeros(3), linear_acceleration=gravity)
        self._add("imu", imu)
        if self.beats % 100 == 0:
            antenna = np.array([*self.site.start, 0.13]) + np.array([-0.35, -0.20, 0.75])
            lat, lon, alt = geodetic_from_enu(self.site.datum, antenna[None])[0]
            covariance = np.eye(3) * 1e-4
            fix = NavSatFix(stamp=t, latitude=lat, longitude=lon, altitude=alt, covariance=covariance)
            self._add("gnss", fix)

    def _add(self, name: str, message: Any) -> None:
        self.buffers[name].messages = [*self.buffers[name].messages[-200:], message]

    def observe(self, estimate: Any = None) -> None:
        if estimate is not None:
            self.estimates.append(estimate)

    def witness(self, check: str, plant: str) -> None:
        self.witnessed.append((check, plant))

    @property
    def referee(self) -> FakeBackend:
        return self

    @property
    def path(self) -> list[Any]:
        x, y = self.site.start
        return [SimpleNamespace(time_s=t, x=x, y=y, yaw=0.0) for t in (0.0, 100.0)]

    def standing(self) -> Any:
        return np.array([[0.05, 0.05], [1.15, 0.05]])

    def verdict(self) -> dict[str, Any]:
        truth = {
            "places": {"feeder": 7, "hand": 0, "dropped": 0, "stock": 2, "r0v1": 1}, "loaded": 8,
            "hanging": ["r0v1"], "dropped": 0, "in_feeder": 7, "on_hand": 0, "fence_crossings": 0,
            "collisions": [{"a": "link_5", "b": "r0v1/cane", "force_n": 4.2, "time_s": 61.5}],
            "max_plant_force_n": 4.2, "plants": {"r0v1": {"hanging": True, "offset_mm": 6.5}},
        }  # fmt: skip
        return {"truth": truth, "localization": {"position_rmse_m": 0.01234, "yaw_rmse_deg": 0.5, "max_error_m": 0.03}}


class ScriptedTree:
    """Calls a function at each tick; a returned status ends the tree."""

    def __init__(self, context: Context, script: Callable[[Context, int], Status | None]) -> None:
        self.context = context
        self.script = script
        self.ticks = 0
        self.halted = False
        self.last_failure: Any = None

    def tick(self) -> Status:
        self.ticks += 1
        return self.script(self.context, self.ticks) or Status.ACTIVE

    def halt(self) -> None:
        self.halted = True


def serve(context: Context, plant: str, outcome: Outcome, reason: str = "") -> None:
    """What the task's actions tell while they serve a plant, compressed into one moment."""
    now = context.clock.now()
    log, ledger = context.log, context.ledger
    log.event("plant_started", plant=plant, mode="plant")
    start = now
    for name, seconds in (("DriveToPlant", 20.0), ("ServoToFeeder", 8.0), ("HangDispenser", 6.0), ("Retract", 5.0)):
        log.event("action", name=name, status="active", start=start, end=None)
        end = start + seconds
        log.event("action", name=name, status="succeeded", reason="", detail="", start=start, end=end)
        start = end
    ledger.attempt(plant)
    ledger.move_dispenser("feeder", "hand")
    ledger.move_dispenser("hand", plant if outcome is Outcome.DEPLOYED else "lost")
    log.event("servo", action="ServoToSpur", error_px=1.5, iterations=80, converged=True, reason="")
    ledger.finish(plant, outcome, reason)
    log.event("plant_finished", plant=plant, outcome=str(outcome), reason=reason)


@pytest.fixture(name="serve")
def serve_fixture() -> Callable[..., None]:
    return serve


@pytest.fixture
def mission() -> Mission:
    return load_mission("dispenser_deployment")


@pytest.fixture
def backend(mission: Mission) -> FakeBackend:
    return FakeBackend(mission)


@pytest.fixture
def robot() -> Any:
    T_arm_hand = pose(rotation_z(0.3), (0.2, 0.0, 0.5))
    description = robot_description("husky_jaco2")
    description = replace(description, arm=replace(description.arm, touch=None))
    return SimpleNamespace(description=description, arm=SimpleNamespace(fk=lambda q: T_arm_hand))


@pytest.fixture
def make_runner(
    mission: Mission, backend: FakeBackend, robot: Any, tmp_path: Path
) -> Callable[..., tuple[Runner, list[ScriptedTree]]]:
    def make(
        script: Callable[[Context, int], Status | None],
        backend: FakeBackend = backend,
        folder: Path = tmp_path,
        **options: Any,
    ) -> tuple[Runner, list[ScriptedTree]]:
        trees: list[ScriptedTree] = []

        def make_tree(context: Context) -> ScriptedTree:
            trees.append(ScriptedTree(context, script))
            return trees[0]

        write_inputs(mission, folder)
        runner = Runner(mission, backend, robot, folder, make_tree=make_tree, referee=backend, **options)
        return runner, trees

    return make
