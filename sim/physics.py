"""The MuJoCo model with its state, advanced in whole steps of 2 ms, and the clock that counts them."""

from __future__ import annotations

import logging

import mujoco
import numpy as np

from grape.errors import DriverError, InvalidInput
from grape.geometry import rotation_to_quaternion
from grape.messages import Array
from grape.sim.culling import LOOK_STEPS, ContactCulling

_log = logging.getLogger(__name__)
STEPS_PER_SECOND = 500
_ABSURD_SPEED_2 = 1e10  # (m/s or rad/s)^2, summed over all degrees of freedom
STEP_S = 1.0 / STEPS_PER_SECOND


class SimulatedClock:
    """Simulated time as an integer number of steps, so that it never drifts."""

    def __init__(self) -> None:
        self.step = 0

    def now(self) -> float:
        """Seconds since the start of the simulation."""
        return self.step / STEPS_PER_SECOND


class Physics:
    """Model, state and clock of one simulated scene; what drivers act on and sensors sample from."""

    def __init__(self, model: mujoco.MjModel) -> None:
        mujoco.set_mju_user_warning(_log.info)  # by default MuJoCo writes a file into the working folder
        self.model = model
        self.data = mujoco.MjData(model)
        self.clock = SimulatedClock()
        self._speeds = self.data.qvel
        mujoco.mj_kinematics(model, self.data)
        self._culling = ContactCulling(model, self.data)
        self._next_look = 0

    def rearranged(self) -> None:
        """Say that bodies were put elsewhere: contacts are searched for everywhere until they have been looked at."""
        self._culling.show_all()
        self._next_look = self.clock.step + 1

    def put(self, joint: str, T_map_body: Array) -> None:
        """Set the free joint of a body to a pose (4, 4); velocities stay as they are.

        Raises:
            InvalidInput: the model has no such joint.
        """
        address = self.model.jnt_qposadr[self.identify("joint", joint)]
        self.data.qpos[address : address + 3] = T_map_body[:3, 3]
        self.data.qpos[address + 3 : address + 7] = rotation_to_quaternion(T_map_body[:3, :3])

    def step(self) -> None:
        """Advance the state by one step.

        Raises:
            DriverError: the state is no longer finite, or absurdly fast; nothing that the simulation says can be
                trusted any more.
        """
        if not self._speeds @ self._speeds < _ABSURD_SPEED_2:  # written so that NaN counts as absurd
            raise DriverError(f"the simulated physics has diverged at {self.clock.now():.3f} s")
        if self.clock.step >= self._next_look:
            self._culling.look(self.data)
            self._next_look = self.clock.step + LOOK_STEPS
        mujoco.mj_step(self.model, self.data)
        self.clock.step += 1

    def snapshot(self) -> Array:
        """What a `Replica` needs to show the present state: joints, and the poses of bodies that are moved by hand."""
        data = self.data
        if not self.model.nmocap:
            return data.qpos.copy()
        return np.concatenate([data.qpos, data.mocap_pos.ravel(), data.mocap_quat.ravel()])

    def joint_qpos(self, names: tuple[str, ...]) -> Array:
        """Addresses (n,) of one-dimensional joints in `data.qpos`."""
        return np.array([self.model.jnt_qposadr[self.identify("joint", name)] for name in names])

    def joint_qvel(self, names: tuple[str, ...]) -> Array:
        """Addresses (n,) of one-dimensional joints in `data.qvel`."""
        return np.array([self.model.jnt_dofadr[self.identify("joint", name)] for name in names])

    def actuators(self, names: tuple[str, ...]) -> Array:
        """Indices (n,) of the actuators that drive the joints `names`.

        Raises:
            InvalidInput: no actuator drives one of them.
        """
        joints = [self.identify("joint", name) for name in names]
        driven = [int(joint) for joint in self.model.actuator_trnid[:, 0]]
        missing = [name for name, joint in zip(names, joints, strict=True) if joint not in driven]
        if missing:
            raise InvalidInput(f"no actuator drives the joints {missing}")
        return np.array([driven.index(joint) for joint in joints])

    def identify(self, kind: str, name: str) -> int:
        """Index of a named element; `kind` as in MJCF: joint, body, site, camera, geom.

        Raises:
            InvalidInput: the model has no such element.
        """
        index = mujoco.mj_name2id(self.model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name)
        if index < 0:
            raise InvalidInput(f"the model has no {kind} named {name!r}")
        return int(index)


class Replica:
    """A second state of a model in which old snapshots are looked at, so that the running one stays untouched."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self._shown: bytes = b""

    def show(self, snapshot: Array) -> mujoco.MjData:
        """The state with the poses of all bodies, geoms, sites and cameras at a `Physics.snapshot`."""
        key = snapshot.tobytes()
        if key != self._shown:
            joints, moved = self.model.nq, self.model.nq + 3 * self.model.nmocap
            self.data.qpos[:] = snapshot[:joints]
            self.data.mocap_pos[:] = snapshot[joints:moved].reshape(-1, 3)
            self.data.mocap_quat[:] = snapshot[moved:].reshape(-1, 4)
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_camlight(self.model, self.data)
            self._shown = key
        return self.data

    def site_pose(self, snapshot: Array, site: int) -> Array:
        """`T_map_site` (4, 4) at a `Physics.snapshot`."""
        data = self.show(snapshot)
        T = np.eye(4)
        T[:3, :3] = data.site_xmat[site].reshape(3, 3)
        T[:3, 3] = data.site_xpos[site]
        return T
