"""Straight hand motions as joint waypoints, by continuation of the inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from grape.errors import ActionFailed, InvalidInput, Reason
from grape.geometry import interpolate, is_pose, pose_error, rotation_log
from grape.kinematics import ArmModel, IkOptions, inverse
from grape.messages import Array, frozen_array


@dataclass(frozen=True, kw_only=True)
class CartesianOptions:
    """How a straight line is followed.

    Args:
        step_m, step_rad: largest hand motion between two waypoints.
        jump_rad: largest joint motion between two waypoints; more means another branch.
        sigma_min: smallest allowed singular value of the Jacobian (angular rows times 0.2 m/rad).
    """

    step_m: float = 0.005
    step_rad: float = 0.03
    jump_rad: float = 0.25
    sigma_min: float = 0.005


@dataclass(frozen=True, kw_only=True)
class CartesianPath:
    """Joint waypoints (k, n) rad of a straight hand motion, absolute, and the hand poses (k, 4, 4) that they reach."""

    waypoints: Array
    poses: Array


class CartesianPathBroken(ActionFailed):
    """A straight line ends before its target.

    Args:
        reason: UNREACHABLE or IN_COLLISION.
        detail: what stopped it.
        fraction: 0..1 of the line that was followed.
        waypoints: (k, n) rad of that part.
    """

    def __init__(self, reason: Reason, detail: str, fraction: float, waypoints: Array) -> None:
        super().__init__(reason, f"{detail} after {100 * fraction:.0f} % of the straight line")
        self.fraction = fraction
        self.waypoints = waypoints


def cartesian_path(
    arm: ArmModel,
    q_start: Array,
    T_base_target: Array,
    options: CartesianOptions | None = None,
    *,
    edge_valid: Callable[[Array, Array], bool] | None = None,
) -> CartesianPath:
    """Joint waypoints that move the hand on a straight line, its orientation turning about one axis.

    Args:
        arm: the kinematics; `base` is its base frame.
        q_start: (n,) rad where the motion starts.
        T_base_target: pose (4, 4) of the hand at the end; with the start's rotation the orientation stays constant.
        options: step sizes and limits.
        edge_valid: check of a straight joint motion, such as `StateChecker.edge_valid`.

    Raises:
        InvalidInput: the target is not a pose.
        CartesianPathBroken: UNREACHABLE or IN_COLLISION, with the fraction that was reached.
    """
    options = options or CartesianOptions()
    if not is_pose(T_base_target):
        raise InvalidInput(f"T_base_target must be a rigid pose, got {T_base_target}")
    q = np.array(q_start, dtype=float)
    T_start = arm.fk(q).copy()
    error = pose_error(T_base_target, T_start)
    steps = max(float(np.linalg.norm(error[:3])) / options.step_m, float(np.linalg.norm(error[3:])) / options.step_rad)
    count = max(int(np.ceil(steps)), 1)
    waypoints, poses = [q], [T_start]
    for k in range(1, count + 1):
        T = interpolate(T_start, T_base_target, k / count)
        q_next, trouble = _advance(arm, q, T, options)
        if trouble:
            raise CartesianPathBroken(Reason.UNREACHABLE, trouble, (k - 1) / count, frozen_array(waypoints))
        if edge_valid is not None and not edge_valid(q, q_next):
            raise CartesianPathBroken(Reason.IN_COLLISION, "collision", (k - 1) / count, frozen_array(waypoints))
        q = q_next
        waypoints.append(q)
        poses.append(T)
    return CartesianPath(waypoints=frozen_array(waypoints), poses=frozen_array(poses))


def linear_target(T_base_hand: Array, displacement: Array) -> Array:
    """The hand pose moved by `displacement` (3,) m, base axes, with the same orientation."""
    T = np.array(T_base_hand, dtype=float)
    T[:3, 3] += displacement
    return T


def _advance(arm: ArmModel, q: Array, T: Array, options: CartesianOptions) -> tuple[Array, str]:
    """The next waypoint, and why there is none."""
    result = inverse(arm, T, q, IkOptions(iterations=30, step_max=0.2))
    if not result.converged:
        angle = np.degrees(np.linalg.norm(rotation_log(arm.fk(result.q)[:3, :3].T @ T[:3, :3])))
        return q, f"the hand stays {result.position_error * 1e3:.1f} mm and {angle:.1f} deg away"
    jump = float(np.abs(result.q - q).max())
    if jump > options.jump_rad:
        return q, f"a joint would jump by {jump:.2f} rad"
    sigma = arm.sigma_min(result.q)
    if sigma < min(options.sigma_min, arm.sigma_min(q)):
        return q, f"near a singularity (sigma {sigma:.4f})"
    return result.q, ""
