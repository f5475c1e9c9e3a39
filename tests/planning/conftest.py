"""A Jaco2 j2n6s300 on a Husky for the planning tests: kinematics from the facts sheet, capsules around the links."""

import numpy as np
import pytest

from grape.geometry import pose, rotation_from_rpy
from grape.planning import JointPlanner, LinkCapsule, StaticBox, build_sphere_model

ARM_BASE = (0.25, 0.20, 0.458)
ORIGINS = (
    ((0, 0, 0.15675), (0, np.pi, 0)),
    ((0, 0.0016, -0.11875), (-np.pi / 2, 0, np.pi)),
    ((0, -0.41, 0), (0, np.pi, 0)),
    ((0, 0.2073, -0.0114), (-np.pi / 2, 0, np.pi)),
    ((0, -0.03703, -0.06414), (np.pi / 3, 0, np.pi)),
    ((0, -0.03703, -0.06414), (np.pi / 3, 0, np.pi)),
)
CAPSULES = (
    LinkCapsule(link="base", joint=0, p0=(0.25, 0.20, 0.50), p1=(0.25, 0.20, 0.57), radius=0.045),
    LinkCapsule(link="shoulder", joint=1, p0=(0, 0, -0.02), p1=(0, 0, -0.12), radius=0.045),
    LinkCapsule(link="upper_arm", joint=2, p0=(0, 0, -0.01), p1=(0, -0.41, -0.01), radius=0.045),
    LinkCapsule(link="forearm", joint=3, p0=(0, 0, -0.01), p1=(0, 0.2073, -0.01), radius=0.038),
    LinkCapsule(link="wrist_1", joint=4, p0=(0, 0, 0), p1=(0, -0.03703, -0.06414), radius=0.034),
    LinkCapsule(link="wrist_2", joint=5, p0=(0, 0, 0), p1=(0, -0.03703, -0.06414), radius=0.034),
    LinkCapsule(link="hand", joint=6, p0=(0, 0, -0.03), p1=(0, 0, -0.10), radius=0.045),
    LinkCapsule(link="sensors", joint=6, p0=(-0.035, -0.092, -0.015), p1=(0.035, -0.092, -0.015), radius=0.03),
    LinkCapsule(link="finger_2", joint=6, p0=(0.022, -0.027, -0.115), p1=(0.03, -0.01, -0.26), radius=0.012),
    LinkCapsule(link="finger_3", joint=6, p0=(-0.022, -0.027, -0.115), p1=(-0.03, -0.01, -0.26), radius=0.012),
)
DISTAL = ("wrist_2", "hand", "sensors", "finger_2", "finger_3")
PAIRS = tuple((a, b) for a in ("base", "shoulder", "upper_arm") for b in DISTAL) + tuple(
    ("forearm", b) for b in DISTAL[1:]
)
BOXES = (
    StaticBox(name="deck", center=(0.0, 0.0, 0.12), half_size=(0.495, 0.335, 0.125)),
    StaticBox(name="riser", center=(0.25, 0.20, 0.34), half_size=(0.06, 0.06, 0.10), ignore_links=("base", "shoulder")),
    StaticBox(name="feeder", center=(-0.20, 0.15, 0.38), half_size=(0.04, 0.10, 0.08)),
    StaticBox(name="mast", center=(0.40, -0.20, 0.38), half_size=(0.055, 0.055, 0.19)),
)
LOWER = np.array([-np.inf, np.radians(47), np.radians(19), -np.inf, -np.inf, -np.inf])
UPPER = np.array([np.inf, np.radians(313), np.radians(341), np.inf, np.inf, np.inf])
VELOCITY = np.radians([36, 36, 36, 48, 48, 48])


def placements():
    T = [pose(rotation_from_rpy(*rpy), xyz) for xyz, rpy in ORIGINS]
    T[0] = pose(translation=ARM_BASE) @ T[0]
    return np.array(T)


@pytest.fixture(scope="session")
def model():
    return build_sphere_model(placements=placements(), capsules=CAPSULES, link_pairs=PAIRS, boxes=BOXES)


@pytest.fixture
def planner():
    return JointPlanner(LOWER, UPPER, VELOCITY)


@pytest.fixture(scope="session")
def fk():
    """Joint frames (7, 4, 4) in base_link by plain matrix products, the yardstick for the kernels."""

    def frames(q):
        result = [np.eye(4)]
        for T, angle in zip(placements(), q, strict=True):
            c, s = np.cos(angle), np.sin(angle)
            result.append(result[-1] @ T @ pose(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])))
        return np.array(result)

    return frames


@pytest.fixture(scope="session")
def vine():
    """A vine on the left: a trunk, a cordon along x at 0.75 m, spurs on it, as (m, 3) points in base_link."""
    rng = np.random.default_rng(7)

    def tube(a, b, radius, count):
        a, b = np.asarray(a, float), np.asarray(b, float)
        axis = (b - a) / np.linalg.norm(b - a)
        side = np.cross(axis, [0.3, 0.5, 0.8])
        side /= np.linalg.norm(side)
        other, angle = np.cross(axis, side), rng.uniform(0, 2 * np.pi, count)
        around = radius * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other)
        return a + rng.uniform(0, 1, count)[:, None] * (b - a) + around

    parts = [tube((0.3, 0.85, -0.1), (0.3, 0.85, 0.62), 0.03, 3000)]
    parts += [tube((-0.4, 0.85, 0.62), (1, 0.85, 0.62), 0.02, 5000)]
    parts += [tube((x, 0.85, 0.62), (x + 0.02, 0.83, 0.74), 0.005, 400) for x in np.arange(-0.3, 1.0, 0.17)]
    return np.concatenate(parts)
