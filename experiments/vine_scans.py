"""Scans of simulated vines without a mission: the wrist sensors are put along the way of `ScanVine`, nothing moves.

Camera and LiDAR are the simulated drivers of a mission. What arm and base add is put on here: the robot believes its
sensors, and the row, a little beside where they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grape.actions.robot import Robot, build_robot
from grape.errors import InvalidInput
from grape.geometry import inverse, pose, rotation_exp, rotation_from_rpy, transform
from grape.kinematics import inverse_all, inverse_path
from grape.messages import Array, LaserScan, RgbdImage
from grape.perception.sweep import Sweep, assemble
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.compose import BASE_JOINT, compose_seen
from grape.sim.drivers.camera import CameraOptions, SimulatedCamera
from grape.sim.drivers.lidar import TIM561, SimulatedScanner
from grape.sim.physics import STEPS_PER_SECOND, Physics, Replica
from grape.sim.raycast import Raycaster
from grape.sim.worlds import VineyardOptions, World, generate_vineyard
from grape.tasks.dispenser.actions.drive_to_plant import stop_pose
from grape.tasks.dispenser.actions.scan_vine import SWEEP, ScanVineGoal, VineScan, sweep_path
from grape.tasks.dispenser.stops import first_stop

VINES = 3  # in the row; the scanned one has neighbours, or a post, on its sides
WORST_SIGMA_M, WORST_BIAS_M = 0.020, 0.060  # of the TiM561 by its data sheet


@dataclass(frozen=True, kw_only=True)
class ScanErrors:
    """Standard deviations of what the robot believes wrongly.

    Args:
        sensor_m, sensor_rad: of the sensors' poses along the sweep, wandering within `sensor_tau_s`.
        stop_m, stop_rad: of where the robot stops, and tilt_rad of how it stands there.
        plant_m: of where it takes the plant to be from there.

    Source: the perception study for the sensors' poses; the rest is what missions show.
    """

    sensor_m: float = 0.0025
    sensor_rad: float = float(np.radians(0.15))
    sensor_tau_s: float = 0.6
    stop_m: float = 0.03
    stop_rad: float = float(np.radians(1.5))
    tilt_rad: float = float(np.radians(1.0))
    plant_m: float = 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueSpur:
    """A spur as it is, in base_link.

    `own`: it grows on the scanned vine; height_m: of its tip over the ground; seen: share of its axis with a free line
    of sight from somewhere along the sensors' way; beside_m: its tip from the sweep's middle, along the row.
    """

    tip: Array
    base: Array
    direction: Array
    diameter_m: float
    own: bool
    height_m: float
    seen: float
    beside_m: float

    @property
    def tilt_deg(self) -> float:
        """Angle from the vertical."""
        return float(np.degrees(np.arccos(np.clip(self.direction[2], -1.0, 1.0))))


@dataclass(frozen=True, kw_only=True, eq=False)
class ScannedVine:
    """What the robot has of a vine, and the truth.

    Attributes:
        scan: as `ScanVine` gives it.
        worst: the same sweep by a LiDAR as bad as its data sheet allows.
        foot: (2,) m, where the robot takes the trunk to be, in base_link.
        spurs: every spur of the row, in base_link.
    """

    scan: VineScan
    worst: Sweep
    foot: Array
    spurs: tuple[TrueSpur, ...]


def scan_simulated_vine(
    seed: int, style: str, goal: ScanVineGoal | None = None, errors: ScanErrors | None = None
) -> ScannedVine:
    """Parks beside a vine of a world and sweeps its sensors along it.

    Args:
        seed: of the world, the noise and the errors.
        style: cordon or gobelet.
        goal: how to scan; its plant does not count.
        errors: what the robot believes wrongly.
    """
    goal, errors = goal or ScanVineGoal(plant=""), errors or ScanErrors()
    rng = np.random.default_rng([seed, 8])
    robot = build_robot(DESCRIPTION)
    world = generate_vineyard(VineyardOptions(seed=seed, style=style, rows=1, vines_per_row=VINES))  # type: ignore[arg-type]
    plant = f"r0v{seed % VINES}"
    T_map_base = _park(world, robot, plant, errors, rng)
    trunk = world.site.plant(plant).position
    foot = transform(inverse(T_map_base), np.array([*trunk, T_map_base[2, 3]]))[:2] + rng.normal(0, errors.plant_m, 2)
    sensors = _Sensors(world, seed)
    sensors.sweep(T_map_base, robot, goal, float(foot[1]))
    believed = [T @ E for T, E in zip(sensors.T_base_hand, _wander(len(sensors.T_base_hand), errors, rng), strict=True)]
    return ScannedVine(
        scan=VineScan(
            sweep=_assembled(sensors.scans, believed),
            images=tuple(image for image, _ in sensors.images),
            T_base_camera=tuple(believed[k] @ _mount("camera_optical") for _, k in sensors.images),
            T_hand_camera=_mount("camera_optical"),
        ),
        worst=_assembled(_as_bad(sensors.scans, rng), believed),
        foot=foot,
        spurs=_true_spurs(world, plant, T_map_base, sensors),
    )


def _mount(name: str) -> Array:
    return DESCRIPTION.mounts[name].T_parent_sensor


def _park(world: World, robot: Robot, plant: str, errors: ScanErrors, rng: np.random.Generator) -> Array:
    """`T_map_base` of the robot at its first stop for a plant."""
    x, y, yaw = stop_pose(DESCRIPTION, world.site, plant, first_stop(robot, "vine"))
    x, y = np.array([x, y]) + rng.normal(0.0, errors.stop_m, 2)
    roll, pitch = rng.normal(0.0, errors.tilt_rad, 2) - [0.0, np.arctan(world.terrain.slope) * np.cos(yaw)]
    R = rotation_from_rpy(float(roll), float(pitch), float(yaw + rng.normal(0.0, errors.stop_rad)))
    return pose(R, (x, y, float(world.terrain.height(np.array([x, y]))) + DESCRIPTION.base.height))


class _Sensors:
    """Camera and LiDAR of a robot that is put where it should be, step after step."""

    def __init__(self, world: World, seed: int) -> None:
        self._physics = Physics(compose_seen(world, DESCRIPTION, 0))
        self.cast = cast = Raycaster(world).cast
        options = CameraOptions(latency_s=0.0)
        self._camera = SimulatedCamera(self._physics, lambda: self._physics.model, seed, options)
        self._lidar = SimulatedScanner(
            self._physics, Replica(self._physics.model), lambda origins, rays, _: cast(origins, rays), seed, TIM561
        )
        self.scans: list[LaserScan] = []
        self.images: list[tuple[RgbdImage, int]] = []  # with the index of the hand pose
        self.T_base_hand: list[Array] = []

    def sweep(self, T_map_base: Array, robot: Robot, goal: ScanVineGoal, row_y: float) -> None:
        """Puts the robot's hand along the line of a scan and keeps what its sensors see."""
        path = _joint_path(robot, goal, row_y)
        wanted = list(np.rint(np.linspace(0, len(path) - 1, goal.images)).astype(int))
        data = self._physics.data
        data.qpos[:] = self._physics.model.qpos0
        self._physics.put(BASE_JOINT, T_map_base)
        fingers, gripper = DESCRIPTION.gripper.joints, DESCRIPTION.gripper
        closed = [gripper.thumb_clear, gripper.closed_angle, gripper.closed_angle]
        data.qpos[self._physics.joint_qpos(fingers)] = closed
        arm = self._physics.joint_qpos(DESCRIPTION.arm.joints)
        for k, q in enumerate(path):
            data.qpos[arm] = q
            self._physics.clock.step = round(k * TIM561.period_s * STEPS_PER_SECOND)
            self._lidar.sample()
            self.scans.append(self._lidar.latest())
            if k in wanted:
                self._camera.sample()
                self.images.append((self._camera.latest(), k))
            self.T_base_hand.append(robot.hand_pose(q))
        self._camera.close()


