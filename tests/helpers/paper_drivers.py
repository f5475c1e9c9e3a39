"""Drivers of a robot on paper: set-points are followed exactly, and can be made to fail."""

from __future__ import annotations

from typing import Any

import numpy as np
from paper_scene import INFO, Scene

from grape.errors import StaleData
from grape.geometry import pose, rotation_z
from grape.messages import GripperState, JointState, LaserScan, Refilled, RgbdImage, Twist
from grape.robots.husky_jaco2 import DESCRIPTION

FRAME_S = 0.066
GROUND_Z = 0.132  # of base_link


class Actuator:
    """What the three actuators share: set-points and stops are counted, an answer may be late or missing."""

    def __init__(self) -> None:
        self.sent = self.stops = 0
        self.silent = False

    def _answer(self, message: Any) -> Any:
        if self.silent:
            raise StaleData("nothing measured")
        return message


class PaperArm(Actuator):
    """Follows joint velocities exactly, unless it is stuck."""

    def __init__(self, q: Any) -> None:
        super().__init__()
        self.q, self.velocity, self.stuck, self.stamp = np.array(q), np.zeros(6), False, 0.0

    def send(self, velocity: Any) -> Any:
        assert np.shape(velocity) == (6,) and np.isfinite(velocity).all()
        self.sent += 1
        self.velocity = np.clip(velocity, -DESCRIPTION.arm.velocity_max, DESCRIPTION.arm.velocity_max)
        return self.velocity

    def stop(self) -> None:
        self.velocity = np.zeros(6)
        self.stops += 1

    def latest(self, max_age_s: float | None = None) -> JointState:
        names, zeros = DESCRIPTION.arm.joints, np.zeros(6)
        state = JointState(stamp=self.stamp, name=names, position=self.q, velocity=self.velocity, effort=zeros)
        return self._answer(state)

    def advance(self, now: float, dt: float) -> None:
        self.stamp = now
        if not self.stuck:
            self.q = self.q + self.velocity * dt


class PaperFingers(Actuator):
    """Follows finger angles at 1 rad/s."""

    def __init__(self) -> None:
        super().__init__()
        gripper = DESCRIPTION.gripper
        self.angles = np.array([gripper.thumb_clear, gripper.closed_angle, gripper.closed_angle])
        self.target, self.stamp = self.angles, 0.0

    def send(self, position: Any) -> Any:
        assert np.shape(position) == (3,) and np.isfinite(position).all()
        self.sent += 1
        self.target = np.array(position)
        return self.target

    def stop(self) -> None:
        self.target = self.angles
        self.stops += 1

    def latest(self, max_age_s: float | None = None) -> GripperState:
        return self._answer(GripperState(stamp=self.stamp, position=self.angles, velocity=np.zeros(3)))

    def advance(self, now: float, dt: float) -> None:
        self.stamp = now
        self.angles = self.angles + np.clip(self.target - self.angles, -dt, dt)


class PaperBase(Actuator):
    """Follows body velocities exactly."""

    def __init__(self, x: float, y: float, yaw: float) -> None:
        super().__init__()
        self.pose, self.v, self.w = np.array([x, y, yaw]), 0.0, 0.0

    def send(self, linear_x: float, angular_z: float) -> Twist:
        self.sent += 1
        self.v, self.w = linear_x, angular_z
        return Twist(stamp=0.0, linear=np.array([self.v, 0.0, 0.0]), angular=np.array([0.0, 0.0, self.w]))

    def stop(self) -> None:
        self.v = self.w = 0.0
        self.stops += 1

    def latest(self, max_age_s: float | None = None) -> JointState:
        zeros = np.zeros(4)
        wheels = DESCRIPTION.base.wheel_joints
        return self._answer(JointState(stamp=0.0, name=wheels, position=zeros, velocity=zeros, effort=zeros))

    @property
    def T_map_base(self) -> Any:
        x, y, yaw = self.pose
        return pose(rotation_z(yaw), (x, y, GROUND_Z))

    def advance(self, now: float, dt: float) -> None:
        yaw = self.pose[2]
        self.pose = self.pose + dt * np.array([self.v * np.cos(yaw), self.v * np.sin(yaw), self.w])


class PaperCamera:
    """A camera at 15 Hz that shows a scene one frame late; `frozen` holds its last frame."""

    def __init__(self, scene: Scene, robot: Any) -> None:
        self.scene, self.frozen, self.silent = scene, False, False
        self._robot, self._due, self._now = robot, 0.0, 0.0
        self._taken: list[tuple[float, Any, float]] = []
        self._shown: RgbdImage | None = None

    def advance(self, now: float, q: Any, finger_angle: float) -> None:
        self._now = now
        if now + 1e-9 >= self._due and not self.frozen:
            self._due += FRAME_S
            self._taken = [*self._taken[-1:], (now, self._robot.hand_pose(q), finger_angle)]

    def latest(self, max_age_s: float | None = None) -> RgbdImage:
        stamp, T_base_hand, angle = self._taken[0]
        if self.silent or (max_age_s is not None and self._now - stamp > max_age_s):
            raise StaleData("camera: no frame")
        if self._shown is None or self._shown.stamp != stamp:
            bgr, depth = self.scene.draw(T_base_hand, angle, self._robot.hand)
            self._shown = RgbdImage(stamp=stamp, frame_id="camera_optical", bgr=bgr, depth=depth, info=INFO)
        return self._shown

    def since(self, stamp: float) -> tuple[RgbdImage, ...]:
        image = self.latest()
        return (image,) if image.stamp > stamp else ()


class PaperScanner:
    """A scanner at 15 Hz with the same ranges (n,) m in every beam: nothing within reach unless they are set."""

    def __init__(self) -> None:
        self.ranges, self.silent, self._now = np.full(361, np.inf), False, 0.0

    def advance(self, now: float) -> None:
        self._now = now

    def latest(self, max_age_s: float | None = None) -> LaserScan:
        if self.silent:
            raise StaleData("scanner: nothing")
        return self._scan(int(self._now / FRAME_S + 1e-6))

    def since(self, stamp: float) -> tuple[LaserScan, ...]:
        if self.silent:
            return ()
        newest = int(self._now / FRAME_S + 1e-6)
        return tuple(self._scan(k) for k in range(max(0, newest - 30), newest + 1) if k * FRAME_S > stamp + 1e-9)

    def _scan(self, k: int) -> LaserScan:
        return LaserScan(
            stamp=k * FRAME_S,
            angle_min=-np.pi / 2,
            angle_increment=np.pi / (len(self.ranges) - 1),
            range_min=0.05,
            range_max=10.0,
            ranges=self.ranges,
        )


class PaperOperator:
    """Confirms `waiting` refills, one after each so many calls; remembers every confirmation."""

    def __init__(self) -> None:
        self.calls, self.after_calls = 0, 50
        self.waiting: list[int] = []
        self.told: list[Refilled] = []

    def call(self) -> None:
        self.calls += 1
        if self.waiting and self.calls % self.after_calls == 0:
            self.told.append(Refilled(stamp=0.0, number=len(self.told) + 1, added=self.waiting.pop(0)))

    def refilled(self, after: int = 0) -> tuple[Refilled, ...]:
        return tuple(refill for refill in self.told if refill.number > after)
