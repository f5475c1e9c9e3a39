"""AMCL beside a filter: its pose is one more measurement while the two agree, and a discord when they do not."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, sqrt

import numpy as np

from grape.errors import InvalidInput
from grape.localization.amcl import Amcl, AmclEstimate, AmclOptions
from grape.localization.discord import (
    Accord,
    Agreement,
    DiscordOptions,
    DiscordWatch,
    PlanarBelief,
    belief_of,
    from_amcl,
)
from grape.localization.likelihood_field import LikelihoodField
from grape.localization.refusals import Discord
from grape.localization.state import Measurement
from grape.mapping.planar import compose
from grape.messages import Array, LaserScan, Odometry

SOURCE = "amcl"


@dataclass(frozen=True, kw_only=True)
class AmclInputOptions:
    """AMCL, how it is compared with the filter, and when it begins (anew).

    Args:
        least_way, least_turn: m and rad, standard deviations AMCL is never believed below: its errors last for some
            metres, while the filter takes each pose for a new one.
        known_way, known_turn: m and rad; it begins around the filter's pose once that is known as well as this.
        restart_after_s: so long in discord, it begins anew around the filter's pose, if that is known well enough.
    """

    amcl: AmclOptions = field(default_factory=AmclOptions)
    watch: DiscordOptions = field(default_factory=lambda: DiscordOptions(least_way=0.05))
    least_way: float = 0.08
    least_turn: float = 0.03
    known_way: float = 0.3
    known_turn: float = 0.2
    restart_after_s: float = 20.0

    def __post_init__(self) -> None:
        if not min(self.least_way, self.least_turn, self.known_way, self.known_turn, self.restart_after_s) > 0:
            raise InvalidInput(f"lengths, angles and times of AMCL as an input must be positive, got {self}")


class Reckoning:
    """What the filter's velocities add up to: it drifts, but never jumps with the filter's pose."""

    def __init__(self) -> None:
        self._stamp = -inf
        self._pose = np.zeros(3)
        self._twist = np.zeros(3)

    def advance(self, odometry: Odometry) -> None:
        """Go on to the stamp of a newer odometry, with the mean of the velocities before and now."""
        twist = np.array([odometry.linear[0], odometry.linear[1], odometry.angular[2]])
        if self._stamp == -inf:
            self._stamp, self._twist = odometry.stamp, twist
            return
        if odometry.stamp > self._stamp:
            self._pose = _moved(self._pose, 0.5 * (self._twist + twist), odometry.stamp - self._stamp)
            self._stamp, self._twist = odometry.stamp, twist

    def pose(self, stamp: float) -> Array:
        """(3,) x y yaw at a time near the newest odometry, in the frame where it began."""
        return _moved(self._pose, self._twist, stamp - self._stamp)


class AmclInput:
    """Runs AMCL on a map and gives a filter its poses, as long as they agree with the filter's.

    While they part the filter goes its own way and `discord` says so; which of the two is right nobody here can know.
    AMCL moves by the filter's velocities alone, so a filter that jumps does not carry it along.

    Args:
        field: likelihood field of the map.
        rng: AMCL's chance.
        mount: (3,) x y yaw of the laser on the robot.
    """

    def __init__(
        self,
        field: LikelihoodField,
        rng: np.random.Generator,
        options: AmclInputOptions | None = None,
        mount: Array | None = None,
    ) -> None:
        self.options = options or AmclInputOptions()
        self.discord: Discord | None = None
        self.estimate: AmclEstimate | None = None  # of the newest scan; None before the first
        self._rng = rng
        self.amcl = Amcl(field, self.options.amcl, mount)
        self._watch = DiscordWatch(self.options.watch)
        self._reckoning = Reckoning()
        self._apart_since = inf

    def advance(self, odometry: Odometry) -> None:
        """Take in the filter's odometry, as often as the base's velocity may change."""
        self._reckoning.advance(odometry)

    def take(self, scan: LaserScan, odometry: Odometry) -> Measurement | None:
        """Take a scan, and the filter's odometry at the same time.

        Returns:
            AMCL's pose for the filter; None where it did not use the scan, or does not agree with the filter.
        """
        believed = _planar(odometry)
        if self._begins(believed, scan.stamp):
            self.amcl.start(believed.pose, believed.covariance, self._rng)
            self._watch, self.discord, self._apart_since = DiscordWatch(self.options.watch), None, inf
        elif self.estimate is None:
            return None
        self.estimate = self.amcl.update(self._reckoning.pose(scan.stamp), scan, self._rng)
        if not self.estimate.updated:
            return None
        agreement = self._watch.compare(believed, belief_of(self.estimate), self.estimate.share)
        self._note(agreement, scan.stamp)
        return from_amcl(scan.stamp, self.estimate, agreement, self.options.least_way, self.options.least_turn)

    def _begins(self, believed: PlanarBelief, stamp: float) -> bool:
        options = self.options
        if self.estimate is not None and (self.discord is None or stamp - self.discord.since < options.restart_after_s):
            return False
        widest = np.linalg.eigvalsh(believed.covariance[:2, :2])[-1]
        return bool(widest < options.known_way**2 and believed.covariance[2, 2] < options.known_turn**2)

    def _note(self, agreement: Agreement, stamp: float) -> None:
        accord = agreement.accord
        if accord is Accord.AGREE:
            self.discord, self._apart_since = None, inf
        elif agreement.chi_square > self.options.watch.gate:
            self._apart_since = min(self._apart_since, stamp)
        if accord is Accord.DISCORD:
            self.discord = Discord(
                source=SOURCE,
                sigma=sqrt(agreement.chi_square),
                since=self._apart_since,
                times=agreement.in_a_row,
            )


def _moved(pose: Array, twist: Array, duration: float) -> Array:
    """A pose (3,) after moving with a twist (3,) for so long (s), on the arc's chord."""
    turn = twist[2] * duration
    c, s = np.cos(0.5 * turn), np.sin(0.5 * turn)
    way = twist[:2] * duration
    return compose(pose, np.array([c * way[0] - s * way[1], s * way[0] + c * way[1], turn]))


def _planar(odometry: Odometry) -> PlanarBelief:
    """x, y and yaw of an odometry."""
    T, index = odometry.pose, [0, 1, 5]
    yaw = np.arctan2(T[1, 0], T[0, 0])
    return PlanarBelief(
        pose=np.array([T[0, 3], T[1, 3], yaw]), covariance=odometry.pose_covariance[np.ix_(index, index)]
    )
