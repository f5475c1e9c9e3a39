"""In which orientation the hand goes over a spur: with room for the arm, and for the nails to let go beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grape.actions.robot import Robot
from grape.messages import Array
from grape.tasks.dispenser.stops import margins_of
from grape.tasks.dispenser.targets import AIM_DEPTH_M, AIM_OFFSET_M, RETREAT_M, HangTarget

ALIKE, EASY = 0.2, 0.6  # margins of the arm this near are alike; from here on more of it is worth nothing
GAP_M = 0.004  # from here on more room between nails and spur is worth nothing: tips are known to 4 mm, hands to 2
TIGHT_M = 0.001  # nearer than this the nails may press on the spur
WOOD_M = 0.12  # of a spur below its tip that counts
FINE_M = 0.002  # between points of nails and spur


def ways_by_ease(robot: Robot, ways: Sequence[HangTarget]) -> list[HangTarget]:
    """Those orientations in which the arm can do the whole motion, best first; of equal ones that which came first.

    Args:
        robot: models of the robot.
        ways: one place to hang a dispenser, in each orientation of the hand that may be tried.
    """
    if not ways:
        return []
    margins = margins_of(robot, ways)
    gaps = np.array([nail_gap(robot, way) for way in ways])
    ease = np.minimum(np.round(margins / ALIKE), round(EASY / ALIKE))
    room = np.round(EASY / ALIKE * np.clip(gaps / GAP_M, 0.0, 1.0))  # counts for as much
    return [ways[k] for k in np.argsort(-(ease + room), kind="stable") if margins[k] > 0.0]


def is_tight(robot: Robot, way: HangTarget) -> bool:
    """Whether the nails may press on a spur when they let go beside it."""
    return nail_gap(robot, way) < TIGHT_M


def tight_last(robot: Robot, ways: Sequence[HangTarget]) -> list[HangTarget]:
    """The same ways in their order, but those that are tight at the end, the tightest last."""
    return sorted(ways, key=lambda way: -min(nail_gap(robot, way), TIGHT_M))


def nail_gap(robot: Robot, target: HangTarget) -> float:
    """Least distance (m) between a spur and the nails while they close and the hand backs off; below 0 they touch.

    The spur is taken for straight, and on beyond its base, where older wood is.

    Args:
        robot: models of the robot.
        target: spur, in the orientation of the hand.
    """
    R = target.rotation()
    tip = AIM_DEPTH_M * (R.T @ target.approach) + [0.0, AIM_OFFSET_M, 0.0]  # from the nails' mid-point, hand's axes
    wood = tip - np.arange(0.0, WOOD_M, FINE_M)[:, None] * (R.T @ target.direction)
    points, radii = _swept(robot)
    gaps = np.linalg.norm(wood[:, None] - points[None], axis=2) - radii
    return float(gaps.min()) - 0.5 * target.diameter


def _swept(robot: Robot) -> tuple[Array, Array]:
    """Where both nails come: points (n, 3) m from their mid-point before they close, axes of the hand; radii (n,) m."""
    gripper = robot.description.gripper
    closed, opened = (0.5 * robot.hand.gap(angle) for angle in (gripper.closed_angle, gripper.open_angle))
    x = np.arange(closed, opened, FINE_M)
    stem = np.arange(FINE_M, gripper.stem_length, 4.0 * FINE_M)
    back = np.arange(0.0, RETREAT_M, FINE_M)
    closing, stems = np.meshgrid(x, [0.0, *stem], indexing="ij")
    side = np.concatenate([closing.ravel(), np.full(back.size, closed)])
    along = np.concatenate([stems.ravel(), back])
    radii = np.where(along > 0.0, gripper.stem_radius, gripper.nail_radius)
    radii[closing.size :] = gripper.nail_radius
    points = np.column_stack([side, np.zeros(side.size), along])
    return np.vstack([points, points * [-1.0, 1.0, 1.0]]), np.concatenate([radii, radii])
