"""Collision-free joint paths: a straight line when it is free, otherwise OMPL's RRTConnect and shortcuts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from grape.errors import ActionFailed, InvalidInput, Reason
from grape.messages import Array, frozen_array
from grape.planning.checker import StateChecker


@dataclass(frozen=True, kw_only=True)
class PlannerOptions:
    """How hard to search.

    Args:
        max_checks: budget of state checks of one search; a count and not a time, so that a loaded machine plans alike.
        range_rad: longest extension of the tree.
        attempts: searches whose shortest result is kept.
        simplify_steps: shortcut attempts per search.
        cable_budget_rad: how far a continuous joint may be from the cable reference.
        escape_rad: how far each joint may move to leave a start that is nearer than the padding.
    """

    max_checks: int = 300_000
    range_rad: float = 0.6
    attempts: int = 2
    simplify_steps: int = 60
    cable_budget_rad: float = 2 * np.pi
    escape_rad: float = 0.2

    def __post_init__(self) -> None:
        if self.max_checks < 1 or self.attempts < 1:
            raise InvalidInput(f"max_checks and attempts must be >= 1, got {self.max_checks} and {self.attempts}")


@dataclass(frozen=True, kw_only=True)
class JointPath:
    """A polyline in joint space whose every edge was checked.

    Attributes:
        waypoints: (k, n) rad, k >= 2, absolute angles, never wrapped.
        goal_index: which of the given goals it ends at.
        straight: True when no search was needed.
        checks: states that were checked.
    """

    waypoints: Array
    goal_index: int
    straight: bool
    checks: int

    @property
    def length(self) -> float:
        """Length in joint space, rad."""
        return float(np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1).sum())


class JointPlanner:
    """Plans for one arm.

    Args:
        lower, upper: (n,) rad; infinite where a joint is continuous.
        velocity: (n,) rad/s, weighs the joints when goals and paths are compared.
        options: how hard to search.
    """

    def __init__(self, lower: Array, upper: Array, velocity: Array, options: PlannerOptions | None = None) -> None:
        self.lower, self.upper = np.asarray(lower, float), np.asarray(upper, float)
        self.velocity = np.asarray(velocity, float)
        self.options = options or PlannerOptions()
        if not (self.lower < self.upper).all() or not (self.velocity > 0).all():
            raise InvalidInput(f"limits must satisfy lower < upper and velocity > 0, got {lower}, {upper}, {velocity}")

    def plan(
        self,
        start: Array,
        goals: Sequence[Array],
        checker: StateChecker,
        rng: np.random.Generator,
        *,
        cable_reference: Array | None = None,
        absolute: bool = False,
    ) -> JointPath:
        """The quickest path found from `start` to any of `goals`.

        Args:
            start: (n,) rad, absolute.
            goals: joint angles (n,) that are equally good, such as the solutions of the inverse kinematics. Continuous
                joints are taken at the whole turn nearest to the start that the cables allow.
            checker: what must not be touched.
            rng: drawn from once for each search; the same state of it gives the same path.
            cable_reference: (n,) angles at which the cables hang free; 0 when None.
            absolute: goals are meant as they are, without whole turns added.

        Raises:
            ActionFailed: CABLE_BUDGET, IN_COLLISION (which link, how deep) or NO_PLAN.
        """
        start = self._joints(start, "start")
        before = checker.checked
        lower, upper = self.bounds(cable_reference)
        lower, upper = np.minimum(lower, start), np.maximum(upper, start)  # from beyond its cables it may come back
        goals = [self._joints(goal, "goal") for goal in goals]
        reachable = self._reachable(start, goals, lower, upper, absolute)
        free = self._free_goals(reachable, checker)
        free.sort(key=lambda item: self.duration(start, item[1]))

        for index, goal in free:
            if checker.edge_valid(start, goal):
                return self._path([start, goal], index, True, checker.checked - before)
        head = [start] if checker.is_valid(start) else [start, self._escape(start, checker, rng, lower, upper)]
        waypoints, index = self._search(head[-1], free, checker, rng, lower, upper)
        return self._path([*head[:-1], *waypoints], index, False, checker.checked - before)

    def bounds(self, cable_reference: Array | None = None) -> tuple[Array, Array]:
        """Lower and upper angles (n,) rad: the joint limits, and the cable budget where a joint is continuous."""
        reference = np.zeros_like(self.lower) if cable_reference is None else np.asarray(cable_reference, float)
        budget = self.options.cable_budget_rad
        lower = np.where(np.isfinite(self.lower), self.lower, reference - budget)
        upper = np.where(np.isfinite(self.upper), self.upper, reference + budget)
        return lower, upper

    def duration(self, q0: Array, q1: Array) -> float:
        """Least time (s) between two joint angles at full speed, with a small share of the other joints' motion."""
        times = np.abs(np.asarray(q1) - q0) / self.velocity
        return float(times.max() + 0.1 * times.sum())

    def nearest_turn(self, goal: Array, start: Array, lower: Array, upper: Array) -> Array | None:
        """`goal` with whole turns added to continuous joints: nearest to the start within the bounds, else None."""
        goal = goal.copy()
        for i in np.flatnonzero(~(np.isfinite(self.lower) & np.isfinite(self.upper))):
            turns = np.round((start[i] - goal[i]) / (2 * np.pi)) + np.arange(-3, 4)
            angles = goal[i] + 2 * np.pi * turns
            angles = angles[(angles >= lower[i]) & (angles <= upper[i])]
            if len(angles) == 0:
                return None
            goal[i] = angles[np.argmin(np.abs(angles - start[i]))]
        return goal if ((goal >= lower - 1e-9) & (goal <= upper + 1e-9)).all() else None

    def _reachable(
        self, start: Array, goals: list[Array], lower: Array, upper: Array, absolute: bool
    ) -> list[tuple[int, Array]]:
        if absolute:
            within = [(i, goal) for i, goal in enumerate(goals) if ((goal >= lower) & (goal <= upper)).all()]
        else:
            turned = [(i, self.nearest_turn(goal, start, lower, upper)) for i, goal in enumerate(goals)]
            within = [(i, goal) for i, goal in turned if goal is not None]
        if not within:
            raise ActionFailed(
                Reason.CABLE_BUDGET,
                f"none of {len(goals)} goals lies within {np.round(lower, 2)} … {np.round(upper, 2)}",
            )
        return within

    def _free_goals(self, goals: list[tuple[int, Array]], checker: StateChecker) -> list[tuple[int, Array]]:
        free = [(i, goal) for i, goal in goals if checker.is_valid(goal)]
        if not free:
            best = max((checker.nearest(goal) for _, goal in goals), key=lambda nearest: nearest.clearance_m)
            raise ActionFailed(Reason.IN_COLLISION, f"goal: {best}, the best of {len(goals)}")
        return free

    def _escape(
        self, start: Array, checker: StateChecker, rng: np.random.Generator, lower: Array, upper: Array
    ) -> Array:
        """A valid state near a start that is nearer than the padding, reached without touching anything."""
        for radius in self.options.escape_rad * np.array([0.15, 0.3, 0.6, 1.0]):
            for _ in range(60):
                q = np.clip(start + rng.uniform(-radius, radius, len(start)), lower, upper)
                if checker.is_valid(q) and checker.edge_valid_unpadded(start, q):
                    return q
        raise ActionFailed(Reason.IN_COLLISION, f"start: {checker.nearest(start)}")

    def _search(
        self,
        start: Array,
        goals: list[tuple[int, Array]],
        checker: StateChecker,
        rng: np.random.Generator,
        lower: Array,
        upper: Array,
    ) -> tuple[list[Array], int]:
        from grape.planning._ompl_search import search

        found = []
        for seed in rng.integers(1, 2**31 - 1, self.options.attempts):
            waypoints = search(start, [q for _, q in goals], lower, upper, checker, self.options, int(seed))
            if waypoints:
                cost = sum(self.duration(a, b) for a, b in pairwise(waypoints))
                found.append((cost, waypoints))
        if not found:
            raise ActionFailed(
                Reason.NO_PLAN,
                f"no path to any of {len(goals)} goals within {self.options.max_checks} checks, "
                f"{self.options.attempts} attempts",
            )
        waypoints = min(found, key=lambda item: item[0])[1]
        return waypoints, min(goals, key=lambda item: float(np.abs(item[1] - waypoints[-1]).max()))[0]

    def _path(self, waypoints: list[Array], index: int, straight: bool, checks: int) -> JointPath:
        return JointPath(waypoints=frozen_array(waypoints), goal_index=index, straight=straight, checks=checks)

    def _joints(self, q: Array, what: str) -> Array:
        q = np.array(q, dtype=float)
        if q.shape != self.lower.shape or not np.isfinite(q).all():
            raise InvalidInput(f"{what} must be {self.lower.shape} finite joint angles, got {q}")
        return q
