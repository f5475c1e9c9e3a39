"""Whether an arm state or a straight joint motion is free of collision, and by how much."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
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
        self._arm = packed(model, self.field.grid)
        self._shape = (model.joint_count,)
        self._margins = self.options.padding_m, self.options.self_padding_m
        self.checked = 0  # states looked at since the start, a measure of work that no clock disturbs

    def is_valid(self, q: Array) -> bool:
        """Whether nothing is nearer than the paddings at joint angles `q` (n,) rad."""
        self.checked += 1
        return _kernels().state_valid(self._joints(q), self._arm, self.field.distance, *self._margins)

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
        return _kernels().least_clearance(self._joints(q), self._arm, self.field.distance, *self._margins)

    def _edge(self, q0: Array, q1: Array, padding: float) -> bool:
        options = self.options
        valid, checked = _kernels().edge_valid(
            self._joints(q0),
            self._joints(q1),
            self.model.reach,
            self._arm,
            self.field.distance,
            padding,
            options.self_padding_m,
            options.least_step_m,
        )
        self.checked += checked
        return valid

    def _joints(self, q: Array) -> Array:
        q = np.asarray(q, dtype=float)
        if q.shape != self._shape:
            raise InvalidInput(f"joint angles must have shape {self._shape}, got {q.shape}")
        return q if q.flags.c_contiguous else q.copy()


def packed(model: SphereModel, grid: Array) -> Array:
    """Everything but the distances in one flat array: a call that takes few arrays costs little."""
    first = np.searchsorted(model.spheres[:, 0], np.arange(model.joint_count + 2))
    pairs = np.searchsorted(model.capsule_table[:, 0], model.capsule_pairs[:, [0, 2]])
    counts = [model.joint_count, len(model.spheres), len(model.capsule_table), len(pairs), len(model.box_table)]
    first_last, half = model.capsule_table[:, :2], model.capsule_table[:, 2]
    length = 2.0 * (half - model.spheres[first_last[:, 0].astype(int), 4])
    per_metre = (first_last[:, 1] - first_last[:, 0]) / np.maximum(length, 1e-9)  # spheres along a capsule
    capsules = np.column_stack([model.capsule_table, per_metre])
    boxes = model.box_table if len(model.box_table) else np.zeros((1, 6))
    low, high = (boxes[:, :3] - boxes[:, 3:]).min(axis=0), (boxes[:, :3] + boxes[:, 3:]).max(axis=0)
    parts = (
        counts, grid, model.placements[:, :3], model.spheres[:, 1:].T, first, capsules,
        pairs, model.box_table.T, model.box_mask, np.zeros(3 * (counts[1] + counts[2]) + counts[4]),
        0.5 * (low + high), 0.5 * (high - low),
    )  # fmt: skip
    return np.concatenate([np.ravel(part) for part in parts]).astype(float)
