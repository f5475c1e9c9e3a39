"""Finding places that were seen before, and doubting them.

Source: Olson, Recognizing places using spectrally clustered local matches, RAS 2009 (agreement of several closures).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grape.mapping.planar import between, compose, transform_points
from grape.mapping.pose_graph import Edge
from grape.mapping.scan_matcher import Match, MatchOptions, Reference, match
from grape.mapping.scans import thinned
from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class LoopOptions:
    """When a place counts as seen again; lengths in m, angles in rad.

    Nodes are candidates when the robot has driven `least_way` since, and the estimate puts them within `near` +
    `drift` · way, at most `farthest`. The scan is matched against the `around` nodes on both sides of the nearest. A
    closure that moves the estimate by more than `small` waits for another one that agrees within `agree`.
    """

    least_way: float = 8.0
    near: float = 2.0
    drift: float = 0.03
    farthest: float = 6.0
    turn: float = 0.4
    around: int = 8
    every: int = 2  # nodes between two looks
    tries: int = 2  # places a look
    least_response: float = 0.45
    least_inliers: float = 0.7
    small: float = 0.4
    agree: float = 0.4
    wait: int = 12  # nodes that a closure waits for another
    optimise_after: int = 25  # closures that are collected when none is news
    spacing: float = 0.05


class LoopFinder:
    """Looks for loop closures of the newest node; remembers those that wait for a second."""

    def __init__(self, options: LoopOptions, matching: MatchOptions) -> None:
        self.options, self.matching = options, matching
        self._way = np.zeros(1)
        self._waiting: list[tuple[int, Array, Edge]] = []

    def look(self, poses: Array, points: Sequence[Array]) -> list[Edge]:
        """Closures (edges that are doubtful) of the last of the poses (n, 3), with the points (m, 2) of all nodes."""
        new = len(poses) - 1
        if new:
            step = between(poses[-2], poses[-1])
            self._way = np.append(self._way, self._way[-1] + np.hypot(step[0], step[1]))
        if new % self.options.every or len(points[new]) < 10:
            return []
        found: list[Edge] = []
        for place in self._places(poses)[: self.options.tries]:
            matched = self._match(poses, points, place)
            if matched is not None:
                found += self._agreed(poses, place, matched)
        return found

    def _places(self, poses: Array) -> list[int]:
        """The nearest old node of each stretch of nodes that passes near, nearest first."""
        options, new = self.options, len(poses) - 1
        way = self._way[-1] - self._way
        distance = np.hypot(*(poses[:, :2] - poses[new, :2]).T)
        radius = np.minimum(options.near + options.drift * way, options.farthest)
        candidates = np.flatnonzero((way > options.least_way) & (distance < radius))
        if not len(candidates):
            return []
        stretches = np.split(candidates, np.flatnonzero(np.diff(candidates) > options.around) + 1)
        nearest = [int(stretch[np.argmin(distance[stretch])]) for stretch in stretches]
        return sorted(nearest, key=lambda node: distance[node])

    def _match(self, poses: Array, points: Sequence[Array], place: int) -> Match | None:
        options, new = self.options, len(poses) - 1
        newest = int(np.searchsorted(self._way, self._way[-1] - options.least_way))
        around = range(max(place - options.around, 0), min(place + options.around + 1, newest))
        if not around:
            return None
        old = np.vstack([transform_points(poses[k], points[k]) for k in around])
        if len(old) < 10:
            return None
        way = self._way[-1] - self._way[place]
        reach = min(options.near + options.drift * way, options.farthest)
        reference = Reference(thinned(old, options.spacing), self.matching)
        found = match(reference, points[new], poses[new], reach, options.turn)
        good = found.response >= options.least_response and found.inliers >= options.least_inliers
        return found if good else None

    def _agreed(self, poses: Array, place: int, matched: Match) -> list[Edge]:
        """The closure, with one that waited for it, if it is small or has company."""
        options, new = self.options, len(poses) - 1
        edge = Edge(
            first=place,
            second=new,
            relative=between(poses[place], matched.pose),
            information=matched.information,
            doubtful=True,
        )
        correction = compose(matched.pose, between(poses[new], np.zeros(3)))  # moves the estimate in the map
        off = between(poses[new], matched.pose)
        if np.hypot(off[0], off[1]) <= options.small and abs(off[2]) <= 0.5 * options.small:
            return [edge]
        self._waiting = [item for item in self._waiting if new - item[0] <= options.wait]
        for k, (node, other, waiting) in enumerate(self._waiting):
            apart = compose(correction, poses[node]) - compose(other, poses[node])
            if node != new and np.hypot(apart[0], apart[1]) < options.agree:
                del self._waiting[k]
                return [waiting, edge]
        self._waiting.append((new, correction, edge))
        return []
