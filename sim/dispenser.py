"""The loop dispenser as MJCF: two thin tubes, welded at both ends, with two red wings.

The loop lies in the x-y plane of its body frame, centred at rest: long axis y, opening axis x. It is a chain of
capsules with bending springs: tab A carries the free joint, two arms of capsules leave it, tab B hangs on one arm and a
`connect` that is always on closes the other. Names of `dispenser_0`: body and free joint `dispenser_0`, arm bodies
`dispenser_0_p0` … (+x side) and `dispenser_0_m0` … (-x side), tab B `dispenser_0_end`.

Source: contact recipe of the feasibility study (shape, stiffness and contact parameters), facts sheet section 5.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from grape.errors import InvalidInput
from grape.geometry import rotation_to_quaternion, transform
from grape.messages import Array

_Element = ElementTree.Element
_SOLREF, _SOLIMP = "0.004 1", "0.98 0.999 0.0003 0.5 2"


@dataclass(frozen=True, kw_only=True)
class DispenserOptions:
    """Size and material of a loop; the defaults are those of the study."""

    length: float = 0.140  # m between the tabs
    tab: float = 0.012  # m, length of each welded end
    half_width: float = 0.0145  # m from the middle to a tube at mid-length, relaxed
    tab_half_width: float = 0.0025  # m
    radius: float = 0.0015  # m of a tube
    segments: int = 6  # capsules an arm
    out_of_plane_every: int = 2  # nodes between hinges that bend out of the plane: the stiff direction needs fewer
    mass: float = 0.003  # kg
    bending_stiffness: float = 4e-4  # N m^2, EI of a tube
    damping_time: float = 0.006  # s, damping over stiffness
    friction: float = 0.3
    wing: tuple[float, float] = (0.010, 0.012)  # m, across and along the tube
    tube_color: str = "0.55 0.25 0.12 1"
    wing_color: str = "0.85 0.05 0.05 1"

    def __post_init__(self) -> None:
        if (
            min(self.segments, 2 * self.out_of_plane_every) < 2
            or min(self.length, self.radius, self.mass, self.bending_stiffness) <= 0
        ):
            raise InvalidInput(f"a dispenser needs positive sizes and at least 2 segments, got {self}")


def dispenser_elements(
    name: str, T_world_loop: Array, options: DispenserOptions | None = None
) -> tuple[_Element, _Element]:
    """The `<body>` of a dispenser, for the worldbody, and the `<connect>` that closes its loop, for `<equality>`.

    Args:
        name: name of the dispenser, `dispenser_0` for example; every element in it starts with it.
        T_world_loop: pose (4, 4) of the loop's centre.
        options: size and material.
    """
    o = options or DispenserOptions()
    root = ElementTree.Element("body", name=name, pos=_text(T_world_loop[:3, 3]), quat=_quaternion(T_world_loop))
    ElementTree.SubElement(root, "freejoint", name=name)
    _tab(root, o, y=-o.length / 2, direction=-1)
    end = _arm(root, o, name, side=1)
    _tab_end(end, o, name)
    _arm(root, o, name, side=-1)
    connect = ElementTree.Element(
        "connect", name=name, site1=f"{name}_end", site2=f"{name}_join", solref=_SOLREF, solimp=_SOLIMP
    )
    return root, connect


def dispenser_mjcf(name: str, T_world_loop: Array, options: DispenserOptions | None = None) -> str:
    """An MJCF that holds one dispenser and nothing else."""
    root = ElementTree.Element("mujoco", model=name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    body, connect = dispenser_elements(name, T_world_loop, options)
    ElementTree.SubElement(root, "worldbody").append(body)
    ElementTree.SubElement(root, "equality").append(connect)
    return ElementTree.tostring(root, encoding="unicode")


def add_dispenser(
    spec: mujoco.MjSpec, name: str, T_world_loop: Array | None = None, options: DispenserOptions | None = None
) -> None:
    """Add a dispenser to a scene, at the world's origin unless a pose (4, 4) of its centre is given."""
    pose = np.eye(4) if T_world_loop is None else T_world_loop
    part = mujoco.MjSpec.from_string(dispenser_mjcf(name, pose, options))
    spec.attach(part, prefix="", frame=spec.worldbody.add_frame())


