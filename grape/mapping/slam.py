"""Laser SLAM: scans are matched against the scans before, places seen again close loops, a pose graph joins all.

Source: Konolige et al., Efficient sparse pose adjustment for 2D mapping, IROS 2010 (the structure).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from grape.errors import InvalidInput
from grape.mapping.loops import LoopFinder, LoopOptions
from grape.mapping.planar import between, compose, transform_points
from grape.mapping.pose_graph import Edge, GraphOptions, Solution, optimise
from grape.mapping.scan_matcher import MatchOptions, Reference, match
from grape.mapping.scans import scan_ends, thinned
from grape.messages import Array, LaserScan


@dataclass(frozen=True, kw_only=True)
class SlamOptions:
    """Options of `run_slam`; lengths in m, angles in rad.

    A scan is kept as a node after `min_distance` or `min_turn`, and is matched against the `recent` nodes before.
    Odometry's standard deviations are `fixed` + `per_metre` · way + `per_radian` · turn.
    """

    min_distance: float = 0.3
    min_turn: float = 0.3
    max_range: float = 25.0
    spacing: float = 0.05
    recent: int = 20
    search: float = 0.4
    search_turn: float = 0.25
    least_inliers: float = 0.3
    fixed: Array = field(default_factory=lambda: np.array([0.02, 0.02, 0.01]))
    per_metre: Array = field(default_factory=lambda: np.array([0.08, 0.08, 0.03]))
    per_radian: Array = field(default_factory=lambda: np.array([0.05, 0.05, 0.08]))
    match: MatchOptions = field(default_factory=MatchOptions)
    loops: LoopOptions = field(default_factory=LoopOptions)
    graph: GraphOptions = field(default_factory=GraphOptions)


@dataclass(frozen=True, kw_only=True)
class SlamResult:
    """Poses (n, 3) x y yaw of all scans, in the frame of the first odometry pose.

    Args:
        nodes: (k,) indices of the scans that are nodes of the graph.
        edges: between nodes; loop closures are `doubtful`.
        weights: (m,) of the edges in the solution: near 0 for a loop closure that was taken for wrong.
        lost: (l,) nodes whose scan fitted nothing; odometry alone holds them.
    """

    poses: Array
    nodes: Array
    edges: tuple[Edge, ...]
    weights: Array
    lost: Array

    @property
    def loops(self) -> int:
        """Loop closures that count."""
        return sum(edge.doubtful and weight > 0.25 for edge, weight in zip(self.edges, self.weights, strict=True))


def run_slam(
    scans: Sequence[LaserScan],
    odometry: Array,
    mount: Array | None = None,
    options: SlamOptions | None = None,
    on_progress: Callable[[float, str], None] = lambda fraction, sentence: None,
) -> SlamResult:
    """Find the poses of a robot at all its scans.

    Args:
        scans: in order of time.
        odometry: (n, 3) x y yaw of the robot at the scans, drifting.
        mount: (3,) x y yaw of the laser on the robot.
        on_progress: called now and then with a fraction and a sentence.

    Raises:
        InvalidInput: no scans, or odometry that is not finite or not of their number.
    """
    odometry = np.asarray(odometry, float)
    if not len(scans) or odometry.shape != (len(scans), 3) or not np.isfinite(odometry).all():
        raise InvalidInput(f"finite odometry ({len(scans)}, 3) and at least one scan needed, got {odometry.shape}")
    slam = _Slam(options or SlamOptions())
    chosen = _nodes(odometry, slam.options)
    for k, scan_index in enumerate(chosen):
        points = scan_ends(scans[scan_index], slam.options.max_range, mount)
        slam.add(odometry[scan_index], thinned(points, slam.options.spacing))
        on_progress(k / len(chosen), f"node {k + 1} of {len(chosen)}, {slam.loop_count} loop closures")
    solution = slam.solve()
    at = np.clip(np.searchsorted(chosen, np.arange(len(scans)), side="right") - 1, 0, None)
    poses = compose(solution.poses[at], between(odometry[chosen[at]], odometry))
    return SlamResult(
        poses=poses,
        nodes=chosen,
        edges=tuple(slam.edges),
        weights=solution.weight,
        lost=np.array(slam.lost, int),
    )


def _nodes(odometry: Array, options: SlamOptions) -> Array:
    chosen = [0]
    for k in range(1, len(odometry)):
        step = between(odometry[chosen[-1]], odometry[k])
        if np.hypot(step[0], step[1]) >= options.min_distance or abs(step[2]) >= options.min_turn:
            chosen.append(k)
    return np.array(chosen)


class _Slam:
    """The graph while it grows."""

    def __init__(self, options: SlamOptions) -> None:
        self.options = options
        self.poses = np.zeros((0, 3))
        self.points: list[Array] = []
        self.edges: list[Edge] = []
        self.lost: list[int] = []
        self.finder = LoopFinder(options.loops, options.match)
        self.loop_count = 0
        self._odometry: Array | None = None
        self._waiting = 0

    def add(self, odometry: Array, points: Array) -> None:
        """Add a node: 1 predict by odometry, 2 match against recent nodes, 3 look for loops, 4 optimise."""
        if self._odometry is None:
            self.poses = odometry[None].copy()
        else:
            step = between(self._odometry, odometry)
            prior = self._odometry_information(step)
            guess = compose(self.poses[-1], step)
            pose, information = self._matched(points, guess, prior)
            last = len(self.poses) - 1
            relative = between(self.poses[-1], pose)
            self.edges.append(Edge(first=last, second=last + 1, relative=relative, information=information))
            self.poses = np.vstack([self.poses, pose])
        self._odometry = odometry
        self.points.append(points)
        self._close_loops()

    def solve(self) -> Solution:
        """Optimise the whole graph."""
        solution = optimise(self.poses, self.edges, self.options.graph)
        self.poses, self._waiting = solution.poses, 0
        return solution

    def _odometry_information(self, step: Array) -> Array:
        options = self.options
        std = options.fixed + options.per_metre * np.hypot(step[0], step[1]) + options.per_radian * abs(step[2])
        return np.diag(1.0 / std**2)

    def _matched(self, points: Array, guess: Array, prior: Array) -> tuple[Array, Array]:
        options, node = self.options, len(self.poses)
        begin = max(node - options.recent, 0)
        near = [transform_points(self.poses[k], self.points[k]) for k in range(begin, node)]
        reference_points = thinned(np.vstack(near), options.spacing)
        if len(points) < 10 or len(reference_points) < 10:
            self.lost.append(node)
            return guess, prior
        reference = Reference(reference_points, options.match)
        found = match(reference, points, guess, options.search, options.search_turn, prior)
        if found.inliers < options.least_inliers:
            self.lost.append(node)
            return guess, prior
        return found.pose, found.information

    def _close_loops(self) -> None:
        found = self.finder.look(self.poses, self.points)
        self.edges.extend(found)
        self.loop_count += len(found)
        self._waiting += len(found)
        news = any(self._moves(edge) for edge in found)
        if news or self._waiting >= self.options.loops.optimise_after:
            self.solve()

    def _moves(self, edge: Edge) -> bool:
        off = between(edge.relative, between(self.poses[edge.first], self.poses[edge.second]))
        return bool(np.hypot(off[0], off[1]) > 0.1 or abs(off[2]) > 0.02)
