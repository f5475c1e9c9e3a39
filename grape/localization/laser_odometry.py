"""How the base moves by what its laser sees, where that tells: scan against scan, wheels unheard.

A scan is matched against the last reference as in SLAM, around a guess. Along a wall or a hedge it fits as well farther
on, and the fit alone would say with confidence that the base stands: it slides. So it is tried farther along the axis
that the fit knows least, and where it fits nearly as well there, that axis counts as unknown.

Source: Olson, Real-time correlative scan matching, ICRA 2009; Censi, An ICP variant using a point-to-line metric, ICRA
2008; Zhang, Kaess and Singh, On degeneracy of optimization-based state estimation problems, ICRA 2016.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grape.errors import InvalidInput
from grape.localization.state import STATE, Measurement
from grape.mapping.planar import between, compose, transform_points
from grape.mapping.scan_matcher import Match, MatchOptions, Reference, match
from grape.messages import Array

SOURCE = "laser"
_INDEX = np.array([STATE.index("vx"), STATE.index("vy"), STATE.index("wz")])
_UNKNOWN = np.array([1.0, 1.0, 0.5])  # m, m, rad: nothing is known worse than this within one step


@dataclass(frozen=True, kw_only=True)
class LaserOdometryOptions:
    """Lengths in m, angles in rad, times in s.

    Args:
        reach, turn: how far from the guess a scan is looked for.
        key_way, key_turn: so far from the reference, a newer scan takes its place.
        least_points: scans with fewer tell nothing.
        least_inliers: share of points that must fit.
        turn_error: rad/s, by which a match may turn otherwise than the guess, whose rate a gyroscope tells.
        longest_s: between two scans; after a longer silence the next one is a new beginning.
        slide_from, slide_to: how far along the least certain axis the scan is tried.
        slide_share: where it fits there by more than this share of how well it fits here, it slides.
    """

    matching: MatchOptions = field(default_factory=lambda: MatchOptions(correlated=2.5, wall=0.3))
    reach: float = 0.3
    turn: float = 0.1
    key_way: float = 0.3
    key_turn: float = 0.3
    least_points: int = 12
    least_inliers: float = 0.7
    turn_error: float = 0.25
    longest_s: float = 1.0
    slide_from: float = 0.3
    slide_to: float = 0.6
    slide_share: float = 0.8

    def __post_init__(self) -> None:
        lengths = (self.reach, self.turn, self.key_way, self.key_turn, self.longest_s, self.slide_from, self.turn_error)
        if not min(lengths) > 0 or not self.slide_to > self.slide_from or self.least_points < 5:
            raise InvalidInput(f"lengths, angles and times must be positive, and 5 points be asked for, got {self}")


@dataclass(frozen=True, kw_only=True)
class LaserMotion:
    """How the base moved from one scan to the next.

    Attributes:
        stamp: s, middle of both scans.
        twist: (3,) vx (m/s), vy (m/s), wz (rad/s) in base_link.
        covariance: (3, 3) of it; along an axis on which the scan slides it is large.
        slides: whether there is such an axis.
    """

    stamp: float
    twist: Array
    covariance: Array
    slides: bool

    def measurement(self) -> Measurement:
        """What `PoseEstimator.take_motion` and `Fusion.correct` take."""
        return Measurement(stamp=self.stamp, source=SOURCE, index=_INDEX, value=self.twist, covariance=self.covariance)


class LaserOdometry:
    """Matches scan after scan."""

    def __init__(self, options: LaserOdometryOptions | None = None) -> None:
        self.options = options or LaserOdometryOptions()
        self._reference: Reference | None = None
        self._pose = np.zeros(3)  # of the newest scan on the reference
        self._stamp = -np.inf

    def take(self, stamp: float, points: Array, twist: Array) -> LaserMotion | None:
        """Take a scan.

        Args:
            points: (n, 2) m, what stands around the base, in base_link levelled; rows that are not finite do not count.
            twist: (3,) vx, vy, wz that it probably moved with since the scan before, as the filter has it.

        Returns:
            None with the first scan, or where it does not tell.

        Raises:
            InvalidInput: points or twist have another shape, or the twist is not finite.
        """
        options, points, twist = self.options, np.asarray(points, float), np.asarray(twist, float)
        if points.ndim != 2 or points.shape[1] != 2 or twist.shape != (3,) or not np.isfinite(twist).all():
            raise InvalidInput(f"points (n, 2) and a finite twist (3,) needed, got {points.shape} and {twist}")
        points, duration = points[np.isfinite(points).all(axis=1)], stamp - self._stamp
        if not duration > 0:
            return None
        self._stamp = stamp
        if self._reference is None or duration > options.longest_s or len(points) < options.least_points:
            self._begin(points)
            return None
        guess = compose(self._pose, twist * duration)
        found = match(self._reference, points, guess, options.reach, options.turn)
        step = between(self._pose, found.pose)
        turns_otherwise = abs(step[2] / duration - twist[2]) > options.turn_error
        if found.inliers < options.least_inliers or turns_otherwise:
            self._begin(points)
            return None
        slides, covariance = self._certainty(found, points)
        self._pose = found.pose
        if np.hypot(*found.pose[:2]) > options.key_way or abs(found.pose[2]) > options.key_turn:
            self._begin(points)
        return LaserMotion(
            stamp=stamp - 0.5 * duration, twist=step / duration, covariance=covariance / duration**2, slides=slides
        )

    def _begin(self, points: Array) -> None:
        enough = len(points) >= self.options.least_points
        self._reference = Reference(points, self.options.matching) if enough else None
        self._pose = np.zeros(3)

    def _certainty(self, found: Match, points: Array) -> tuple[bool, Array]:
        """Whether a match slides, and its covariance (3, 3) in the robot's axes."""
        options = self.options
        covariance = np.linalg.inv(found.information + np.diag(_UNKNOWN**-2))
        axis = np.array([*np.linalg.eigh(covariance[:2, :2])[1][:, 1], 0.0])  # which it knows least
        ways = np.linspace(options.slide_from, options.slide_to, 4)
        here, *farther = (self._fits(compose(found.pose, way * axis), points) for way in (0.0, *ways, *-ways))
        slides = max(farther) > options.slide_share * here
        if slides:
            covariance = covariance + _UNKNOWN[0] ** 2 * np.outer(axis, axis)
        return slides, 0.5 * (covariance + covariance.T)

    def _fits(self, pose: Array, points: Array) -> float:
        """Mean of the reference's field at a scan's points, 0 to 1."""
        assert self._reference is not None
        spec, field_ = self._reference.spec, self._reference.field
        cells = spec.cells(transform_points(pose, points))
        inside = ((cells >= 0) & (cells < [spec.rows, spec.columns])).all(axis=1)
        return float(field_[tuple(cells[inside].T)].sum() / len(points))
