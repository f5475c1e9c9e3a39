"""Whether an arm state or a straight joint motion is free of collision, and by how much."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import isfinite
from types import ModuleType

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array
from grape.planning.distance_field import DistanceField, empty_field
from grape.planning.spheres import SphereModel


@dataclass(frozen=True, kw_only=True)
class CheckerOptions:
    """Margins of the check.

    Args:
        padding_m: least gap to the cloud and to boxes; it also covers the voxel error (at most 0.87 of a voxel).
        self_padding_m: least gap between links.
        least_step_m: shortest step along an edge, as a bound on how far any point of the arm moves.
    """

    padding_m: float = 0.01
    self_padding_m: float = 0.0
    least_step_m: float = 0.01

    def __post_init__(self) -> None:
        if not self.least_step_m > 0.0:
            raise InvalidInput(f"least_step_m must be positive, got {self.least_step_m}")


@dataclass(frozen=True, kw_only=True)
class Nearest:
    """The nearest thing at a state.

    Attributes:
        clearance_m: what is left of the gap after the padding; negative when too near. Cut off at the field's reach.
        link: the link, or an empty string when nothing is within reach.
        other: "cloud", the box's name, the other link, or an empty string.
    """

    clearance_m: float
    link: str
    other: str

    def __str__(self) -> str:
        if not self.link:
            return f"nothing within {self.clearance_m * 1e3:.0f} mm"
        if self.clearance_m < 0:
            return f"{self.link} is {-self.clearance_m * 1e3:.0f} mm too near to {self.other}"
        return f"{self.link} is {self.clearance_m * 1e3:.0f} mm from {self.other}"


@cache
def _kernels() -> ModuleType:
    """The compiled kernels, imported when they are first used."""
    from grape.planning import _collision_kernels

    return _collision_kernels


class StateChecker:
    """Spheres of the arm against the perceived cloud, static boxes and the arm itself.

    Args:
        model: the arm's spheres; `SphereModel.holding` adds a held thing.
        field: the perceived cloud; free space when None.
        options: margins.
    """

    def __init__(
        self, model: SphereModel, field: DistanceField | None = None, options: CheckerOptions | None = None
    ) -> None:
        self.model = model
        self.field = field or empty_field()
        self.options = options or CheckerOptions()
        self._shape = (model.joint_count,)
        self._arm = packed(model, self.field, self.options)
        self._distance = self.field.distance
        self.checked = 0  # states looked at since the start, a measure of work that no clock disturbs

    def is_valid(self, q: Array) -> bool:
        """Whether nothing is nearer than the paddings at joint angles `q` (n,) rad."""
        self.checked += 1
        q = np.ascontiguousarray(q, float)
        found = _kernels().state_valid(q, self._arm, self._distance) if q.shape == self._shape else -1
        if found < 0:
            raise self._refusal(q)
        return found == 1

    def clearance(self, q: Array) -> float:
        """What is left of the smallest gap after the padding, m; negative when too near, at most the field's reach."""
        return self._least(q)[0]

    def nearest(self, q: Array) -> Nearest:
        """The nearest thing and which link it threatens."""
        clearance, kind, sphere, other = self._least(q)
        kernels = _kernels()
        if kind == kernels.NOTHING:
            return Nearest(clearance_m=clearance, link="", other="")
        names = {kernels.CLOUD: "cloud"}
        if kind == kernels.BOX:
            names[kind] = self.model.boxes[other].name
        elif kind == kernels.SELF:
            names[kind] = self.model.links[other]
        return Nearest(clearance_m=clearance, link=self.model.links[sphere], other=names[kind])

    def sphere_centers(self, q: Array) -> Array:
        """(m, 3) m, centres of the model's spheres in the base frame at joint angles `q` (n,) rad."""
        return _kernels().sphere_centers(self._joints(q), self._arm)

    def edge_valid(self, q0: Array, q1: Array) -> bool:
        """Whether the straight joint motion from `q0` to `q1`, both (n,) rad, keeps the paddings all along."""
        return self._edge(q0, q1, self.options.padding_m)

    def edge_valid_unpadded(self, q0: Array, q1: Array) -> bool:
        """As `edge_valid`, but without the padding to the cloud and boxes: for leaving a place that is too near."""
        return self._edge(q0, q1, 0.0)

    def path_valid(self, waypoints: Array) -> bool:
        """Whether every edge of the polyline (k, n) is valid."""
        return all(self.edge_valid(a, b) for a, b in pairwise(waypoints))

    def _least(self, q: Array) -> tuple[float, int, int, int]:
        self.checked += 1
        return _kernels().least_clearance(self._joints(q), self._arm, self._distance)

    def _edge(self, q0: Array, q1: Array, padding: float) -> bool:
        valid, checked = _kernels().edge_valid(
            self._joints(q0),
            self._joints(q1),
            self.model.reach,
            self._arm,
            self._distance,
            padding,
            self.options.self_padding_m,
            self.options.least_step_m,
        )
        self.checked += checked
        return valid

    def _joints(self, q: Array) -> Array:
        q = np.ascontiguousarray(q, float)
        if q.shape != self._shape or not isfinite(sum(q.tolist())):
            raise self._refusal(q)
        return q

    def _refusal(self, q: Array) -> InvalidInput:
        return InvalidInput(f"joint angles must be finite and have shape {self._shape}, got {q}")


