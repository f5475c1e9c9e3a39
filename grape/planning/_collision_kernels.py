"""Compiled kernels of the collision check; imported only where they are used."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.planning._body_kernels import (
    AROUND,
    COUNTS,
    FIRST,
    GRID,
    HALF,
    HULL,
    LAST,
    PADDINGS,
    PER_METRE,
    RADIUS,
    box_clearance,
    meets,
    middle,
    near_pair,
    pair_clearance,
    place,
    places,
    spared,
    sphere,
)
from grape.planning._compiled import inlined, uncounted
from grape.planning._field_kernels import field_at, nearest_at

NOTHING, CLOUD, BOX, SELF = 0, 1, 2, 3
INTERPOLATION = 1.74  # voxels by which two distances, interpolated or of a voxel, can differ more than their points
CLOSE = 0.06  # m, what is farther away need not be known exactly

PROBES = (0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875)  # along an edge, looked at before it is walked


@njit(cache=True)
def sphere_centers(q, arm):
    """Centres of the spheres (m, 3) in the base frame."""
    at = places(arm)
    place(q, arm, at)
    centers = np.empty((int(arm[COUNTS, 4]), 3))
    for c in range(at.capsules):
        for s in range(int(arm[at.capsule + c, FIRST]), int(arm[at.capsule + c, LAST]) + 1):
            centers[s] = sphere(arm, at, c, s)
    return centers


@uncounted
def _least_clearance(arm, at, field, padding, self_padding, most, stop):
    """(clearance, kind, sphere, other) of the nearest thing; returns early once a clearance is below `stop`.

    The capsules must have been placed. Clearances of `most` and above are not told apart. A capsule whose middle is
    farther away than its half length plus the best clearance so far is passed over.
    """
    best, kind, first, second = most, NOTHING, -1, -1
    for k in range(at.pairs):
        d, s, other = pair_clearance(k, arm, at, self_padding, best, stop, np.inf)
        if s >= 0:
            best, kind, first, second = d, SELF, s, other
            if best < stop:
                return best, kind, first, second
    for c in range(at.capsules - 1, -1, -1):  # the hand first: it hits most often
        d, s, other = box_clearance(c, arm, at, padding, best, stop, np.inf)
        if s >= 0:
            best, kind, first, second = d, BOX, s, other
        if best >= stop:
            d, s = _cloud_clearance(c, arm, at, field, padding, best, stop, np.inf)
            if s >= 0:
                seen = d + arm[at.capsule + c, RADIUS] + padding < arm[GRID, 4] - 1e-6
                best, kind, first, second = d, CLOUD if seen else NOTHING, s, -1
        if best < stop:
            break
    return best, kind, first, second


@inlined
def _cloud_clearance(c, arm, at, field, padding, best, stop, close):
    """(clearance, sphere) of capsule `c` where it is below `best`, else sphere -1.

    The distance of the nearest voxel is a bound that spares most spheres the interpolation; above `close` it is good
    enough.
    """
    own, slack, first, grid = at.capsule + c, padding + INTERPOLATION * arm[GRID, 3], -1, _grid(arm)
    if not meets(c, arm, at, AROUND, 0.0):  # beyond the field all distances are its reach
        bound = arm[GRID, 4] - arm[own, RADIUS] - slack
        d = bound if bound > close else arm[GRID, 4] - arm[own, RADIUS] - padding
        return (d, int(arm[own, LAST])) if d < best else (best, first)
    around = arm[own, HALF] + slack
    if arm[GRID, 4] - around >= best:
        x, y, z = middle(arm, at, c)
        if nearest_at(x, y, z, field, grid) - around >= best:
            return best, first
    s, begin, row = int(arm[own, LAST]), int(arm[own, FIRST]), at.bound + c
    for i in range(s - begin + 1):  # all at once, so that memory is waited for once
        x, y, z = sphere(arm, at, c, begin + i)
        arm[row, i] = nearest_at(x, y, z, field, grid) - arm[own, RADIUS] - slack
    while s >= begin:
        bound = arm[row, s - begin]
        if bound < best:
            x, y, z = sphere(arm, at, c, s)
            d = bound if bound > close else field_at(x, y, z, field, grid) - arm[own, RADIUS] - padding
            if d < best:
                best, first = d, s
                if best < stop:
                    break
        s -= 1 + spared(bound - best, arm[own, PER_METRE])
    return best, first


@inlined
def _grid(arm):
    """Origin, voxel and reach of the distance field."""
    return arm[GRID, 0], arm[GRID, 1], arm[GRID, 2], arm[GRID, 3], arm[GRID, 4]


@njit(cache=True)
def least_clearance(q, arm, field):
    """(clearance m, kind, sphere, other) at one state."""
    at = places(arm)
    place(q, arm, at)
    return _least_clearance(arm, at, field, arm[PADDINGS, 0], arm[PADDINGS, 1], arm[GRID, 4], -np.inf)


@njit(cache=True)
def state_valid(q, arm, field):
    """1 where nothing is nearer than the paddings, 0 where something is, -1 where an angle is no number."""
    total = 0.0
    for angle in q:
        total += angle
    if not np.isfinite(total):
        return -1
    return 1 if _state_valid(q, arm, places(arm), field, arm[PADDINGS, 0], arm[PADDINGS, 1]) else 0


@uncounted
def _state_valid(q, arm, at, field, padding, self_padding):
    """Whether nothing is nearer than these paddings; what balls about the capsules rule out is not looked at closer."""
    place(q, arm, at)
    for k in range(at.pairs):
        if near_pair(k, arm, at, self_padding) and pair_clearance(k, arm, at, self_padding, 0.0, 0.0, np.inf)[0] < 0.0:
            return False
    for c in range(at.capsules - 1, -1, -1):  # the hand first: it hits most often
        if meets(c, arm, at, HULL, padding) and box_clearance(c, arm, at, padding, 0.0, 0.0, np.inf)[0] < 0.0:
            return False
        if _cloud_clearance(c, arm, at, field, padding, 0.0, 0.0, np.inf)[0] < 0.0:
            return False
    return True


@njit(cache=True)
def edge_valid(q0, q1, reach, arm, field, padding, self_padding, least_step):
    """(valid, states checked): walk the straight edge by conservative advancement.

    Every capsule, and every pair of them, has its own pace: no point of its surface moves farther along the edge than
    its travel, so a clearance of d frees that much, and until then it need not be looked at again. Steps of
    `least_step` m keep the walk short where the clearance goes to zero.
    """
    at, n = places(arm), len(q0)
    if not _state_valid(q1, arm, at, field, padding, self_padding):
        return False, 1
    q, checked = np.empty(n), 1
    for probe in PROBES:  # what is deeper than a step cannot be stepped over, so the walk would end as well
        _between(q0, q1, probe, q)
        checked += 1
        if not _state_valid(q, arm, at, field, padding - least_step, self_padding - least_step):
            return False, checked
    travel = _travels(q0, q1, reach, arm, at)
    free = np.zeros(len(travel))  # until where on the edge each thing is
    t = 0.0
    while t < 1.0:
        _between(q0, q1, t, q)
        place(q, arm, at)
        checked += 1
        t = _freed(t, free, travel, arm, at, field, padding, self_padding, least_step)
        if t < 0.0:
            return False, checked
    return True, checked


@uncounted
def _freed(t, free, travel, arm, at, field, padding, self_padding, least_step):
    """Up to where the edge is free as seen from the state at `t`, or -1; `free` says it for each thing."""
    until, ahead = t + 1e-9, 1.0
    for _ in range(2):  # first what has used up its freedom, then what would before the next state
        for thing in range(len(free)):
            if free[thing] < until:
                d = _thing_clearance(thing, arm, at, field, padding, self_padding)
                if d < 0.0:
                    return -1.0
                free[thing] = t + max(d, least_step) / travel[thing]
                ahead = min(ahead, free[thing])
        until = ahead
    return ahead


@uncounted
def _between(q0, q1, t, q):
    """Fills in the state at `t` of the way."""
    for i in range(len(q)):
        q[i] = q0[i] + t * (q1[i] - q0[i])


@njit(cache=True)
def _travels(q0, q1, reach, arm, at):
    """Farthest that a point of each capsule moves along an edge, and then of each pair the second seen from the first,
    m; never zero."""
    travel = np.full(at.capsules + at.pairs, 1e-12)
    for c in range(at.capsules):
        for i in range(len(q0)):
            travel[c] += abs(q1[i] - q0[i]) * reach[c, i]
    for k in range(at.pairs):
        a, b = int(arm[at.pair + k, 0]), int(arm[at.pair + k, 1])
        for i in range(len(q0)):
            if (reach[a, i] > 0.0) != (reach[b, i] > 0.0):
                travel[at.capsules + k] += abs(q1[i] - q0[i]) * (reach[a, i] + reach[b, i])
    return travel


@inlined
def _thing_clearance(thing, arm, at, field, padding, self_padding):
    """Clearance of a capsule from boxes and cloud or, behind the last capsule, of a pair; above CLOSE a bound of it."""
    most = arm[GRID, 4]
    if thing >= at.capsules:
        return pair_clearance(thing - at.capsules, arm, at, self_padding, most, 0.0, CLOSE)[0]
    d = box_clearance(thing, arm, at, padding, most, 0.0, CLOSE)[0]
    return _cloud_clearance(thing, arm, at, field, padding, d, 0.0, CLOSE)[0] if d >= 0.0 else d
