"""A robot parked beside a plant, whose pose is given: what its arm does can be measured without driving there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grape.experiments.robot_bench import RobotBench
from grape.geometry import inverse
from grape.messages import Array, Odometry
from grape.robots import RobotDescription
from grape.sim.drivers import SensorOptions
from grape.sim.drivers.arm import ArmDriverOptions
from grape.sim.simulation import SimulationOptions
from grape.sim.worlds import VineyardOptions, World, generate_vineyard


@dataclass(frozen=True, kw_only=True)
class Parking:
    """Where the robot stands: the plant is `ahead_m` before the arm's base and `beside_m` left of the robot's side."""

    plant: str
    ahead_m: float = -0.22
    beside_m: float = 0.50


class ArmBench(RobotBench):
    """One parked robot in one world.

    Args:
        description: of the robot.
        parking: where it stands.
        world: the vineyard; its `seed` also draws the sensors' noise and the arm's errors.
        arm_errors: level of the arm's errors.
        dispensers: in the feeder.
        arm_pose: the named pose that the arm starts in.
    """

    def __init__(
        self,
        description: RobotDescription,
        parking: Parking,
        world: VineyardOptions,
        *,
        arm_errors: float = 1.0,
        dispensers: int = 0,
        arm_pose: str = "travel",
    ) -> None:
        sensors = SensorOptions(arm=ArmDriverOptions(errors=arm_errors))
        options = SimulationOptions(dispensers=dispensers, sensors=sensors, arm_pose=arm_pose)
        super().__init__(description, _parked(world, parking, description), world.seed, parking.plant, options)
        for name, mount in description.mounts.items():
            self.ctx.world.frames.set_fixed(mount.parent, name, mount.T_parent_sensor)
        self._sense()

    def true_hand(self) -> Array:
        """`T_base_hand` as it really is, whatever the encoders tell."""
        referee = self.simulation.referee
        return inverse(referee.true_pose()) @ referee.true_pose(self.robot.description.arm.tip_frame)

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


def _parked(options: VineyardOptions, parking: Parking, description: RobotDescription) -> World:
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
