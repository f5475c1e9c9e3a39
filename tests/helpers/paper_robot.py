"""A robot on paper for the tests of actions: exact actuators, a drawn scene, and the real models of the robot.

Everything is given in base_link.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from paper_drivers import PaperArm, PaperBase, PaperCamera, PaperFingers, PaperOperator, PaperScanner
from paper_scene import Scene

from grape.actions.core import Context, Feedback, InlineJobs
from grape.drivers import Drivers
from grape.errors import ActionFailed
from grape.geodesy import Datum
from grape.kinematics import inverse_all
from grape.messages import Odometry
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.site import Area, Plant, Row, Site
from grape.world import World


class Log:
    """Events and pictures, kept."""

    def __init__(self) -> None:
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.pictures: list[str] = []

    def event(self, kind: str, /, **fields: Any) -> None:
        self.events.append((kind, fields))

    def picture(self, name: str, bgr: Any) -> None:
        self.pictures.append(name)

    def last(self, kind: str) -> dict[str, Any]:
        return next(fields for name, fields in reversed(self.events) if name == kind)


class Bench:
    """The robot on paper with everything that an action needs; one `advance` is one beat."""

    def __init__(self, robot: Any, site: Site, ledger: Any, start: tuple[float, float, float]) -> None:
        self.beats = 0
        self.robot, self.site, self.ledger = robot, site, ledger
        self.scene, self.log = Scene(), Log()
        self.base, self.arm, self.fingers = PaperBase(*start), PaperArm(DESCRIPTION.arm.poses["travel"]), PaperFingers()
        self.camera = PaperCamera(self.scene, robot)
        self.scanners = {"front_laser": PaperScanner(), "wrist_lidar": PaperScanner()}
        self.operator = PaperOperator()
        self.localized = True
        self.bias = np.zeros(6)  # rad, the arm's encoders tell so much too much
        none: Any = None
        drivers = Drivers(
            base=self.base, arm=self.arm, gripper=self.fingers, camera=self.camera, imu=none, gnss=none,
            scans=self.scanners, operator=self.operator,
        )  # fmt: skip
        self.world = World(site=site)
        self.ctx = Context(
            clock=self,
            world=self.world,
            drivers=drivers,
            robot=robot,
            jobs=InlineJobs(),
            log=self.log,
            ledger=ledger,
            rng=np.random.default_rng(0),
        )
        frames, arm = self.world.frames, DESCRIPTION.arm
        frames.set_fixed("base_link", arm.base_frame, arm.T_base_link_arm_base)
        for name, mount in DESCRIPTION.mounts.items():
            frames.set_fixed(mount.parent, name, mount.T_parent_sensor)
        self._sense()

    def now(self) -> float:
        return self.beats / 100

    @property
    def hand(self) -> Any:
        """`T_base_hand` as it is."""
        return self.robot.hand_pose(self.arm.q)

    def put_hand(self, T_base_hand: Any) -> None:
        """Place the arm so that the hand is somewhere, without moving there."""
        found = inverse_all(self.robot.arm, self.robot.in_arm_base(T_base_hand), self.arm.q)
        assert found, "out of reach"
        self.put_arm(found[0].q)

    def put_arm(self, q: Any) -> None:
        """Place the arm at joint angles, and let the camera see from there."""
        self.arm.q = np.array(q)
        self.advance(20)

    def advance(self, beats: int = 1) -> None:
        for _ in range(beats):
            self.beats += 1
            for part in (self.base, self.arm, self.fingers):
                part.advance(self.now(), 0.01)
            self._sense()

    def run(self, action: Generator[Feedback, None, Any], limit_s: float = 60.0) -> Any:
        """Beats until the action ends; its result."""
        end_s = self.now() + limit_s
        try:
            while self.now() < end_s:
                assert isinstance(next(action), Feedback)
                self.advance()
        except StopIteration as stop:
            return stop.value
        raise AssertionError(f"not done after {limit_s} s")

    def failure(self, action: Generator[Feedback, None, Any], limit_s: float = 60.0) -> ActionFailed:
        """Beats until the action fails; its failure."""
        with pytest.raises(ActionFailed) as failed:
            self.run(action, limit_s)
        return failed.value

    def _sense(self) -> None:
        world, now = self.world, self.now()
        world.localized = self.localized
        told = self.arm.latest()
        arm = world.take_arm(replace(told, position=told.position + self.bias))
        world.gripper = self.fingers.latest()
        six = np.zeros((6, 6))
        world.odometry = Odometry(
            stamp=now, frame_id="map", child_frame_id="base_link", pose=self.base.T_map_base,
            linear=np.array([self.base.v, 0.0, 0.0]), angular=np.array([0.0, 0.0, self.base.w]),
            pose_covariance=six, twist_covariance=six,
        )  # fmt: skip
        world.frames.push("map", "base_link", self.base.T_map_base, now)
        world.frames.push("arm_base", "hand", self.robot.arm.fk(arm.position), now)
        self.camera.advance(now, self.arm.q, float(self.fingers.angles[1]))
        for scanner in self.scanners.values():
            scanner.advance(now)


PLANTS = (("n0", "nail"), ("v0", "plant"), ("v1", "plant"))


def vine_row() -> Site:
    """One row along map x, worked from the south, with a nail at x = 1 and two vines."""
    row = Row(id="r0", side="right", line=np.array([[0.0, 0.0], [6.0, 0.0]]))
    nail = Plant(
        id="n0", row="r0", kind="nail", side="right", position=np.array([1.0, 0.0]), markers=(10, 11),
        height_m=0.8, yaw_rad=-np.pi / 2, reach_m=0.1325,
    )  # fmt: skip
    vines = [
        Plant(id=f"v{k}", row="r0", kind="vine", side="right", position=np.array([2.0 + k, 0.0])) for k in range(2)
    ]
    ground = Area(id="west", polygon=np.array([[-6.0, -4.0], [12.0, -4.0], [12.0, 4.0], [-6.0, 4.0]]))
    fence = Area(id="fence", polygon=np.array([[-0.3, -0.28], [6.3, -0.28], [6.3, 0.28], [-0.3, 0.28]]))
    return Site(
        datum=Datum(latitude_deg=42.0, longitude_deg=3.0), rows=(row,), plants=(nail, *vines), headlands=(ground,),
        fences=(fence,), start=np.array([-3.0, -1.3]), start_heading_rad=0.0,
    )  # fmt: skip