def _joint_path(robot: Robot, goal: ScanVineGoal, row_y: float) -> Array:
    """Joint angles (steps, n) along the way of a scan, one for each turn of the LiDAR."""
    sweep = sweep_path(goal, DESCRIPTION.arm.T_base_link_arm_base, row_y)
    line = np.array([robot.in_arm_base(sweep.at(float(t))) for t in np.arange(0.0, sweep.times[-1], TIM561.period_s)])
    for way in (line, line[::-1]):
        for solution in inverse_all(robot.arm, way[0], DESCRIPTION.arm.poses["ready_left_fore"]):
            path = inverse_path(robot.arm, way, solution.q)
            if path is not None:
                return path
    raise InvalidInput(f"no arm posture follows the scan of {goal}")


def _wander(steps: int, errors: ScanErrors, rng: np.random.Generator) -> list[Array]:
    """Small poses (4, 4), one a scan, that wander around identity (Ornstein-Uhlenbeck)."""
    keep = np.exp(-TIM561.period_s / errors.sensor_tau_s)
    state, found = rng.normal(size=6), []
    for _ in range(steps):
        found.append(pose(rotation_exp(errors.sensor_rad * state[3:]), errors.sensor_m * state[:3]))
        state = keep * state + np.sqrt(1 - keep**2) * rng.normal(size=6)
    return found


