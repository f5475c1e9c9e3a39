"""Reads from an MJCF what kinematics and planning need, without a simulator: links and collision shapes.

Only the part of the format that a chain uses is understood: pos, quat, inertial, one hinge a body, default classes.
Source: MuJoCo XML reference, https://mujoco.readthedocs.io/en/stable/XMLreference.html
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import pose, quaternion_to_rotation
from grape.messages import Array

_Element = ElementTree.Element


@dataclass(frozen=True, kw_only=True)
class BodyInertia:
    """A rigid mass in the frame of its link: mass kg, centre (3,) m, inertia (3, 3) kg m^2 about the centre."""

    mass: float
    center: Array
    inertia: Array


@dataclass(frozen=True, kw_only=True)
class Link:
    """A link behind its hinge: `T_parent_link` at joint angle 0, hinge axis and limits, and all mass it carries."""

    name: str
    joint: str
    T_parent_link: Array  # (4, 4)
    axis: Array  # (3,)
    position_min: float  # rad, -inf for a continuous joint
    position_max: float  # rad
    torque_max: float  # N m
    inertias: tuple[BodyInertia, ...]


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A collision shape of one body: a capsule from `start` to `end`, or a box with half sizes at `T_body_shape`."""

    name: str
    body: str
    kind: str  # "capsule" or "box"
    radius: float  # m, of a capsule
    start: Array  # (3,) m, body frame
    end: Array  # (3,) m, body frame
    T_body_shape: Array  # (4, 4)
    half_size: Array  # (3,) m, of a box


def read_mjcf(path: Path) -> _Element:
    """The root of an MJCF file, every `<include>` replaced by what is in the file that it names.

    Raises:
        InvalidInput: a file cannot be read, or is included twice.
    """
    root, included = _parse(path), {path.resolve()}
    while places := [(parent, child) for parent in root.iter() for child in parent if child.tag == "include"]:
        parent, include = places[0]
        file = (path.parent / include.get("file", "")).resolve()
        if file in included:
            raise InvalidInput(f"{path}: {include.get('file')} is included twice")
        included.add(file)
        index = list(parent).index(include)
        parent[index : index + 1] = list(_parse(file))
    return root


def read_chain(path: Path, base: str, tip: str) -> tuple[Link, ...]:
    """The hinged links between the body `base` (excluded) and the body `tip` (included), root first.

    Raises:
        InvalidInput: there is no such body, or `tip` does not hang on `base` by one hinge a body.
    """
    root = read_mjcf(path)
    defaults = _Defaults(root)
    parents = {child: parent for parent in root.iter() for child in parent}
    body, child, links = _find_body(root, tip, path), None, []
    while body.get("name") != base:
        if body.tag != "body":
            raise InvalidInput(f"{path.name}: body {tip!r} does not hang on body {base!r}")
        links.append(_link(body, child, defaults, path))
        body, child = parents[body], body
    return tuple(reversed(links))


def read_shapes(path: Path, group: int = 3) -> tuple[Shape, ...]:
    """Every capsule and box of one geom group, in the frame of the named body that carries it.

    Raises:
        InvalidInput: a shape of that group is neither a capsule given by `fromto` nor a box.
    """
    root = read_mjcf(path)
    defaults = _Defaults(root)
    shapes = []
    for body in root.iter("body"):
        for geom in body.findall("geom"):
            attributes = defaults.resolve(geom)
            if int(attributes.get("group", "0")) == group and attributes.get("type") != "ellipsoid":
                shapes.append(_shape(body.get("name", ""), attributes, path))
    return tuple(shapes)


def read_body_pose(path: Path, body: str, ancestor: str) -> Array:
    """`T_ancestor_body` (4, 4) with every joint between them at 0.

    Raises:
        InvalidInput: the file has no such body, or it does not hang on the ancestor.
    """
    root = read_mjcf(path)
    parents = {child: parent for parent in root.iter() for child in parent}
    element, T = _find_body(root, body, path), np.eye(4)
    while element.get("name") != ancestor:
        if element.tag != "body":
            raise InvalidInput(f"{path.name}: body {body!r} does not hang on body {ancestor!r}")
        T = _placement(element.attrib) @ T
        element = parents[element]
    return T


