"""In which orientation the hand goes over a spur: with room for the arm, and for the nails to let go beside it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from grape.actions.robot import Robot
from grape.messages import Array
from grape.tasks.dispenser.stops import margins_of
from grape.tasks.dispenser.targets import AIM_DEPTH_M, AIM_OFFSET_M, RETREAT_M, HangTarget

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

ALIKE, EASY = 0.2, 0.6  # margins of the arm this near are alike; from here on more of it is worth nothing
GAP_M = 0.004  # from here on more room between nails and wood is worth nothing: tips are known to 4 mm, hands to 2
TIGHT_M = 0.001  # nearer than this the nails may press on wood
WOOD_M = 0.12  # of a spur below its tip that counts
FINE_M = 0.002  # between points of nails and spur
OWN_M, OWN_SLOPE = (
    0.010,
    0.12,
)  # from the axis of a spur, at its tip and per m below it, what was seen is the spur itself
ABOUT_M = 0.15  # around a tip; what is farther away is an obstacle like any other


def ways_by_ease(robot: Robot, ways: Sequence[HangTarget], seen: Array | None = None) -> list[HangTarget]:
    """Those orientations in which the arm can do the whole motion, best first; of equal ones that which came first.

    Args:
        robot: models of the robot.
        ways: one place to hang a dispenser, in each orientation of the hand that may be tried.
        seen: see `nail_gap`.
    """
    if not ways:
        return []
    seen = None if seen is None else _about(ways[0].tip, seen)
    margins = margins_of(robot, ways)
    gaps = np.array([nail_gap(robot, way, seen) for way in ways])
    ease = np.minimum(np.round(margins / ALIKE), round(EASY / ALIKE))
    room = np.round(EASY / ALIKE * np.clip(gaps / GAP_M, 0.0, 1.0))  # counts for as much
    return [ways[k] for k in np.argsort(-(ease + room), kind="stable") if margins[k] > 0.0]


def is_tight(robot: Robot, way: HangTarget, seen: Array | None = None) -> bool:
    """Whether the nails may press on wood when they let go beside a spur."""
    return nail_gap(robot, way, seen) < TIGHT_M


def tight_last(robot: Robot, ways: Sequence[HangTarget], seen: Array | None = None) -> list[HangTarget]:
    """The same ways in their order, but those that are tight at the end, the tightest last."""
    return sorted(ways, key=lambda way: -min(nail_gap(robot, way, seen), TIGHT_M))


def nail_gap(robot: Robot, target: HangTarget, seen: Array | None = None) -> float:
    """Least distance (m) between wood and the nails while they close and the hand backs off; below 0 they touch.

    The spur is taken for straight, and on beyond its base, where older wood is.

    Args:
        robot: models of the robot.
        target: spur, in the orientation of the hand.
        seen: (n, 3) m in base_link, a cloud of what is there; beside the spur its neighbours count as well.
    """
    R = target.rotation()
    tip = AIM_DEPTH_M * (R.T @ target.approach) + [0.0, AIM_OFFSET_M, 0.0]  # from the nails' mid-point, hand's axes
    axis = R.T @ target.direction
    gap = _gap(robot, tip - np.arange(0.0, WOOD_M, FINE_M)[:, None] * axis) - 0.5 * target.diameter
    if seen is None:
        return gap
    from_tip = _about(target.tip, seen) - target.tip
    along = from_tip @ target.direction
    off = np.linalg.norm(from_tip - along[:, None] * target.direction, axis=1)
    own = 0.5 * target.diameter + OWN_M + OWN_SLOPE * np.maximum(-along, 0.0)
    return min(gap, _gap(robot, tip + from_tip[off > own] @ R))


def _about(tip: Array, seen: Array) -> Array:
    """Those of points (n, 3) m that are near a tip (3,) m."""
    return seen[(np.abs(seen - tip) < ABOUT_M).all(axis=1)]


def _gap(robot: Robot, points: Array) -> float:
    """Least distance (m) from points (n, 3) m to where the nails come, both from the nails' mid-point, hand's axes."""
    return min(float(tree.query(points)[0].min(initial=np.inf)) - radius for tree, radius in _swept(robot))


@lru_cache(maxsize=8)
def _swept(robot: Robot) -> tuple[tuple[cKDTree, float], ...]:
    """Where both nails and their stems come while they close and back off, and how thick they are, radii in m."""
    from scipy.spatial import cKDTree

    gripper = robot.description.gripper
    closed, opened = (0.5 * robot.hand.gap(angle) for angle in (gripper.closed_angle, gripper.open_angle))
    sides, back = np.arange(closed, opened, FINE_M), np.arange(0.0, RETREAT_M, FINE_M)
    stems = np.arange(FINE_M, gripper.stem_length, 4.0 * FINE_M)
    nail = np.vstack([_both(sides, np.zeros(1)), _both(np.array([closed]), back)])
    return (cKDTree(nail), gripper.nail_radius), (cKDTree(_both(sides, stems)), gripper.stem_radius)


def _both(sides: Array, along: Array) -> Array:
    """(n, 3) every pair of a distance to either side and one along the fingers."""
    x, z = (grid.ravel() for grid in np.meshgrid(np.concatenate([sides, -sides]), along))
    return np.column_stack([x, np.zeros(x.size), z])
