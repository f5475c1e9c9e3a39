"""Deployment poses against the true spurs: which are right, what is missed, how far off they are.

Source: the perception study's definitions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from grape.experiments.vine_scans import TrueSpur
from grape.tasks.dispenser.perception.deployment_pose import DeploymentPose

SAME_M = 0.045  # a pose belongs to the spur whose tip is this near, seen from the robot
HANGABLE_TILT_DEG = 60.0
FIRST_M, FIRST_DEG = 0.040, 20.0  # a right first pose
LISTED_DEG, FOUND_DEG = 25.0, 30.0  # a right pose of the list; a found spur
USABLE_TILT_DEG, USABLE_SEEN, USABLE_BESIDE_M = 50.0, 0.5, 0.55
USABLE_HEIGHT_M = (0.42, 1.20)


def usable(spur: TrueSpur) -> bool:
    """Whether the robot should find a spur: on the scanned vine, upright enough, half of it in view, before the arm."""
    high = USABLE_HEIGHT_M[0] < spur.height_m < USABLE_HEIGHT_M[1]
    near = abs(spur.beside_m) < USABLE_BESIDE_M
    return spur.own and spur.tilt_deg <= USABLE_TILT_DEG and spur.seen >= USABLE_SEEN and high and near


@dataclass(frozen=True, kw_only=True)
class Match:
    """One pose and the spur it belongs to (None: there is none)."""

    pose: DeploymentPose
    spur: TrueSpur | None

    @property
    def tip_m(self) -> float:
        """Distance of found and true tip."""
        return float(np.linalg.norm(self.pose.tip - self.spur.tip)) if self.spur is not None else np.inf

    @property
    def angle_deg(self) -> float:
        """Angle between found and true direction."""
        if self.spur is None:
            return np.inf
        return float(np.degrees(np.arccos(np.clip(self.pose.direction @ self.spur.direction, -1.0, 1.0))))

    @property
    def right(self) -> bool:
        """Whether the pose of a list is right."""
        return self.spur is not None and self.angle_deg < LISTED_DEG and self.spur.tilt_deg <= HANGABLE_TILT_DEG

    @property
    def right_first(self) -> bool:
        """Whether it may stand at the top of a list."""
        return self.right and self.tip_m < FIRST_M and self.angle_deg < FIRST_DEG


def match(poses: Sequence[DeploymentPose], spurs: Sequence[TrueSpur]) -> list[Match]:
    """Each pose, best first, with the nearest spur that no better pose has taken."""
    left, found = list(spurs), []
    for pose in poses:
        apart = [float(np.hypot(*(pose.tip - spur.tip)[[0, 2]])) for spur in left]
        best = int(np.argmin(apart)) if apart else -1
        taken = left.pop(best) if best >= 0 and apart[best] < SAME_M else None
        found.append(Match(pose=pose, spur=taken))
    return found


@dataclass(frozen=True, kw_only=True)
class Tally:
    """Counts over vines: vines with a list, right first poses, poses, right poses, usable spurs, found ones; errors."""

    vines: int = 0
    listed: int = 0
    first: int = 0
    poses: int = 0
    right: int = 0
    usable: int = 0
    found: int = 0
    tip_m: tuple[float, ...] = ()
    angle_deg: tuple[float, ...] = ()
    diameter_m: tuple[float, ...] = ()

    def __add__(self, other: Tally) -> Tally:
        return Tally(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(Tally)})


def tally(poses: Sequence[DeploymentPose], spurs: Sequence[TrueSpur]) -> Tally:
    """What one vine's list is worth."""
    matches = match(poses, spurs)
    hits = [m for m in matches if m.spur is not None and usable(m.spur) and m.angle_deg < FOUND_DEG]
    return Tally(
        vines=1,
        listed=int(bool(poses)),
        first=int(bool(matches) and matches[0].right_first),
        poses=len(poses),
        right=sum(m.right for m in matches),
        usable=sum(usable(spur) for spur in spurs),
        found=len(hits),
        tip_m=tuple(m.tip_m for m in hits),
        angle_deg=tuple(m.angle_deg for m in hits),
        diameter_m=tuple(m.pose.diameter_m - m.spur.diameter_m for m in hits if m.spur is not None),
    )