def place_dispenser(model: mujoco.MjModel, data: mujoco.MjData, name: str, T_world_loop: Array) -> None:
    """Set-up only: put a dispenser at a pose (4, 4), relaxed and at rest."""
    root = model.body(name).id
    bodies = np.flatnonzero(model.body_rootid == root)
    for joint in np.flatnonzero(np.isin(model.jnt_bodyid, bodies)):
        address, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            data.qpos[address : address + 3] = T_world_loop[:3, 3]
            data.qpos[address + 3 : address + 7] = rotation_to_quaternion(T_world_loop[:3, :3])
            data.qvel[dof : dof + 6] = 0.0
        else:
            data.qpos[address] = 0.0
            data.qvel[dof] = 0.0


@dataclass(frozen=True, kw_only=True)
class LoopReader:
    """Reads where the tubes of one dispenser are; for the referee."""

    bodies: Array  # (2 segments,) ids along the + arm, then back along the - arm
    end_body: int
    end_offset: Array  # (3,) m
    subtree: frozenset[int]  # every body of the dispenser, to tell its contacts

    @classmethod
    def of(cls, model: mujoco.MjModel, name: str) -> LoopReader:
        """The reader of the dispenser `name`."""
        root = model.body(name).id
        subtree = np.flatnonzero(model.body_rootid == root)
        names = {model.body(int(body)).name: int(body) for body in subtree}
        plus = [names[f"{name}_p{k}"] for k in range(len(subtree)) if f"{name}_p{k}" in names]
        minus = [names[f"{name}_m{k}"] for k in range(len(subtree)) if f"{name}_m{k}" in names]
        site = model.site(f"{name}_end")
        return cls(
            bodies=np.array(plus + minus[::-1]),
            end_body=int(site.bodyid[0]),
            end_offset=np.array(site.pos),
            subtree=frozenset(names.values()),
        )

    def polyline(self, data: mujoco.MjData) -> Array:
        """Closed centre line (2 segments + 1, 3) in the world: up the + arm, tab B, back along the - arm."""
        half = len(self.bodies) // 2
        nodes = data.xpos[self.bodies]
        T = np.eye(4)
        T[:3, :3] = data.xmat[self.end_body].reshape(3, 3)
        T[:3, 3] = data.xpos[self.end_body]
        return np.vstack((nodes[:half], transform(T, self.end_offset), nodes[half:]))

    def touches(self, model: mujoco.MjModel, data: mujoco.MjData) -> frozenset[int]:
        """Ids of the bodies outside the dispenser that it touches now."""
        pairs = model.geom_bodyid[data.contact.geom]
        others: set[int] = set()
        for a, b in pairs:
            if (int(a) in self.subtree) != (int(b) in self.subtree):
                others.add(int(b) if int(a) in self.subtree else int(a))
        return frozenset(others)


def _center_line(o: DispenserOptions, side: int) -> Array:
    """Nodes (segments + 1, 2) of one relaxed tube from tab A to tab B, x and y."""
    y = np.linspace(-o.length / 2, o.length / 2, o.segments + 1)
    bulge = 0.5 * (1.0 + np.cos(2 * np.pi * y / o.length))
    return np.column_stack((side * (o.tab_half_width + (o.half_width - o.tab_half_width) * bulge), y))


def _mass_per_metre(o: DispenserOptions) -> float:
    tube = np.linalg.norm(np.diff(_center_line(o, 1), axis=0), axis=1).sum()
    return o.mass / (2.0 * float(tube) + 2.0 * o.tab)


def _capsule(parent: _Element, o: DispenserOptions, start: Array, end: Array, mass: float) -> None:
    ElementTree.SubElement(
        parent,
        "geom",
        type="capsule",
        size=f"{o.radius:.6g}",
        fromto=_text((*start, *end)),
        mass=f"{mass:.4g}",
        rgba=o.tube_color,
        group="2",
        contype="4",
        conaffinity="0",
        priority="1",
        condim="4",
        friction=f"{o.friction:.6g} 0.002 0.0001",
        solref=_SOLREF,
        solimp=_SOLIMP,
    )


def _foot(parent: _Element, o: DispenserOptions, center: Array) -> None:
    """A ball inside a tab by which alone it touches feeder and base: one contact where a lying tube would make two.

    It slides without friction: a loop that the drive shakes comes to rest anywhere between the tray's lips. With
    friction each sliding foot costs the solver a cone, half of a step while driving.
    """
    ElementTree.SubElement(
        parent,
        "geom",
        type="sphere",
        size=f"{o.radius:.6g}",
        pos=_text(center),
        mass="0",
        group="4",
        contype="16",
        conaffinity="0",
        priority="1",
        condim="1",
        solref=_SOLREF,
        solimp=_SOLIMP,
    )