def packed(model: SphereModel, field: DistanceField, options: CheckerOptions) -> Array:
    """Everything but the distances in one table for the kernels; `_body_kernels` says what stands in its rows."""
    capsules = _capsule_columns(model)
    first = np.searchsorted([capsule.joint for capsule in model.capsules], np.arange(model.joint_count + 2))
    joints = np.concatenate([np.eye(4)[None, :3], model.placements[:, :3]]).reshape(-1, 12)
    pairs = np.searchsorted(capsules[:, 0], model.capsule_pairs[:, [0, 2]])
    boxes = model.box_table if len(model.box_table) else np.zeros((1, 6))
    low, high = (boxes[:, :3] - boxes[:, 3:]).min(axis=0), (boxes[:, :3] + boxes[:, 3:]).max(axis=0)
    half = 0.5 * field.voxel_m * np.array(field.distance.shape)
    parts = (
        [[model.joint_count, len(capsules), len(pairs), len(model.box_table), len(model.spheres)]],
        [[options.padding_m, options.self_padding_m]], [field.grid],
        [[*(field.origin - 0.5 * field.voxel_m + half), *half]], [[*(0.5 * (low + high)), *(0.5 * (high - low))]],
        np.column_stack([joints, first[:-1], first[1:]]), np.column_stack([capsules, np.zeros((len(capsules), 9))]),
        np.column_stack([pairs, model.capsule_pairs[:, 4]]), model.box_table.T, model.box_mask,
        np.zeros((len(capsules), int(np.ptp(capsules[:, :2], axis=1).max()) + 1)),
    )  # fmt: skip
    shapes = [np.shape(part) for part in parts]
    table, row = np.zeros((sum(height for height, _ in shapes), max(width for _, width in shapes))), 0
    for part, (height, width) in zip(parts, shapes, strict=True):
        table[row : row + height, :width] = part
        row += height
    return table


def _capsule_columns(model: SphereModel) -> Array:
    """(c, 12) first and last sphere, half the length with the ends, spheres per metre, the spheres' radius, 1 / step^2
    (1/m^2, 0 where there is one sphere), first centre (3) and step to the next (3) in the frame of the joint."""
    table = model.capsule_table
    first, last = model.spheres[table[:, 0].astype(int)], model.spheres[table[:, 1].astype(int)]
    steps = np.maximum(table[:, 1] - table[:, 0], 1.0)
    step = (last[:, 1:4] - first[:, 1:4]) / steps[:, None]
    squared = (step**2).sum(axis=1)
    inverse = np.divide(1.0, squared, out=np.zeros_like(squared), where=squared > 0.0)
    return np.column_stack([table, np.sqrt(inverse), first[:, 4], inverse, first[:, 1:4], step])
