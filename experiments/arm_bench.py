"""A robot parked beside a plant, whose pose is given: what its arm does can be measured without driving there."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self, TypeVar

import numpy as np

from grape.actions.core import Context, Feedback, InlineJobs
from grape.actions.robot import build_robot
from grape.errors import ActionFailed, Reason
from grape.geometry import inverse
from grape.messages import Array, Odometry
from grape.mission.ledger import SqliteLedger
from grape.robots import RobotDescription
from grape.sim.drivers import SensorOptions
from grape.sim.drivers.arm import ArmDriverOptions
from grape.sim.simulation import Simulation, SimulationOptions
from grape.sim.worlds import VineyardOptions, generate_vineyard
from grape.world import World

R = TypeVar("R")


@dataclass(frozen=True, kw_only=True)
class Parking:
    """Where the robot stands: the plant is `ahead_m` before the arm's base and `beside_m` left of the robot's side."""

    plant: str
    ahead_m: float = -0.22
    beside_m: float = 0.50


@dataclass
class BenchLog:
    """Keeps what actions tell."""

    events: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    pictures: dict[str, Array] = field(default_factory=dict)

    def event(self, kind: str, /, **fields: Any) -> None:
        """Keep an event."""
        self.events.append((kind, fields))

    def picture(self, name: str, bgr: Array) -> None:
        """Keep the last picture of this name."""
        self.pictures[name] = bgr

    def of(self, kind: str) -> list[dict[str, Any]]:
        """The events of one kind."""
        return [fields for name, fields in self.events if name == kind]


class ArmBench:
    """One parked robot in one world.

    Args:
        description: of the robot.
        parking: where it stands.
        world: the vineyard; its `seed` also draws the sensors' noise and the arm's errors.
        arm_errors: level of the arm's errors.
        dispensers: in the feeder.
    """

    def __init__(
        self,
        description: RobotDescription,
        parking: Parking,
        world: VineyardOptions,
        *,
        arm_errors: float = 1.0,
        dispensers: int = 0,
    ) -> None:
        self.truth = _parked(world, parking, description)
        sensors = SensorOptions(arm=ArmDriverOptions(errors=arm_errors))
        options = SimulationOptions(dispensers=dispensers, sensors=sensors)
        self.simulation = Simulation(self.truth, description, seed=world.seed, options=options)
        self.robot = build_robot(description)
        self.log = BenchLog()
        self._folder = TemporaryDirectory()
        account = Path(self._folder.name) / "ledger.sqlite"
        self._ledger = SqliteLedger.create(account, [(parking.plant, "auto")], dispensers)
        self.ctx = Context(
            clock=self.simulation.clock,
            world=World(site=self.truth.site),
            drivers=self.simulation.drivers,
            robot=self.robot,
            jobs=InlineJobs(),
            log=self.log,
            ledger=self._ledger,
            rng=np.random.default_rng([world.seed, 7]),
        )
        for name, mount in description.mounts.items():
            self.ctx.world.frames.set_fixed(mount.parent, name, mount.T_parent_sensor)
        self._sense()

    def run(self, action: Generator[Feedback, None, R], limit_s: float = 120.0) -> R:
        """Beat until an action ends.

        Raises:
            ActionFailed: it failed, or TIMEOUT: it was stopped after `limit_s` simulated seconds.
        """
        end = self.ctx.clock.now() + limit_s
        while self.ctx.clock.now() < end:
            try:
                next(action)
            except StopIteration as stop:
                result: R = stop.value
                return result
            self.simulation.advance()
            self._sense()
        action.close()
        raise ActionFailed(Reason.TIMEOUT, f"the action took longer than {limit_s} s")

    def true_hand(self) -> Array:
        """`T_base_hand` as it really is, whatever the encoders tell."""
        referee = self.simulation.referee
        return inverse(referee.true_pose()) @ referee.true_pose(self.robot.description.arm.tip_frame)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Give the graphics memory back, and the account's folder."""
        self.simulation.close()
        self._ledger.close()
        self._folder.cleanup()

    def _sense(self) -> None:
        world, drivers = self.ctx.world, self.ctx.drivers
        arm, world.gripper = world.take_arm(drivers.arm.latest()), drivers.gripper.latest()
        world.frames.push("base_link", "hand", self.robot.hand_pose(arm.position), arm.stamp)
        world.localized = True
        world.odometry = Odometry(
            stamp=self.ctx.clock.now(),
            frame_id="map",
            child_frame_id="base_link",
            pose=self.simulation.referee.true_pose(),
            linear=np.zeros(3),
            angular=np.zeros(3),
            pose_covariance=np.zeros((6, 6)),
            twist_covariance=np.zeros((6, 6)),
        )


def _parked(options: VineyardOptions, parking: Parking, description: RobotDescription) -> Any:
    """The world with the robot's start beside a plant."""
    world = generate_vineyard(options)
    plant = world.site.plant(parking.plant)
    row = world.site.row(plant.row)
    along, aside = row.work_direction, row.aisle_normal
    x = description.arm.T_base_link_arm_base[0, 3] + parking.ahead_m
    y = float(description.base.footprint[:, 1].max()) + parking.beside_m
    start = plant.position - along * x + aside * y
    heading = float(np.arctan2(along[1], along[0]))
    return replace(world, site=replace(world.site, start=start, start_heading_rad=heading))