class _Defaults:
    """The default classes of geoms and joints; `childclass` is not used by our models."""

    def __init__(self, root: _Element) -> None:
        self._classes: dict[str, dict[str, dict[str, str]]] = {}
        for top in root.findall("default"):
            self._collect(top, self._classes.get("main", {}), "main")

    def _collect(self, element: _Element, inherited: dict[str, dict[str, str]], name: str) -> None:
        own = {tag: dict(values) for tag, values in inherited.items()}
        for child in element:
            if child.tag != "default":
                own.setdefault(child.tag, {}).update(child.attrib)
        self._classes[name] = own
        for child in element.findall("default"):
            self._collect(child, own, child.get("class", ""))

    def resolve(self, element: _Element) -> dict[str, str]:
        """The attributes of an element over those of its default class."""
        defaults = self._classes.get(element.get("class", "main"), {})
        return {**defaults.get(element.tag, {}), **element.attrib}


def _parse(path: Path) -> _Element:
    try:
        return ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise InvalidInput(f"cannot read the MJCF {path}: {error}") from error


def _find_body(root: _Element, name: str, path: Path) -> _Element:
    for body in root.iter("body"):
        if body.get("name") == name:
            return body
    known = sorted(body.get("name", "") for body in root.iter("body"))
    raise InvalidInput(f"{path.name} has no body {name!r}; it has {', '.join(known)}")


def _numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def _placement(attributes: dict[str, str]) -> Array:
    rotation = quaternion_to_rotation(_numbers(attributes.get("quat", "1 0 0 0")))
    x, y, z = _numbers(attributes.get("pos", "0 0 0"))
    return pose(rotation, (x, y, z))


def _link(body: _Element, next_link: _Element | None, defaults: _Defaults, path: Path) -> Link:
    name = body.get("name", "")
    joints = body.findall("joint")
    if len(joints) != 1:
        raise InvalidInput(f"{path.name}: body {name!r} of the chain needs one hinge, it has {len(joints)} joints")
    joint = defaults.resolve(joints[0])
    low, high = _numbers(joint["range"]) if "range" in joint else (-np.inf, np.inf)
    torque = _numbers(joint["actuatorfrcrange"])[1] if "actuatorfrcrange" in joint else np.inf
    return Link(
        name=name,
        joint=joint["name"],
        T_parent_link=_placement(body.attrib),
        axis=_numbers(joint.get("axis", "0 0 1")),
        position_min=float(low),
        position_max=float(high),
        torque_max=float(torque),
        inertias=tuple(_carried(body, np.eye(4), next_link)),
    )


def _carried(body: _Element, T_link_body: Array, next_link: _Element | None) -> list[BodyInertia]:
    """Inertias of a body and of all bodies on it but the next link; fingers count at joint angle 0."""
    found = []
    inertial = body.find("inertial")
    if inertial is not None:
        T = T_link_body @ _placement(inertial.attrib)
        inertia = np.diag(_numbers(inertial.get("diaginertia", "0 0 0")))
        R = T[:3, :3]
        found.append(BodyInertia(mass=float(inertial.get("mass", "0")), center=T[:3, 3], inertia=R @ inertia @ R.T))
    for child in body.findall("body"):
        if child is not next_link:
            found += _carried(child, T_link_body @ _placement(child.attrib), None)
    return found


def _shape(body: str, attributes: dict[str, str], path: Path) -> Shape:
    kind, size = attributes.get("type", "sphere"), _numbers(attributes["size"])
    name = attributes.get("name", "")
    start = end = np.zeros(3)
    if kind == "capsule" and "fromto" in attributes:
        ends = _numbers(attributes["fromto"])
        start, end = ends[:3], ends[3:]
    elif kind != "box":
        raise InvalidInput(f"{path.name}: shape {name!r} of {body!r} must be a capsule by fromto or a box, got {kind}")
    return Shape(
        name=name,
        body=body,
        kind=kind,
        radius=float(size[0]) if kind == "capsule" else 0.0,
        start=start,
        end=end,
        T_body_shape=_placement(attributes),
        half_size=size if kind == "box" else np.zeros(3),
    )