def _assembled(scans: list[LaserScan], T_base_hand: list[Array]) -> Sweep:
    T = [T_hand @ _mount("wrist_lidar") for T_hand in T_base_hand]
    return assemble(scans, T, SWEEP)


def _as_bad(scans: list[LaserScan], rng: np.random.Generator) -> list[LaserScan]:
    """The scans with the largest errors that the data sheet allows, the systematic one of either sign."""
    sigma = float(np.sqrt(WORST_SIGMA_M**2 - TIM561.errors.sigma**2))
    bias = WORST_BIAS_M * rng.choice([-1.0, 1.0])
    return [replace(s, ranges=s.ranges + bias + sigma * rng.standard_normal(len(s.ranges))) for s in scans]


def _true_spurs(world: World, plant: str, T_map_base: Array, sensors: _Sensors) -> tuple[TrueSpur, ...]:
    T_base_map = inverse(T_map_base)
    hands = np.array([T[:3, 3] for T in sensors.T_base_hand])
    places = transform(T_map_base, hands[np.linspace(0, len(hands) - 1, 9).astype(int)])
    spurs = []
    for spur in world.spurs:
        tip, base = transform(T_base_map, np.array([spur.tip, spur.base]))
        spurs.append(
            TrueSpur(
                tip=tip,
                base=base,
                direction=T_base_map[:3, :3] @ spur.direction,
                diameter_m=spur.diameter,
                own=spur.plant == plant,
                height_m=float(spur.tip[2] - world.terrain.height(spur.tip[:2])),
                seen=_seen(np.linspace(0.05, 0.97, 12)[:, None] * (spur.tip - spur.base) + spur.base, places, sensors),
                beside_m=float(tip[0] - hands[:, 0].mean()),
            )
        )
    return tuple(spurs)


def _seen(points: Array, places: Array, sensors: Any) -> float:
    """Share of points (n, 3) with a free line of sight, but for 20 mm, from one of the places (m, 3), map frame."""
    rays = points[None] - places[:, None]
    far = np.linalg.norm(rays, axis=2)
    hits = sensors.cast(
        np.broadcast_to(places[:, None], rays.shape).reshape(-1, 3), (rays / far[..., None]).reshape(-1, 3)
    )
    return float((hits.reshape(far.shape) > far - 0.02).any(axis=0).mean())
