"""One search with OMPL; the only module that knows it.

OMPL draws from one process-wide seed sequence. `RNG.setSeed` restarts it (with an error in the log that concerns only
samplers that exist already); every object that draws is made after it, so a seed gives the same path whatever ran
before. Searches must not run in two threads of one process.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from ompl import base, geometric, util

from grape.messages import Array
from grape.planning.checker import StateChecker

if TYPE_CHECKING:
    from grape.planning.planner import PlannerOptions


class _Validity(base.StateValidityChecker):
    def __init__(self, information: base.SpaceInformation, checker: StateChecker, joints: int) -> None:
        super().__init__(information)
        self._checker, self._joints = checker, range(joints)

    def isValid(self, state: base.RealVectorStateType) -> bool:
        return self._checker.is_valid(np.array([state[i] for i in self._joints]))


class _Motion(base.MotionValidator):
    def __init__(self, information: base.SpaceInformation, checker: StateChecker, joints: int) -> None:
        super().__init__(information)
        self._checker, self._joints = checker, range(joints)

    def checkMotion(self, first: base.RealVectorStateType, second: base.RealVectorStateType) -> bool:
        q0, q1 = (np.array([state[i] for i in self._joints]) for state in (first, second))
        return self._checker.edge_valid(q0, q1)


def search(
    start: Array,
    goals: list[Array],
    lower: Array,
    upper: Array,
    checker: StateChecker,
    options: PlannerOptions,
    seed: int,
) -> list[Array]:
    """Waypoints from `start` to one of `goals`, or an empty list when the budget of checks is spent."""
    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(seed)
    joints = len(start)
    space = base.RealVectorStateSpace(joints)
    bounds = base.RealVectorBounds(joints)
    for i in range(joints):
        bounds.setLow(i, float(lower[i]))
        bounds.setHigh(i, float(upper[i]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    information.setup()
    default_motion = information.getMotionValidator()
    information.setStateValidityChecker(_Validity(information, checker, joints))
    information.setMotionValidator(_Motion(information, checker, joints))
    try:
        return _solve(information, start, goals, checker, options)
    finally:  # break the cycle information -> Python checker -> information, which the bindings cannot collect
        information.setMotionValidator(default_motion)
        information.setStateValidityChecker(base.AllValidStateValidityChecker(information))


def _solve(
    information: base.SpaceInformation,
    start: Array,
    goals: list[Array],
    checker: StateChecker,
    options: PlannerOptions,
) -> list[Array]:
    problem = base.ProblemDefinition(information)
    problem.addStartState(_state(information, start))
    goal = base.GoalStates(information)
    for q in goals:
        goal.addState(_state(information, q))
    problem.setGoal(goal)
    planner = geometric.RRTConnect(information)
    planner.setRange(options.range_rad)
    planner.setProblemDefinition(problem)
    planner.setup()
    budget = checker.checked + options.max_checks
    planner.solve(base.PlannerTerminationCondition(lambda: checker.checked > budget))
    if not problem.hasExactSolution():
        return []
    path = problem.getSolutionPath()
    simplifier = geometric.PathSimplifier(information)
    steps = options.simplify_steps
    simplifier.reduceVertices(path, steps, steps, 1.0)
    simplifier.partialShortcutPath(path, steps, steps, 0.5, 0.005)
    simplifier.reduceVertices(path, steps, steps, 1.0)
    return [np.array([state[i] for i in range(len(start))]) for state in path.getStates()]


def _state(information: base.SpaceInformation, q: Array) -> base.RealVectorStateType:
    state = information.allocState()
    for i, angle in enumerate(q):
        state[i] = float(angle)
    return state
