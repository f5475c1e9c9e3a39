"""A robot that drives through a simulated vineyard by its own estimate, without a mission and without dispensers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grape.actions.drive_to_pose import DriveGoal, drive_to_pose
from grape.actions.wait_for_localization import WaitForLocalizationGoal, wait_for_localization
from grape.errors import ActionFailed
from grape.experiments.robot_bench import RobotBench
from grape.geometry import yaw_of
from grape.messages import Array
from grape.mission.sense import Sensing
from grape.navigation.path import in_frame_of
from grape.robots import RobotDescription
from grape.sim.simulation import SimulationOptions
from grape.sim.worlds import World

REST_S = 1.0  # after a drive, before it is judged


@dataclass(frozen=True, kw_only=True)
class Driven:
    """One drive, judged by the truth where no other word is said. Lengths in m, angles in degrees, times in s.

    Attributes:
        reached: the action succeeded; else `reason` and `detail` say why not.
        along_m, across_m, yaw_deg: how far base_link stands from its goal, along the goal's heading and to its left.
        estimate_off_m, estimate_off_deg: how far the robot's own estimate is off where it stands.
        touched: pairs of parts that touched for the first time on this drive though they should not.
        fences: how often the footprint entered a fence.
        recoveries: what the drive told of detours and retreats.
        track: x y of base_link in map, five a second.
    """

    reached: bool
    reason: str
    detail: str
    along_m: float
    across_m: float
    yaw_deg: float
    estimate_off_m: float
    estimate_off_deg: float
    time_s: float
    touched: Sequence[Sequence[str]]
    fences: int
    recoveries: Sequence[str]
    track: Sequence[Sequence[float]] = ()

    @property
    def off_m(self) -> float:
        """Distance from the goal."""
        return float(np.hypot(self.along_m, self.across_m))


class BaseBench(RobotBench):
    """One robot that senses as in a mission, at the start of a vineyard, its arm in the travel pose.

    Args:
        description: of the robot.
        truth: the vineyard.
        seed: of the sensors' noise.
    """

    def __init__(self, description: RobotDescription, truth: World, seed: int) -> None:
        super().__init__(description, truth, seed, truth.site.plants[0].id, SimulationOptions(dispensers=0))
        self._sensing = Sensing(self.simulation.drivers, self.ctx.world, self.robot)
        self._sense()
        self.run(wait_for_localization(WaitForLocalizationGoal(), self.ctx))

    def drive(self, goal: DriveGoal) -> Driven:
        """Drive to a pose, let the robot come to rest, and see where it really is."""
        referee, begun = self.simulation.referee, self.ctx.clock.now()
        before = (len(referee.path), len(referee.collisions), self._fences(), len(self.log.of("recovery")))
        reached, reason, detail = True, "", ""
        try:
            self.run(drive_to_pose(goal, self.ctx), limit_s=goal.timeout_s + 10.0)
        except ActionFailed as failure:
            reached, reason, detail = False, str(failure.reason), failure.detail
        ended = self.ctx.clock.now()
        self.rest()
        true, said = self.true_pose(), self.estimate()
        along, across, yaw = in_frame_of(true, np.array([goal.x, goal.y, goal.yaw]))
        missed = in_frame_of(said, true)
        return Driven(
            reached=reached,
            reason=reason,
            detail=detail,
            along_m=float(along),
            across_m=float(across),
            yaw_deg=float(np.degrees(yaw)),
            estimate_off_m=float(np.hypot(missed[0], missed[1])),
            estimate_off_deg=float(np.degrees(missed[2])),
            time_s=ended - begun,
            touched=[(c.a, c.b) for c in referee.collisions[before[1] :]],
            fences=self._fences() - before[2],
            recoveries=[f"{told['how']}: {told['why']}" for told in self.log.of("recovery")[before[3] :]],
            track=[(round(s.x, 3), round(s.y, 3)) for s in referee.path[before[0] :]],
        )

    def rest(self, seconds: float = REST_S) -> None:
        """Let time pass."""
        for _ in range(round(100 * seconds)):
            self.simulation.advance()
            self._sense()

    def true_pose(self) -> Array:
        """(3,) x y yaw of base_link in map as it really is."""
        return _planar(self.simulation.referee.true_pose())

    def estimate(self) -> Array:
        """(3,) x y yaw of base_link in map as the robot has it."""
        return _planar(self.ctx.world.base_pose())

    def _sense(self) -> None:
        self._sensing.update(self.ctx.clock.now())
        self.simulation.referee.observe(self.ctx.world.odometry)

    def _fences(self) -> int:
        crossings: int = self.simulation.referee.verdict()["truth"]["fence_crossings"]
        return crossings


def _planar(T_map_base: Array) -> Array:
    return np.array([T_map_base[0, 3], T_map_base[1, 3], yaw_of(T_map_base)])
