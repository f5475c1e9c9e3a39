"""The simulated operator: a person at the refill point who fills the feeder of a robot that calls him."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from grape.errors import InvalidInput
from grape.geometry import inverse, transform
from grape.messages import Array, Refilled
from grape.robots import RobotDescription
from grape.sim.compose import BASE_BODY, DISPENSER
from grape.sim.dispenser import LoopReader
from grape.sim.physics import STEPS_PER_SECOND, Physics
from grape.sim.sensors.noise import FrameNoise
from grape.sim.stock import in_store, take_out
from grape.site import RefillPoint

_LAMP_STEPS = STEPS_PER_SECOND // 2  # a call that is not renewed goes out


@dataclass(frozen=True, kw_only=True)
class OperatorOptions:
    """How the operator works.

    Attributes:
        fill: a refill brings the feeder up to so many dispensers, or to as many as it has levels.
        after_s: shortest and longest time until the dispensers are in, drawn for each refill.
        confirm_s: from then until he confirms.
        miscount: added to the number that he says.
        reach_m: how far from a refill point the robot may stand.
        clear_m: height over the topmost level above which the hand is out of the way.
        still: m/s of the base and rad/s of arm joints below which the robot stands still.
    """

    fill: int = 8
    after_s: tuple[float, float] = (15.0, 40.0)
    confirm_s: float = 3.0
    miscount: int = 0
    reach_m: float = 0.6
    clear_m: float = 0.08
    still: float = 0.02

    def __post_init__(self) -> None:
        if not 0.0 <= self.after_s[0] <= self.after_s[1] or self.fill < 1:
            raise InvalidInput(f"an operator needs fill >= 1 and after_s as (shortest, longest), got {self}")


class SimulatedOperator:
    """Comes when he is called, fills the feeder from above the topmost dispenser, and says how many he put in.

    Args:
        physics: the scene, with dispensers in store.
        points: where he serves.
        seed: of how long he takes.
    """

    STATE = ("_called_step", "_due_step", "_confirm_step", "_put", "_count", "_added", "_stamps")

    def __init__(
        self,
        physics: Physics,
        robot: RobotDescription,
        points: Sequence[RefillPoint],
        seed: int,
        options: OperatorOptions | None = None,
    ) -> None:
        self.period_steps = STEPS_PER_SECOND // 10
        self._physics, self._robot, self._points = physics, robot, tuple(points)
        self._options = options or OperatorOptions()
        self._noise = FrameNoise(seed, "operator")
        model = physics.model
        names = [model.body(k).name for k in range(model.nbody)]
        loops = [name for name in names if name.startswith(DISPENSER) and name.removeprefix(DISPENSER).isdigit()]
        self._loops = {name: LoopReader.of(model, name) for name in loops}
        arm = model.body_rootid == physics.identify("body", BASE_BODY)
        self._hand_geoms = np.flatnonzero(np.isin(model.geom_bodyid, _below(model, "link_1")) & arm[model.geom_bodyid])
        self._joints = physics.joint_qvel(robot.arm.joints)
        self._called_step = -_LAMP_STEPS
        self._due_step = self._confirm_step = -1
        self._put = self._count = 0
        most = 1 + len(self._stored())
        self._added, self._stamps = np.zeros(most, dtype=int), np.zeros(most)

    def call(self) -> None:
        """Light the lamp for half a second."""
        self._called_step = self._physics.clock.step

    def refilled(self, after: int = 0) -> tuple[Refilled, ...]:
        """Every refill that was confirmed and has a number above `after`, oldest first."""
        return tuple(
            Refilled(stamp=float(self._stamps[k]), number=k + 1, added=int(self._added[k]))
            for k in range(max(after, 0), self._count)
        )

    def look(self) -> None:
        """One look, ten times a second: come, fill, confirm."""
        step = self._physics.clock.step
        if self._confirm_step >= 0:
            if step >= self._confirm_step:
                self._confirm()
            return
        if step - self._called_step >= _LAMP_STEPS or self._count == len(self._added) or not self._may_work():
            self._due_step = -1
        elif self._due_step < 0:
            takes_s = self._noise.frame(self._count).uniform(*self._options.after_s)
            self._due_step = step + round(takes_s * STEPS_PER_SECOND)
        elif step >= self._due_step:
            self._put = self._fill()
            self._due_step, self._confirm_step = -1, step + round(self._options.confirm_s * STEPS_PER_SECOND)

    def _confirm(self) -> None:
        said = max(0, self._put + self._options.miscount)
        self._added[self._count], self._stamps[self._count] = said, self._physics.clock.now()
        self._count, self._confirm_step = self._count + 1, -1

    def _may_work(self) -> bool:
        """Whether the base stands at a refill point, and nothing moves or is in the way over the feeder."""
        data, options = self._physics.data, self._options
        base = data.body(BASE_BODY)
        near = any(np.hypot(*(base.xpos[:2] - point.position)) < options.reach_m for point in self._points)
        if not near or np.abs(data.qvel[self._joints]).max() > options.still:
            return False
        if np.linalg.norm(base.cvel[3:]) > options.still:
            return False
        places = data.geom_xpos[self._hand_geoms]
        T_feeder_map = inverse(self._T_map_base() @ self._robot.feeder.T_base_link_level(self._robot.feeder.levels - 1))
        local = transform(T_feeder_map, places)
        return not ((np.hypot(local[:, 0], local[:, 1]) < 0.2) & (local[:, 2] < options.clear_m)).any()

    def _fill(self) -> int:
        """Put dispensers on the empty levels over the topmost one; returns how many."""
        feeder, physics = self._robot.feeder, self._physics
        T_map_base = self._T_map_base()
        T_level_map = inverse(T_map_base @ feeder.T_base_link_level(0))
        centres = [loop.polyline(physics.data).mean(axis=0) for loop in self._loops.values()]
        places = transform(T_level_map, np.array(centres))
        inside = [p[2] for p in places if np.hypot(p[0], p[1]) < 0.06 and -0.03 < p[2] < 0.25]
        first = 1 + max((round(z / feeder.pitch) for z in inside), default=-1)
        levels = range(first, min(self._options.fill, feeder.levels))
        put = list(zip(levels, self._stored(), strict=False))
        for level, name in put:
            take_out(physics.model, physics.data, name, T_map_base @ feeder.T_base_link_level(level))
        physics.rearranged()
        return len(put)

    def _stored(self) -> list[str]:
        """Names of the dispensers that are ready to be put in."""
        model, qpos = self._physics.model, self._physics.data.qpos
        heights = {name: qpos[model.joint(name).qposadr[0] + 2] for name in self._loops}
        return [name for name, z in heights.items() if in_store(float(z))]

    def _T_map_base(self) -> Array:
        base, T = self._physics.data.body(BASE_BODY), np.eye(4)
        T[:3, :3], T[:3, 3] = base.xmat.reshape(3, 3), base.xpos
        return T


def _below(model: mujoco.MjModel, name: str) -> list[int]:
    """Ids of a body and of everything that hangs on it."""
    found = {int(model.body(name).id)}
    for body in range(model.nbody):
        if int(model.body_parentid[body]) in found:
            found.add(body)
    return sorted(found)
