"""What the manipulation bench works on: the robot beside a generated vine, as shapes and as the clouds seen of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from grape.actions.robot import Robot, build_robot
from grape.geometry import pose, transform
from grape.messages import Array
from grape.perception.cloud import voxel_grid
from grape.planning import CheckerOptions, StateChecker, build_distance_field

ROW_M = 0.84  # from base_link to the row on its left
CAPSULES = 200  # of the vines, posts and wires, those nearest to the arm's base
CLOUD_POINTS = 100_000
NOISE_M = 0.0006
PADDING_M = 0.01


@dataclass(frozen=True, kw_only=True)
class BenchScene:
    """Everything in base_link.

    Attributes:
        capsules: (p0, p1, radius) of the vines, posts and wires nearest to the arm.
        cloud: (n, 3) m, what cameras around the vine see of them, 5 mm apart.
        vine: (100 000, 3) m, what one sweep of the camera sees of one vine, with its noise.
        eyes: (k, 3) m, where the camera was for that.
        checker: our check against the cloud.
    """

    robot: Robot
    capsules: tuple[tuple[Array, Array, float], ...]
    cloud: Array
    vine: Array
    eyes: Array
    checker: StateChecker

    def free_states(self, count: int, rng: np.random.Generator) -> Array:
        """(count, n) rad, arm states around the one from which vines are worked that are free."""
        found: list[Array] = []
        while len(found) < count:
            q = self.states(1, rng)[0]
            if self.checker.is_valid(q):
                found.append(q)
        return np.array(found)

    def states(self, count: int, rng: np.random.Generator) -> Array:
        """(count, n) rad, arm states around the one from which vines are worked."""
        arm = self.robot.description.arm
        near = arm.poses["ready_left_fore"] + rng.uniform(-1.2, 1.2, (count, len(arm.joints)))
        lower, upper = self.robot.planner.bounds()
        return np.asarray(np.clip(near, lower, upper))


def build_scene(seed: int = 0) -> BenchScene:
    """The robot beside the third vine of a generated row."""
    from grape.robots.husky_jaco2 import DESCRIPTION
    from grape.sim.raycast import Raycaster
    from grape.sim.worlds import VineyardOptions, generate_vineyard

    world = generate_vineyard(VineyardOptions(rows=1, vines_per_row=6, seed=seed, slope=0.0, roughness_rms=0.0))
    x, y = next(plant.position for plant in world.site.plants if plant.id == "r0v2")
    T_map_base = pose(translation=(float(x) - 0.47, float(y) - ROW_M, DESCRIPTION.base.height))
    T_base_map = np.linalg.inv(T_map_base)
    rng = np.random.default_rng(seed)
    robot = build_robot(DESCRIPTION)
    shoulder = DESCRIPTION.arm.T_base_link_arm_base[:3, 3]
    pieces = [(*transform(T_base_map, np.array([piece.p0, piece.p1])), piece.radius) for piece in world.capsules]
    pieces.sort(key=lambda piece: min(np.linalg.norm(end - shoulder) for end in piece[:2]))
    raycaster = Raycaster(world)
    around = np.array([[dx, dy, 0.75] for dx in (-0.3, 0.3, 0.9) for dy in (0.1, ROW_M + 0.7)])
    views = [_see(raycaster, T_map_base, eye, np.array([eye[0], ROW_M, 0.6]), 1.4, 600) for eye in around]
    cloud = voxel_grid(np.vstack(views), 0.005)
    eyes = np.array([[dx, ROW_M - 0.55, 0.75] for dx in np.linspace(0.17, 0.77, 8)])
    seen = np.vstack([_see(raycaster, T_map_base, eye, np.array([eye[0], ROW_M, 0.6]), 0.7, 500) for eye in eyes])
    seen = seen[(np.abs(seen[:, 0] - 0.47) < 0.6) & (np.abs(seen[:, 1] - ROW_M) < 0.36) & (seen[:, 2] > 0.12)]
    vine = seen[rng.choice(len(seen), CLOUD_POINTS, replace=len(seen) < CLOUD_POINTS)]
    return BenchScene(
        robot=robot,
        capsules=tuple(pieces[:CAPSULES]),
        cloud=cloud,
        vine=vine + rng.normal(0.0, NOISE_M, vine.shape),
        eyes=eyes,
        checker=StateChecker(robot.body, build_distance_field(cloud), CheckerOptions(padding_m=PADDING_M)),
    )


def _see(raycaster: Any, T_map_base: Array, eye: Array, target: Array, half_width: float, count: int) -> Array:
    """(n, 3) m in base_link: where rays from an eye through a square grid around a target meet something near."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    grid = np.linspace(-half_width, half_width, count)
    u, v = (axis.ravel() for axis in np.meshgrid(grid, grid))
    directions = forward + u[:, None] * right + v[:, None] * up
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    R = T_map_base[:3, :3]
    origins = np.tile(transform(T_map_base, eye[None]), (len(directions), 1))
    ranges = raycaster.cast(origins, directions @ R.T)
    points = eye + ranges[:, None] * directions
    return points[np.isfinite(ranges) & (ranges < 1.6) & (points[:, 2] > -0.05)]
