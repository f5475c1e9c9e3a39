"""Inverse kinematics of an arm without a closed form: damped least squares from several seeds.

Source: Nakamura and Hanafusa, Inverse kinematic solutions with singularity robustness for robot manipulator control,
1986.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import is_pose, wrap_angle
from grape.kinematics.arm import ArmModel
from grape.messages import Array, frozen_array


@dataclass(frozen=True, kw_only=True)
class IkOptions:
    """Settings of the iteration and of the ranking of solutions."""

    iterations: int = 80
    position_tolerance: float = 1e-5  # m
    rotation_tolerance: float = 1e-4  # rad
    step_max: float = 0.4  # rad a joint and iteration
    damping: float = 1e-4  # far from the target; a thousandth of it near the target
    seeds: int = 40
    same_solution: float = 0.05  # rad: closer solutions count as one
    sigma_weight: float = 1.0  # score per m
    limit_weight: float = 0.02  # score per rad of distance to a limit, up to 0.3 rad
    travel_weight: float = 0.005  # score lost per rad of the largest joint move from the reference


@dataclass(frozen=True, kw_only=True)
class IkResult:
    """How an iteration ended; `q` is the best guess even when it did not converge."""

    converged: bool
    q: Array  # (n,) rad
    position_error: float  # m
    rotation_error: float  # rad
    iterations: int


@dataclass(frozen=True, kw_only=True)
class IkSolution:
    """One arm pose for a hand pose; a higher score is better."""

    q: Array  # (n,) rad, absolute, in the winding nearest to the reference
    sigma_min: float  # m
    limit_distance: float  # rad
    travel: float  # rad, largest joint move from the reference
    score: float


def inverse(arm: ArmModel, T_base_hand: Array, q_seed: Array, options: IkOptions | None = None) -> IkResult:
    """Joint angles that put the hand at a pose, found from a seed; joints stay inside their limits.

    Args:
        arm: the arm.
        T_base_hand: wanted pose (4, 4) of the hand in the arm's base frame.
        q_seed: (n,) rad where the iteration starts.
        options: settings; the defaults reach 0.01 mm.

    Raises:
        InvalidInput: the pose is not a rigid pose, or the seed is malformed.
    """
    options = options or IkOptions()
    if not is_pose(T_base_hand):
        raise InvalidInput(f"T_base_hand must be a rigid pose (4, 4), got {np.asarray(T_base_hand)}")
    from grape.kinematics._inverse_kernels import solve

    converged, q, error, iterations = solve(
        arm.placements,
        arm.axes,
        arm.position_min,
        arm.position_max,
        np.ascontiguousarray(T_base_hand, dtype=float),
        np.clip(np.asarray(q_seed, float), arm.position_min, arm.position_max),
        options.iterations,
        options.position_tolerance,
        options.rotation_tolerance,
        options.step_max,
        options.damping,
    )
    return IkResult(
        converged=converged,
        q=frozen_array(q),
        position_error=float(np.linalg.norm(error[:3])),
        rotation_error=float(np.linalg.norm(error[3:])),
        iterations=iterations,
    )


def inverse_all(
    arm: ArmModel,
    T_base_hand: Array,
    reference: Array,
    *,
    seeds: Array | None = None,
    rng: np.random.Generator | None = None,
    options: IkOptions | None = None,
) -> tuple[IkSolution, ...]:
    """Every distinct arm pose found for a hand pose, best first; collisions are not looked at.

    Args:
        arm: the arm.
        T_base_hand: wanted pose (4, 4) of the hand in the arm's base frame.
        reference: (n,) rad, usually where the arm is now: fixes the winding and is tried as the first seed.
        seeds: (m, n) rad further starts, tried before the scattered ones.
        rng: scatters the remaining seeds; without it they follow a fixed low-discrepancy sequence.
        options: settings.

    Returns:
        Solutions by falling score: distance from singularities and limits counts for, joint travel against. Empty when
        the pose is out of reach of every seed.
    """
    options = options or IkOptions()
    reference = np.asarray(reference, float)
    starts = [reference, *(() if seeds is None else np.atleast_2d(seeds)), *scattered_postures(arm, options.seeds, rng)]
    found: list[IkSolution] = []
    for start in starts:
        result = inverse(arm, T_base_hand, start, options)
        if result.converged and not any(_same(arm, result.q, other.q, options.same_solution) for other in found):
            found.append(_rated(arm, result.q, reference, options))
    return tuple(sorted(found, key=lambda solution: -solution.score))


def inverse_path(
    arm: ArmModel, poses: Array, q_start: Array, *, step_max: float = 0.6, options: IkOptions | None = None
) -> Array | None:
    """Joint angles (m, n) that follow hand poses (m, 4, 4) in one branch from `q_start`; None when the branch breaks.

    A branch breaks where a pose cannot be reached or any joint would jump by more than `step_max` rad.
    """
    path, q = [], np.asarray(q_start, float)
    for T in poses:
        result = inverse(arm, T, q, options)
        if not result.converged or float(np.abs(result.q - q).max()) > step_max:
            return None
        q = result.q
        path.append(q)
    return np.array(path)


def scattered_postures(arm: ArmModel, count: int, rng: np.random.Generator | None = None) -> Array:
    """Seeds (count, n) spread over the joint ranges; continuous joints over one turn."""
    low = np.where(np.isinf(arm.position_min), -np.pi, arm.position_min + 0.1)
    high = np.where(np.isinf(arm.position_max), np.pi, arm.position_max - 0.1)
    if rng is not None:
        return rng.uniform(low, high, (count, arm.dof))
    # R-sequence (Roberts, 2018): additive recurrence with the root of x^(n+1) = x + 1
    root = 2.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (arm.dof + 1))
    steps = (1.0 / root) ** np.arange(1, arm.dof + 1)
    return low + (high - low) * np.mod(0.5 + np.outer(np.arange(count), steps), 1.0)


def _same(arm: ArmModel, q: Array, other: Array, tolerance: float) -> bool:
    difference = np.where(np.isinf(arm.position_min), wrap_angle(q - other), q - other)
    return bool(np.abs(difference).max() < tolerance)


def _rated(arm: ArmModel, q: Array, reference: Array, options: IkOptions) -> IkSolution:
    q = arm.nearest_winding(q, reference)
    sigma, limit = arm.sigma_min(q), arm.limit_distance(q)
    travel = float(np.abs(q - reference).max())
    score = options.sigma_weight * sigma + options.limit_weight * min(limit, 0.3) - options.travel_weight * travel
    return IkSolution(q=frozen_array(q), sigma_min=sigma, limit_distance=limit, travel=travel, score=score)
