"""Mud under the wheels: patches of ground on which they have less friction."""

from __future__ import annotations

import mujoco
import numpy as np

from grape.messages import Array
from grape.robots import RobotDescription
from grape.sim.compose import BASE_JOINT
from grape.sim.physics import Physics
from grape.sim.worlds import Terrain


class Mud:
    """Gives each wheel the friction of the ground under it, before each physics step.

    The wheels' contacts have priority over the ground's (`robots/*/*.xml`), so their own sliding friction is that of
    the contact. Which it is follows from the pose alone, so a scene that comes back from a file needs nothing more.

    Args:
        physics: the scene; its model's wheels change.
        terrain: where the mud is.
        robot: whose wheels.
    """

    def __init__(self, physics: Physics, terrain: Terrain, robot: RobotDescription) -> None:
        self._physics, self._terrain = physics, terrain
        model = physics.model
        bodies = [int(model.jnt_bodyid[physics.identify("joint", name)]) for name in robot.base.wheel_joints]
        self._mounts = model.body_pos[bodies].copy()  # (wheels, 3) m, base_link
        self._geoms = np.array([_touching_geom(model, body) for body in bodies])
        self._dry = model.geom_friction[self._geoms, 0].copy()
        self._base = int(model.jnt_qposadr[physics.identify("joint", BASE_JOINT)])

    def act(self) -> None:
        """Set the friction of every wheel by where it is."""
        if len(self._terrain.mud):
            wet = self._terrain.muddy(self._wheels())
            friction = np.where(wet, np.minimum(self._terrain.mud_friction, self._dry), self._dry)
            self._physics.model.geom_friction[self._geoms, 0] = friction

    def _wheels(self) -> Array:
        """(wheels, 2) m, their centres in the map."""
        base = self._physics.data.qpos[self._base : self._base + 7]
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, base[3:])
        centres: Array = base[:2] + self._mounts @ R.reshape(3, 3)[:2].T
        return centres


def _touching_geom(model: mujoco.MjModel, body: int) -> int:
    """The geom of a wheel that touches the ground."""
    first = int(model.body_geomadr[body])
    geoms = range(first, first + int(model.body_geomnum[body]))
    return next(geom for geom in geoms if model.geom_contype[geom])