def _hinge(parent: _Element, axis: str, stiffness: float, o: DispenserOptions) -> None:
    damping = stiffness * o.damping_time
    ElementTree.SubElement(
        parent, "joint", type="hinge", axis=axis, stiffness=f"{stiffness:.6g}", damping=f"{damping:.4g}"
    )


def _tab(parent: _Element, o: DispenserOptions, y: float, direction: int) -> None:
    """The two tube ends beside each other, from `y` outwards."""
    x = o.tab_half_width - o.radius / 2
    for side in (-1, 1):
        start, end = y + direction * o.radius, y + direction * (o.tab - o.radius)
        mass = _mass_per_metre(o) * o.tab / 2
        _capsule(parent, o, np.array([side * x, start, 0.0]), np.array([side * x, end, 0.0]), mass)
        _foot(parent, o, np.array([side * x, (start + end) / 2, 0.0]))


def _arm(root: _Element, o: DispenserOptions, name: str, side: int) -> _Element:
    """One tube as a chain of capsules; returns its last body."""
    line = _center_line(o, side)
    steps = np.diff(line, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    angles = np.arctan2(-steps[:, 0], steps[:, 1])
    parent, turned = root, 0.0
    for k in range(o.segments):
        position = (line[0, 0], line[0, 1], 0.0) if k == 0 else (0.0, lengths[k - 1], 0.0)
        body = ElementTree.SubElement(
            parent,
            "body",
            name=f"{name}_{'p' if side > 0 else 'm'}{k}",
            pos=_text(position),
            quat=_turn(angles[k] - turned),
        )
        # A node's spring spans half of each neighbour; the first node has no neighbour before it.
        stiffness = o.bending_stiffness / (lengths[k] if k else lengths[k] / 2)
        _hinge(body, "0 0 1", stiffness, o)
        if k % o.out_of_plane_every == o.out_of_plane_every - 1:
            _hinge(body, "1 0 0", stiffness / o.out_of_plane_every, o)
        _capsule(body, o, np.zeros(3), np.array([0.0, lengths[k], 0.0]), _mass_per_metre(o) * lengths[k])
        if k == o.segments // 2:
            _wing(body, o, side)
        parent, turned = body, angles[k]
    if side < 0:
        ElementTree.SubElement(
            parent, "site", name=f"{name}_join", pos=_text((0, lengths[-1], 0)), size="0.0005", group="4"
        )
    return parent


def _tab_end(last: _Element, o: DispenserOptions, name: str) -> None:
    """Tab B behind the last capsule of the + arm, and the site where the - arm joins."""
    line = _center_line(o, 1)
    step = line[-1] - line[-2]
    length = float(np.linalg.norm(step))
    body = ElementTree.SubElement(
        last,
        "body",
        name=f"{name}_end",
        pos=_text((0.0, length, 0.0)),
        quat=_turn(-float(np.arctan2(-step[0], step[1]))),
    )
    _hinge(body, "0 0 1", 2 * o.bending_stiffness / length, o)
    shift = np.array([-line[-1, 0], 0.0, 0.0])
    x = o.tab_half_width - o.radius / 2
    for side in (-1, 1):
        start = shift + np.array([side * x, o.radius, 0.0])
        end = start + np.array([0.0, o.tab - 2 * o.radius, 0.0])
        _capsule(body, o, start, end, _mass_per_metre(o) * o.tab / 2)
        _foot(body, o, (start + end) / 2)
    ElementTree.SubElement(body, "site", name=f"{name}_end", pos=_text(2 * shift), size="0.0005", group="4")


def _wing(body: _Element, o: DispenserOptions, side: int) -> None:
    """A flag of red tape on the outer side of a tube; seen, not touched."""
    across, along = o.wing
    ElementTree.SubElement(
        body,
        "geom",
        type="box",
        size=_text((across / 2, along / 2, 0.0004)),
        pos=_text((side * (across / 2 + 0.0005), 0.0, 0.0)),
        rgba=o.wing_color,
        group="2",
        contype="0",
        conaffinity="0",
        mass="2e-5",
    )


def _turn(angle: float) -> str:
    return f"{np.cos(angle / 2):.9f} 0 0 {np.sin(angle / 2):.9f}"


def _quaternion(T: Array) -> str:
    return _text(rotation_to_quaternion(T[:3, :3]))


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{float(value):.7g}" for value in values)
