"""Where a mobile base has to stand so that its arm does its work at ease.

The margin with which an arm follows a line of hand poses, for many lines at once, and the stop at which the margins
of several lines, weighed, add up to the most.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.kinematics.arm import ROTATION_WEIGHT, ArmModel
from grape.kinematics.inverse import scattered_postures
from grape.messages import Array, frozen_array
from grape.planning.checker import CheckerOptions, packed
from grape.planning.distance_field import empty_field
from grape.planning.spheres import SphereModel


@dataclass(frozen=True, kw_only=True)
class ReachOptions:
    """What counts as reached at ease.

    Args:
        sigma_full: least singular value (m) of the Jacobian from which a posture has nothing more to gain.
        limit_full: the same for the distance (rad) to a joint limit.
        seeds: postures from which the inverse kinematics start.
        iterations: of each start.
        padding_m: between the arm and the base.
    """

    sigma_full: float = 0.08
    limit_full: float = 0.20
    seeds: int = 12
    iterations: int = 25
    padding_m: float = 0.01

    def __post_init__(self) -> None:
        if not (self.sigma_full > 0.0 and self.limit_full > 0.0 and self.seeds >= 1):
            raise InvalidInput(f"sigma_full, limit_full and seeds must be positive, got {self}")


@dataclass(frozen=True, kw_only=True)
class Reach:
    """Margins (m,) of lines, 0 (out of reach) to 1 (at ease), and the postures (m, n) rad at their starts."""

    margins: Array
    postures: Array


def reach_margins(
    arm: ArmModel,
    body: SphereModel,
    lines: Array,
    *,
    seeds: Sequence[Array] = (),
    options: ReachOptions | None = None,
) -> Reach:
    """How well an arm follows lines of hand poses, by its joint limits, its singularities and its own body.

    The margin of a line is the least along it of singular value and distance to joint limits, each relative to its
    full value, in the best posture found; a line that cannot be followed in one branch has 0.

    Args:
        arm: the arm.
        body: its collision spheres and the boxes of its base.
        lines: (m, k, 4, 4) hand poses in the arm's base frame, dense enough that joints do not jump between them.
        seeds: (n,) rad each, postures that are tried before the scattered ones.
        options: see `ReachOptions`.

    Raises:
        InvalidInput: lines are not (m, k, 4, 4).
    """
    from grape.planning._reach_kernels import best_margins

    options = options or ReachOptions()
    lines = np.ascontiguousarray(lines, dtype=float)
    if lines.ndim != 4 or lines.shape[1] < 1 or lines.shape[2:] != (4, 4):
        raise InvalidInput(f"lines must be (m, k, 4, 4), got {lines.shape}")
    field = empty_field()
    margins, postures = best_margins(
        (arm.placements, arm.axes, arm.position_min, arm.position_max),
        lines,
        np.array([*seeds, *scattered_postures(arm, options.seeds)]),
        (packed(body, field, CheckerOptions(padding_m=options.padding_m)), field.distance),
        ROTATION_WEIGHT,
        options.sigma_full,
        options.limit_full,
        options.iterations,
    )
    return Reach(margins=frozen_array(margins), postures=frozen_array(postures))


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Which of several stops is best.

    Attributes:
        index: of the best stop.
        scores: (s,) of each stop.
        margins: (s, t) of each target at each stop, in its best way.
    """

    index: int
    scores: Array
    margins: Array


def choose_stop(
    stops: int,
    ways: Callable[[int], Sequence[Array]],
    weights: Array,
    margins: Callable[[Array], Array],
    costs: Array | None = None,
) -> Placement:
    """The stop at which the margins of all targets, weighed, add up to the most.

    Args:
        stops: how many there are.
        ways: index of a stop -> for each of t targets the lines (w, k, 4, 4) of hand poses, in the arm's base frame,
            in which it may be worked on.
        weights: (t,) what each target is worth.
        margins: lines (m, k, 4, 4) -> (m,), see `reach_margins`.
        costs: (s,) what is taken from the score of each stop.

    Raises:
        InvalidInput: no stop, no target, or numbers that do not fit together.
    """
    weights = np.asarray(weights, float)
    costs = np.zeros(stops) if costs is None else np.asarray(costs, float)
    if stops < 1 or len(weights) < 1 or costs.shape != (stops,):
        raise InvalidInput(f"stops, weights and costs must not be empty and fit, got {stops}, {weights}, {costs}")
    found = np.zeros((stops, len(weights)))
    for s in range(stops):
        lines = ways(s)
        flat = margins(np.concatenate(lines))
        ends = np.cumsum([len(line) for line in lines])[:-1]
        found[s] = [part.max() for part in np.split(flat, ends)]
    scores = found @ weights / weights.sum() - costs
    return Placement(index=int(np.argmax(scores)), scores=frozen_array(scores), margins=frozen_array(found))
