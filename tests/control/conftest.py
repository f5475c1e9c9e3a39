"""A kinematic arm with a camera on the hand: speeds are followed with a lag, frames come late and noisy."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from grape.control import DifferentialIk, marker_corners, shift_twist
from grape.geometry import inverse, pose, rotation_exp, rotation_x, transform
from grape.kinematics import ArmModel, inverse_all
from grape.robots.husky_jaco2 import DESCRIPTION

K = np.array([[466.0, 0, 319.5], [0, 466.0, 239.5], [0, 0, 1]])
SIDE = 0.040
T_HAND_CAMERA = DESCRIPTION.mounts["camera_optical"].T_parent_sensor
NAILS = np.array([0.0, 0.0, -0.26])  # m, hand frame
NAIL_TIP = np.array([0.25, 0.60, 0.20])  # m, arm base frame
R_LEVEL = rotation_x(np.pi / 2)  # the hand points along +y
MARKER_FACES_ROBOT = np.column_stack([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
VELOCITY = DESCRIPTION.arm.velocity_max


def goal_hand(standoff):
    """Where the hand should be in front of the nail."""
    return pose(R_LEVEL, NAIL_TIP - np.array([0.0, standoff, 0.0]) - R_LEVEL @ NAILS)


def marker_pose(side):
    """A marker beside the nail: `side` -1 left, +1 right."""
    return pose(MARKER_FACES_ROBOT, NAIL_TIP + np.array([0.085 * side, 0.05, -0.03]))


MARKERS = {10: marker_pose(-1), 11: marker_pose(1)}


def desired_view(T_base_marker):
    return lambda standoff: inverse(goal_hand(standoff) @ T_HAND_CAMERA) @ T_base_marker


@dataclass
class SimulatedArm:
    """The arm as it is (`q`) and as it is measured (`q` plus a constant joint offset)."""

    arm: ArmModel
    q: np.ndarray
    offset: np.ndarray
    rng: np.random.Generator
    noise_px: float = 0.2
    period: float = 0.066
    visible: object = None  # function of time -> ids that the camera sees
    t: float = 0.0
    frames: list = field(default_factory=list)
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(6))
    _next: float = 0.0

    @property
    def measured(self):
        return self.q + self.offset

    def camera(self, q):
        return self.arm.fk(q) @ T_HAND_CAMERA

    def detect(self):
        """The frame that arrives now, taken one period ago, or None: (stamp, corners by id, believed camera pose)."""
        if self.t + 1e-9 < self._next:
            return None
        self._next += self.period
        T_camera_base = inverse(self.camera(self.q))
        ids = MARKERS if self.visible is None else self.visible(self.t)
        seen = {}
        for i in ids:
            p = transform(T_camera_base @ MARKERS[i], marker_corners(SIDE))
            px = p[:, :2] / p[:, 2:] * K[0, 0] + K[:2, 2]
            px = px + self.rng.normal(0, self.noise_px, (4, 2))
            if (px > 3).all() and (px < [637, 477]).all() and (p[:, 2] > 0.05).all():
                seen[i] = px
        self.frames.append((self.t, seen, self.camera(self.measured)))
        return self.frames[-2] if len(self.frames) > 1 else None

    def move(self, velocity, dt=0.01, lag=0.03):
        """Follow a joint velocity for `dt` with a first-order lag (s)."""
        self.velocity = self.velocity + (velocity - self.velocity) * dt / (lag + dt)
        self.q = self.q + self.velocity * dt
        self.t = round(self.t + dt, 6)


@pytest.fixture(scope="session")
def arm():
    return ArmModel.from_mjcf(DESCRIPTION.mjcf)


@pytest.fixture(scope="session")
def q_front(arm):
    """A good posture 0.14 m in front of the nail."""
    return inverse_all(arm, goal_hand(0.14), DESCRIPTION.arm.poses["home"])[0].q


@pytest.fixture(scope="session")
def start(arm, q_front):
    """Makes an arm that is off by up to 5 cm and 10 degrees, and believes itself up to 5 cm elsewhere."""
    from grape.kinematics import inverse as solve

    def make(seed, off_m=0.05, off_deg=10.0, bias_m=0.035, **options):
        rng = np.random.default_rng(seed)
        direction, axis = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        T = goal_hand(0.14)
        T[:3, 3] += off_m * direction
        T[:3, :3] = rotation_exp(axis * np.radians(off_deg)) @ T[:3, :3]
        result = solve(arm, T, q_front)
        assert result.converged
        offset = rng.normal(size=6)
        offset *= bias_m / np.linalg.norm(arm.jacobian(result.q)[:3] @ offset)
        return SimulatedArm(arm=arm, q=result.q.copy(), offset=np.clip(offset, -0.12, 0.12), rng=rng, **options)

    return make


@pytest.fixture
def run(arm):
    """Runs a servo on a simulated arm until it converges or the time is over; returns the states at the frames."""

    def go(servo, sim, seconds=20.0, feed=None):
        solver = DifferentialIk.for_arm(arm, VELOCITY)
        states = []
        while sim.t < seconds:
            frame = sim.detect()
            if frame is not None:
                states.append(feed(servo, frame) if feed else servo.update(*frame))
                if states[-1].converged:
                    break
            T_base_hand = arm.fk(sim.measured)
            T_base_camera = T_base_hand @ T_HAND_CAMERA
            twist = servo.twist(sim.t, T_base_camera)
            twist = shift_twist(twist, T_base_camera[:3, 3], T_base_hand[:3, 3])
            sim.move(solver.solve(sim.measured, twist).velocity)
        return states

    return go
