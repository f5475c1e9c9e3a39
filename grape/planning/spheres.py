"""The collision model of an arm: every link covered by spheres, pairs of links that may touch, and static boxes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput, with_suggestion
from grape.messages import Array, frozen_array


@dataclass(frozen=True, kw_only=True)
class LinkCapsule:
    """A capsule fixed to a link.

    Args:
        link: name used in the pairs and in error messages; several capsules may share it.
        joint: how many joints of the chain move it: 0 for the base of the arm, 1 for the link behind the first joint.
        p0, p1: ends of the axis, (3,) m, in the frame of that joint (joint 0: in the base frame of the chain).
        radius: m.
    """

    link: str
    joint: int
    p0: tuple[float, float, float]
    p1: tuple[float, float, float]
    radius: float


@dataclass(frozen=True, kw_only=True)
class StaticBox:
    """A box with axes parallel to the base frame: deck, feeder, mast, riser.

    Args:
        name: for error messages.
        center, half_size: (3,) m, base frame.
        ignore_links: links that are mounted on it or belong inside it.
    """

    name: str
    center: tuple[float, float, float]
    half_size: tuple[float, float, float]
    ignore_links: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class SphereModel:
    """Spheres of a serial chain of revolute joints; build it with `build_sphere_model`.

    Attributes:
        placements: (n, 4, 4) pose of joint frame i in joint frame i - 1 at q = 0 (the first in the base frame); each
            joint turns about its own z axis.
        capsules, boxes, link_pairs: what it was built from.
        spheres: (m, 5) joint, x, y, z, radius, sorted by joint.
        links: name of the link of each sphere.
        capsule_table: (c, 3) first and last sphere of each capsule, and half its length with its ends, m.
        capsule_pairs: (k, 5) first and last sphere of two capsules that must not touch, and the distance of their
            middles above which they cannot.
        box_table: (b, 6) centre and half size.
        box_mask: (c, b) whether a capsule is checked against a box.
        reach: (c, n) m, the farthest that a capsule's surface can be from the axis of joint i; 0 where that joint
            does not move it.
    """

    placements: Array
    capsules: tuple[LinkCapsule, ...]
    boxes: tuple[StaticBox, ...]
    link_pairs: tuple[tuple[str, str], ...]
    spheres: Array
    links: tuple[str, ...]
    capsule_table: Array
    capsule_pairs: Array
    box_table: Array
    box_mask: Array
    reach: Array

    @property
    def joint_count(self) -> int:
        """Number of joints of the chain."""
        return len(self.placements)

    def holding(self, held: Iterable[LinkCapsule], touch_links: Sequence[str]) -> SphereModel:
        """The same arm with something in the hand.

        Args:
            held: capsules of the held thing, moved by the joint that carries it.
            touch_links: links that the held thing must not touch.
        """
        held = tuple(held)
        names = sorted({capsule.link for capsule in held})
        pairs = tuple((name, link) for name in names for link in touch_links)
        return build_sphere_model(
            placements=self.placements,
            capsules=self.capsules + held,
            link_pairs=self.link_pairs + pairs,
            boxes=self.boxes,
        )

    def with_boxes(self, boxes: Iterable[StaticBox]) -> SphereModel:
        """The same arm with other static boxes."""
        return build_sphere_model(
            placements=self.placements, capsules=self.capsules, link_pairs=self.link_pairs, boxes=boxes
        )


def build_sphere_model(
    *,
    placements: Array,
    capsules: Iterable[LinkCapsule],
    link_pairs: Iterable[tuple[str, str]] = (),
    boxes: Iterable[StaticBox] = (),
) -> SphereModel:
    """Cover the capsules with spheres and expand the pairs of links to pairs of capsules.

    Args:
        placements: (n, 4, 4), see `SphereModel`; with Pinocchio, `[j.homogeneous for j in model.jointPlacements[1:]]`.
        capsules: the links' shapes.
        link_pairs: names of links that must not touch; neighbours and links that cannot meet are left out.
        boxes: static obstacles that move with the robot's base.

    Raises:
        InvalidInput: a shape, a joint number or a link name is wrong.
    """
    placements = frozen_array(placements, float)
    capsules, boxes = tuple(sorted(capsules, key=lambda c: c.joint)), tuple(boxes)
    _check(placements, capsules, boxes, link_pairs := tuple(link_pairs))
    rows: list[Array] = []
    links: list[str] = []
    for capsule in capsules:
        covered = cover_capsule(capsule)
        rows.append(covered)
        links += [capsule.link] * len(covered)
    spheres, table = np.concatenate(rows), _capsule_table(rows)
    box_table = np.array([[*box.center, *box.half_size] for box in boxes], dtype=float).reshape(-1, 6)
    box_mask = np.array([[c.link not in box.ignore_links for box in boxes] for c in capsules], dtype=bool)
    return SphereModel(
        placements=placements,
        capsules=capsules,
        boxes=boxes,
        link_pairs=link_pairs,
        spheres=frozen_array(spheres),
        links=tuple(links),
        capsule_table=frozen_array(table),
        capsule_pairs=frozen_array(_capsule_pairs(capsules, table, link_pairs)),
        box_table=frozen_array(box_table),
        box_mask=frozen_array(box_mask.reshape(len(capsules), len(boxes))),
        reach=frozen_array(_reach(placements, capsules, rows)),
    )


def cover_capsule(capsule: LinkCapsule) -> Array:
    """(k, 5) spheres (joint, x, y, z, radius) at most one radius apart whose union holds the whole capsule."""
    p0, p1 = np.asarray(capsule.p0, float), np.asarray(capsule.p1, float)
    length = float(np.linalg.norm(p1 - p0))
    count = int(np.ceil(length / capsule.radius)) + 1
    gap = length / max(count - 1, 1)
    centers = p0 + np.linspace(0.0, 1.0, count)[:, None] * (p1 - p0)
    radius = np.hypot(capsule.radius, 0.5 * gap)
    return np.column_stack([np.full(count, float(capsule.joint)), centers, np.full(count, radius)])


def _check(
    placements: Array,
    capsules: tuple[LinkCapsule, ...],
    boxes: tuple[StaticBox, ...],
    link_pairs: tuple[tuple[str, str], ...],
) -> None:
    if placements.ndim != 3 or placements.shape[1:] != (4, 4) or not np.isfinite(placements).all():
        raise InvalidInput(f"placements must be finite with shape (n, 4, 4), got shape {placements.shape}")
    if not capsules:
        raise InvalidInput("a collision model needs at least one capsule, got none")
    for capsule in capsules:
        if not 0 <= capsule.joint <= len(placements):
            raise InvalidInput(f"capsule {capsule.link!r}: joint must be 0..{len(placements)}, got {capsule.joint}")
        if not capsule.radius > 0.0:
            raise InvalidInput(f"capsule {capsule.link!r}: radius must be positive, got {capsule.radius}")
    names = {capsule.link for capsule in capsules}
    for name in [*(n for pair in link_pairs for n in pair), *(n for box in boxes for n in box.ignore_links)]:
        if name not in names:
            raise InvalidInput(with_suggestion(f"unknown link {name!r}; allowed: {sorted(names)}", name, names))


def _capsule_table(rows: list[Array]) -> Array:
    """(c, 3), see `SphereModel`; the spheres of a capsule follow one another."""
    ends = np.cumsum([len(row) for row in rows])
    half = [0.5 * float(np.linalg.norm(row[-1, 1:4] - row[0, 1:4])) + row[0, 4] for row in rows]
    return np.column_stack([ends - [len(row) for row in rows], ends - 1, half])


def _capsule_pairs(capsules: tuple[LinkCapsule, ...], table: Array, link_pairs: tuple[tuple[str, str], ...]) -> Array:
    """Every pair of capsules of the paired links, (k, 5)."""
    members = {name: [i for i, c in enumerate(capsules) if c.link == name] for name in {c.link for c in capsules}}
    pairs = [
        (*table[i, :2], *table[j, :2], table[i, 2] + table[j, 2])
        for a, b in link_pairs
        for i in members[a]
        for j in members[b]
    ]
    return np.array(pairs, dtype=float).reshape(-1, 5)


def _reach(placements: Array, capsules: tuple[LinkCapsule, ...], rows: list[Array]) -> Array:
    """(c, n) bound on the distance of a capsule's surface from the axis of each joint, in any configuration."""
    reach = np.zeros((len(capsules), len(placements)))
    lengths = np.linalg.norm(placements[:, :3, 3], axis=1)
    for c, (capsule, row) in enumerate(zip(capsules, rows, strict=True)):
        local = float((np.linalg.norm(row[:, 1:4], axis=1) + row[:, 4]).max())
        for i in range(capsule.joint):
            reach[c, i] = lengths[i + 1 : capsule.joint].sum() + local
    return reach
