"""A robot in a world, simulated: clock, drivers, one beat at a time, and a referee who alone sees the truth."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from grape.drivers import Drivers
from grape.geometry import pose, rotation_z
from grape.messages import Array
from grape.robots import RobotDescription
from grape.sim.checkpoint import Checkpoint
from grape.sim.compose import BASE_JOINT, DISPENSER, compose, compose_seen
from grape.sim.drivers import SensorOptions, connect
from grape.sim.faults import Fault, apply_fault, fault_record, repeat_fault
from grape.sim.mud import Mud
from grape.sim.physics import STEPS_PER_SECOND, Physics, SimulatedClock
from grape.sim.raycast import MovingRays, Raycaster
from grape.sim.referee import Referee
from grape.sim.render import Renderer, View
from grape.sim.worlds import World
from grape.sim.worlds.walkers import Walkers


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """How a scene starts."""

    dispensers: int = 8  # in the feeder, from the lowest level up
    stock: int = 0  # more, for refills
    arm_pose: str = "travel"
    settle_s: float = 1.0  # of physics before time 0
    sensors: SensorOptions = field(default_factory=SensorOptions)
    faults: tuple[tuple[float, Fault], ...] = ()  # what goes wrong by itself, and at what time, s


class Simulation:
    """One robot in one world.

    Args:
        world: what stands where.
        robot: the robot's description; it starts at the site's start pose.
        seed: of every sensor's noise.

    Raises:
        InvalidInput: robot and options do not fit together.
    """

    def __init__(
        self, world: World, robot: RobotDescription, *, seed: int = 0, options: SimulationOptions | None = None
    ) -> None:
        self.options = options or SimulationOptions()
        self.world = world
        self.robot = robot
        self._physics = Physics(compose(world, robot, self.options.dispensers, self.options.stock))
        self._mud = Mud(self._physics, world.terrain, robot)
        self._walkers = Walkers(world.walkers, world.terrain)
        self._place()
        sensors = self.options.sensors
        self._drivers = connect(
            self._physics,
            robot,
            world.site,
            MovingRays(Raycaster(world).cast, self._walkers).cast,
            lambda: compose_seen(world, robot, self.options.dispensers, self.options.stock),
            seed,
            replace(sensors, camera=replace(sensors.camera, gloss_rad=world.sun.gloss_rad)),
        )
        self._settle()
        self._drivers.sample(0)
        self.referee = Referee(self._physics, world, robot, self._walkers)
        self._renderers: dict[tuple[int, int], Renderer] = {}
        self._checkpoint: Checkpoint | None = None
        self._planned = sorted(self.options.faults, key=lambda planned: planned[0])
        self._begun = 0  # of them

    @property
    def clock(self) -> SimulatedClock:
        """Simulated time."""
        return self._physics.clock

    @property
    def drivers(self) -> Drivers:
        """What a mission may know and move."""
        return self._drivers.ports

    def advance(self, steps: int = 5) -> None:
        """Let so many physics steps of 2 ms pass; 5 are one beat.

        Raises:
            DriverError: the physics has diverged; the mission must end.
        """
        self._go_wrong()
        for _ in range(steps):
            self._step()
            self._walk()
            self.referee.watch()
            self._drivers.sample(self._physics.clock.step)
        if self._checkpoint is not None:
            self._checkpoint.save(self.referee.news())

    def keep(self, folder: Path) -> bool:
        """Keep the world in a folder from now on, at every call of `advance`; one that was kept there comes back first.

        What comes back is as it was, driver for driver; only the messages of before are gone, read or not.

        Returns:
            Whether a world came back.

        Raises:
            InvalidInput: what is in the folder is of another world.
        """
        parts = (*self._drivers.sensors.values(), self._drivers.operator, *self.referee.tallies)
        checkpoint = self._checkpoint = Checkpoint(folder, self._physics, parts)
        came_back = checkpoint.kept_step() is not None
        journal = checkpoint.journal()
        if came_back:
            for record in (entry for entry in journal if "fault" in entry):
                self._physics.clock.step = record["step"]
                repeat_fault(record, self._physics, self._drivers)
                self._begun = max(self._begun, record.get("planned", -1) + 1)
            self.referee.recall(journal)
            checkpoint.restore()
            for sensor in self._drivers.sensors.values():
                sensor.forget()  # what the new scene had measured before this one came back
            self._walk()
        checkpoint.save()
        return came_back

    def inject(self, fault: Fault) -> None:
        """Let something go wrong, now."""
        self._inject(fault, {})

    def render(self, camera: str | View | None = None, width: int = 960, height: int = 720) -> Array:
        """A picture (h, w, 3) RGB uint8 by a camera of the model or a free one (default: behind the robot)."""
        size = (width, height)
        if size not in self._renderers:
            self._renderers[size] = Renderer(self._physics.model, width, height, pretty=True)
        return self._renderers[size].color(self._physics.data, camera or self.chase_view())

    def chase_view(self, distance_m: float = 3.2, azimuth_deg: float = 140.0, elevation_deg: float = -22.0) -> View:
        """A free camera that looks at the robot, turned with it."""
        base = self._physics.data.body("base_link")
        yaw = np.degrees(np.arctan2(base.xmat[3], base.xmat[0]))
        return View(
            target=base.xpos + np.array([0.0, 0.0, 0.35]),
            distance_m=distance_m,
            azimuth_deg=float(yaw) + azimuth_deg,
            elevation_deg=elevation_deg,
        )

    def close(self) -> None:
        """Give the graphics memory back, and close the files of `keep`."""
        if self._checkpoint is not None:
            self._checkpoint.close()
            self._checkpoint = None
        self._drivers.close()
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()

    def _place(self) -> None:
        """Put the robot on the ground at the site's start, its arm in the start pose and the loops in the feeder."""
        physics, robot, site = self._physics, self.robot, self.world.site
        heading = rotation_z(site.start_heading_rad)
        corners = site.start + robot.base.footprint @ heading[:2, :2].T
        ground = self.world.terrain.height(np.vstack([corners, site.start]))
        T_map_base = pose(
            _upright(corners, ground[:-1]) @ heading,
            (*site.start, ground.max() + _rest_height(physics) + 0.005),
        )
        physics.put(BASE_JOINT, T_map_base)
        poses = robot.arm.poses
        start = poses.get(self.options.arm_pose, poses["home"])
        physics.data.qpos[physics.joint_qpos(robot.arm.joints)] = start
        closed = [robot.gripper.thumb_clear, robot.gripper.closed_angle, robot.gripper.closed_angle]
        physics.data.qpos[physics.joint_qpos(robot.gripper.joints)] = closed
        for index in range(self.options.dispensers):
            T_map_loop = T_map_base @ robot.feeder.T_base_link_level(index)
            physics.put(f"{DISPENSER}{index}", T_map_loop)
        self._walk()
        physics.rearranged()
        mujoco.mj_forward(physics.model, physics.data)

    def _step(self) -> None:
        self._drivers.actuate()
        self._mud.act()
        self._physics.step()

    def _go_wrong(self) -> None:
        """Let begin what is planned for now."""
        while self._begun < len(self._planned) and self._planned[self._begun][0] <= self.clock.now() + 1e-9:
            self._begun += 1
            self._inject(self._planned[self._begun - 1][1], {"planned": self._begun - 1})

    def _inject(self, fault: Fault, note: dict[str, int]) -> None:
        apply_fault(fault, self._physics, self._drivers)
        if self._checkpoint is not None:
            self._checkpoint.save([{"step": self._physics.clock.step, **note, **fault_record(fault)}])

    def _walk(self) -> None:
        """Put every walker where it is at the clock's time."""
        if not self._walkers.ids:
            return
        data, poses = self._physics.data, self._walkers.poses(self._physics.clock.now())
        data.mocap_pos[:] = poses[:, :3]
        data.mocap_quat[:, 0], data.mocap_quat[:, 3] = np.cos(0.5 * poses[:, 3]), np.sin(0.5 * poses[:, 3])

    def _settle(self) -> None:
        """Let wheels sink in and loops come to rest, then start the clock at 0."""
        for _ in range(round(self.options.settle_s * STEPS_PER_SECOND)):
            self._step()
        self._physics.clock.step = 0
        self._physics.data.time = 0.0
        self._physics.rearranged()


def _rest_height(physics: Physics) -> float:
    """z of base_link in its MJCF: what it is above flat ground."""
    return float(physics.model.body_pos[physics.identify("body", "base_link")][2])


def _upright(corners: Array, heights: Array) -> Array:
    """The rotation (3, 3) that tilts a level body onto the plane through points (n, 2) of these heights (n,)."""
    design = np.column_stack([corners - corners.mean(axis=0), np.ones(len(corners))])
    slope_x, slope_y, _ = np.linalg.lstsq(design, heights, rcond=None)[0]
    x, y = np.array([1.0, 0.0, slope_x]), np.array([0.0, 1.0, slope_y])
    x = x / np.linalg.norm(x)
    z = np.cross(x, y)
    z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])
