"""Compiled kernels of the collision check; imported only where they are used."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.planning._field_kernels import field_at

NOTHING, CLOUD, BOX, SELF = 0, 1, 2, 3
INTERPOLATION = 1.74  # voxels by which two interpolated distances can differ more than their points are apart

PROBES = (0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875)  # along an edge, looked at before it is walked


@njit(cache=True)
def _places(arm):
    """Counts of joints, spheres, capsules, pairs and boxes in the flat array that `StateChecker` packs, and where its
    parts begin: spheres, the first sphere of each joint, capsules, pairs, boxes, mask, and room for the centres of the
    spheres, the middles of the capsules and the gaps to the boxes; behind them the box about all boxes."""
    n, m, c, k, b = int(arm[0]), int(arm[1]), int(arm[2]), int(arm[3]), int(arm[4])
    spheres = 10 + 12 * n
    first = spheres + 4 * m
    capsules = first + n + 2
    pairs = capsules + 4 * c
    boxes = pairs + 2 * k
    mask = boxes + 6 * b
    centers = mask + c * b
    middles = centers + 3 * m
    return n, m, c, k, b, spheres, first, capsules, pairs, boxes, mask, centers, middles, middles + 3 * c


@njit(cache=True)
def _centers(q, arm, places):
    """Fills in the centres of the spheres and the middles of the capsules in the base frame."""
    n, m, c, _, _, spheres, first, capsules, _, _, _, centers, middles, _ = places
    x, y, z = arm[spheres : spheres + m], arm[spheres + m : spheres + 2 * m], arm[spheres + 2 * m : spheres + 3 * m]
    cx, cy, cz = arm[centers : centers + m], arm[centers + m : centers + 2 * m], arm[centers + 2 * m : centers + 3 * m]
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    px, py, pz = 0.0, 0.0, 0.0
    for joint in range(n + 1):
        if joint > 0:
            T = arm[12 * joint - 2 : 12 * joint + 10]
            px += r00 * T[3] + r01 * T[7] + r02 * T[11]
            py += r10 * T[3] + r11 * T[7] + r12 * T[11]
            pz += r20 * T[3] + r21 * T[7] + r22 * T[11]
            cosine, sine = np.cos(q[joint - 1]), np.sin(q[joint - 1])
            a00, a01, a02 = T[0] * cosine + T[1] * sine, T[1] * cosine - T[0] * sine, T[2]
            a10, a11, a12 = T[4] * cosine + T[5] * sine, T[5] * cosine - T[4] * sine, T[6]
            a20, a21, a22 = T[8] * cosine + T[9] * sine, T[9] * cosine - T[8] * sine, T[10]
            b00, b01, b02 = r00, r01, r02
            b10, b11, b12 = r10, r11, r12
            b20, b21, b22 = r20, r21, r22
            r00 = b00 * a00 + b01 * a10 + b02 * a20
            r01 = b00 * a01 + b01 * a11 + b02 * a21
            r02 = b00 * a02 + b01 * a12 + b02 * a22
            r10 = b10 * a00 + b11 * a10 + b12 * a20
            r11 = b10 * a01 + b11 * a11 + b12 * a21
            r12 = b10 * a02 + b11 * a12 + b12 * a22
            r20 = b20 * a00 + b21 * a10 + b22 * a20
            r21 = b20 * a01 + b21 * a11 + b22 * a21
            r22 = b20 * a02 + b21 * a12 + b22 * a22
        for s in range(int(arm[first + joint]), int(arm[first + joint + 1])):
            cx[s] = px + r00 * x[s] + r01 * y[s] + r02 * z[s]
            cy[s] = py + r10 * x[s] + r11 * y[s] + r12 * z[s]
            cz[s] = pz + r20 * x[s] + r21 * y[s] + r22 * z[s]
    for k in range(c):
        s0, s1 = int(arm[capsules + 4 * k]), int(arm[capsules + 4 * k + 1])
        arm[middles + k] = 0.5 * (cx[s0] + cx[s1])
        arm[middles + c + k] = 0.5 * (cy[s0] + cy[s1])
        arm[middles + 2 * c + k] = 0.5 * (cz[s0] + cz[s1])


@njit(cache=True)
def sphere_centers(q, arm):
    """Centres of the spheres (m, 3) in the base frame."""
    places = _places(arm)
    _centers(q, arm, places)
    return arm[places[11] : places[12]].copy().reshape((3, places[1])).T


@njit(cache=True, error_model="numpy")
def _least_clearance(arm, places, field, padding, self_padding, most, stop):
    """(clearance, kind, sphere, other) of the nearest thing; returns early once a clearance is below `stop`.

    The centres must have been filled in. Clearances of `most` and above are not told apart. A capsule whose middle is
    farther away than its half length plus the best clearance so far is passed over.
    """
    m, count, capsules, centers, middles = places[1], places[2], places[7], places[11], places[12]
    radii, grid = places[5] + 3 * m, arm[5:10]
    slack = padding + INTERPOLATION * grid[3]
    best, kind, first, second = most, NOTHING, -1, -1
    for c in range(count - 1, -1, -1):  # the hand first: it hits most often
        s, end, around = int(arm[capsules + 4 * c + 1]), int(arm[capsules + 4 * c]), arm[capsules + 4 * c + 2] + slack
        if grid[4] - around >= best:
            x, y, z = arm[middles + c], arm[middles + count + c], arm[middles + 2 * count + c]
            if field_at(x, y, z, field, grid) - around >= best:
                s = end - 1
        while s >= end:
            distance = field_at(arm[centers + s], arm[centers + m + s], arm[centers + 2 * m + s], field, grid)
            d = distance - arm[radii + s] - padding
            if d < best:
                best, first, second = d, s, -1
                kind = CLOUD if distance < grid[4] - 1e-6 else NOTHING
                if best < stop:
                    return best, kind, first, second
            s -= 1 + _spared(distance - arm[radii + s] - slack - best, arm[capsules + 4 * c + 3])
        d, s, b = _box_clearance(c, arm, places, padding, best, stop)
        if s >= 0:
            best, kind, first, second = d, BOX, s, b
            if best < stop:
                return best, kind, first, second
    d, s, other = _self_clearance(arm, places, self_padding, best, stop)
    if s >= 0:
        best, kind, first, second = d, SELF, s, other
    return best, kind, first, second


@njit(cache=True)
def _spared(excess, per_metre):
    """How many of the next spheres of a capsule cannot be nearer than the best, as one is farther by `excess` m."""
    return int(excess * per_metre) if excess > 0.0 else 0


@njit(cache=True, error_model="numpy")
def _box_clearance(c, arm, places, padding, best, stop):
    """(clearance, sphere, box) of capsule `c` where it is below `best`, else sphere -1."""
    _, m, count, _, total, spheres, _, capsules, _, boxes, mask, centers, middles, gaps = places
    hull, near = gaps + total, arm[capsules + 4 * c + 2] + padding + best
    x, y, z = arm[middles + c], arm[middles + count + c], arm[middles + 2 * count + c]
    if total == 0 or _box_distance(x, y, z, arm, hull, 1, 0) > near:
        return best, -1, -1
    _outside_all(x, y, z, arm, boxes, gaps, total)
    first, second = -1, -1
    for b in range(total):
        near = max(arm[capsules + 4 * c + 2] + padding + best, 0.0)
        if arm[gaps + b] > near * near or arm[mask + c * total + b] == 0.0:
            continue
        s = int(arm[capsules + 4 * c + 1])
        while s >= int(arm[capsules + 4 * c]):
            x, y, z = arm[centers + s], arm[centers + m + s], arm[centers + 2 * m + s]
            d = _box_distance(x, y, z, arm, boxes, total, b) - arm[spheres + 3 * m + s] - padding
            if d < best:
                best, first, second = d, s, b
                if best < stop:
                    return best, first, second
            s -= 1 + _spared(d - best - 1e-9, arm[capsules + 4 * c + 3])
    return best, first, second


@njit(cache=True, error_model="numpy")
def _self_clearance(arm, places, self_padding, best, stop):
    """(clearance, sphere, sphere) of the pairs of capsules where it is below `best`, else sphere -1."""
    _, m, count, total, _, spheres, _, capsules, pairs, _, _, centers, middles, _ = places
    radii = spheres + 3 * m
    first, second = -1, -1
    for k in range(total):
        a, b = int(arm[pairs + 2 * k]), int(arm[pairs + 2 * k + 1])
        bx, by, bz = arm[middles + b], arm[middles + count + b], arm[middles + 2 * count + b]
        dx, dy = arm[middles + a] - bx, arm[middles + count + a] - by
        dz = arm[middles + 2 * count + a] - bz
        half = arm[capsules + 4 * b + 2] + self_padding
        near = max(arm[capsules + 4 * a + 2] + half + best, 0.0)
        if dx * dx + dy * dy + dz * dz > near * near:
            continue
        for i in range(int(arm[capsules + 4 * a]), int(arm[capsules + 4 * a + 1]) + 1):
            x, y, z = arm[centers + i], arm[centers + m + i], arm[centers + 2 * m + i]
            near = max(arm[radii + i] + half + best, 0.0)
            dx, dy, dz = x - bx, y - by, z - bz
            if dx * dx + dy * dy + dz * dz > near * near:
                continue
            for j in range(int(arm[capsules + 4 * b]), int(arm[capsules + 4 * b + 1]) + 1):
                dx, dy, dz = x - arm[centers + j], y - arm[centers + m + j], z - arm[centers + 2 * m + j]
                gap = arm[radii + i] + arm[radii + j] + self_padding
                near = max(gap + best, 0.0)
                if dx * dx + dy * dy + dz * dz >= near * near:
                    continue
                best, first, second = np.sqrt(dx * dx + dy * dy + dz * dz) - gap, i, j
                if best < stop:
                    return best, first, second
    return best, first, second


@njit(cache=True, error_model="numpy")
def _outside_all(x, y, z, arm, boxes, gaps, total):
    """Fills in the squared distances of a point from all boxes, 0 inside; one loop that the compiler runs in lanes."""
    table, out = arm[boxes : boxes + 6 * total], arm[gaps : gaps + total]
    for b in range(total):
        dx = max(abs(x - table[b]) - table[3 * total + b], 0.0)
        dy = max(abs(y - table[total + b]) - table[4 * total + b], 0.0)
        dz = max(abs(z - table[2 * total + b]) - table[5 * total + b], 0.0)
        out[b] = dx * dx + dy * dy + dz * dz


@njit(cache=True, error_model="numpy")
def _box_distance(x, y, z, arm, boxes, total, b):
    """Distance of a point from a box (centre, half size), negative inside."""
    at = boxes + b
    dx = abs(x - arm[at]) - arm[at + 3 * total]
    dy = abs(y - arm[at + total]) - arm[at + 4 * total]
    dz = abs(z - arm[at + 2 * total]) - arm[at + 5 * total]
    inside = max(dx, dy, dz)
    if inside <= 0.0:
        return inside
    dx, dy, dz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True, error_model="numpy")
def _clearance_of(arm, places, field, padding, self_padding, kind, sphere, other):
    """The clearance of one thing that `_least_clearance` named."""
    m, total, radii, boxes, centers = places[1], places[4], places[5] + 3 * places[1], places[9], places[11]
    x, y, z = arm[centers + sphere], arm[centers + m + sphere], arm[centers + 2 * m + sphere]
    if kind == BOX:
        return _box_distance(x, y, z, arm, boxes, total, other) - arm[radii + sphere] - padding
    if kind == SELF:
        dx, dy, dz = x - arm[centers + other], y - arm[centers + m + other], z - arm[centers + 2 * m + other]
        return np.sqrt(dx * dx + dy * dy + dz * dz) - (arm[radii + sphere] + arm[radii + other] + self_padding)
    return field_at(x, y, z, field, arm[5:10]) - arm[radii + sphere] - padding


@njit(cache=True)
def least_clearance(q, arm, field, padding, self_padding):
    """(clearance m, kind, sphere, other) at one state."""
    places = _places(arm)
    _centers(q, arm, places)
    return _least_clearance(arm, places, field, padding, self_padding, arm[9], -np.inf)


@njit(cache=True)
def state_valid(q, arm, field, padding, self_padding):
    """Whether nothing is nearer than the paddings."""
    places = _places(arm)
    _centers(q, arm, places)
    return _least_clearance(arm, places, field, padding, self_padding, 0.0, 0.0)[0] >= 0.0


@njit(cache=True)
def edge_valid(q0, q1, reach, arm, field, padding, self_padding, least_step):
    """(valid, states checked): walk the straight edge by conservative advancement.

    No surface point moves farther than sum |dq_i| reach_i, so a clearance of d frees that much of the edge. Steps of
    `least_step` m keep the walk short where the clearance goes to zero. What was nearest at one state bounds what is
    nearest at the next, so that most of the arm is passed over.
    """
    places = _places(arm)
    n = len(q0)
    travel = 0.0
    for i in range(n):
        travel += abs(q1[i] - q0[i]) * reach[i]
    if not state_valid(q1, arm, field, padding, self_padding):
        return False, 1
    q = np.empty(n)
    for probe in PROBES:  # what is deeper than a step cannot be stepped over, so the walk would end as well
        for i in range(n):
            q[i] = q0[i] + probe * (q1[i] - q0[i])
        if not state_valid(q, arm, field, padding - least_step, self_padding - least_step):
            return False, 1
    t, checked, kind, sphere, other = 0.0, 1, NOTHING, -1, -1
    while t < 1.0:
        for i in range(n):
            q[i] = q0[i] + t * (q1[i] - q0[i])
        _centers(q, arm, places)
        checked += 1
        d = arm[9]
        if sphere >= 0:
            d = min(d, _clearance_of(arm, places, field, padding, self_padding, kind, sphere, other))
        if d >= 0.0:
            d, now, first, second = _least_clearance(arm, places, field, padding, self_padding, d, 0.0)
            if first >= 0:
                kind, sphere, other = now, first, second
        if d < 0.0:
            return False, checked
        if travel < 1e-9:
            return True, checked
        t += max(d, least_step) / travel
    return True, checked
