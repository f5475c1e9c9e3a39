"""Compiled kernels of the arm's shape: where its capsules are, and how far from one another and from boxes.

All that is known of arm and boxes stands in one table, since a call that takes few arrays costs little; `packed` in
`checker.py` fills it. Each thing has its row, so that a column is a number the compiler knows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grape.planning._compiled import inlined, uncounted

COUNTS, PADDINGS, GRID, AROUND, HULL, CHAIN = 0, 1, 2, 3, 4, 5  # rows: counts, paddings, distance field, the boxes
# about it and about all boxes, and the base of the arm, which the joints follow
BEGIN = 12  # of a joint, behind its placement: its first capsule and that of the next joint
FIRST, LAST, HALF, PER_METRE, RADIUS, PER_STEP, START, STEP = 0, 1, 2, 3, 4, 5, 6, 9  # of a capsule, see `packed`
CENTER, ALONG, MIDDLE = 12, 15, 18  # of a placed capsule: its first centre, the step to the next one, its middle
SLACK = 1e-9  # m, far more than what rounding costs


class Places(NamedTuple):
    """How many joints, capsules, pairs and boxes the table holds, and where their rows begin.

    Joints, capsules and pairs have a row each. Boxes have a column each, so that loops over them run in lanes: in six
    rows of centre and half size.
    """

    joints: int
    capsules: int
    pairs: int
    boxes: int
    capsule: int
    pair: int
    box: int
    mask: int  # for each capsule, whether it is checked against each box
    bound: int  # for each capsule, room for what the distance field says of its spheres


@inlined
def places(arm):
    """Where everything is in the table."""
    n, c, k, b = int(arm[COUNTS, 0]), int(arm[COUNTS, 1]), int(arm[COUNTS, 2]), int(arm[COUNTS, 3])
    capsule, pair, box = CHAIN + n + 1, CHAIN + n + 1 + c, CHAIN + n + 1 + c + k
    return Places(n, c, k, b, capsule, pair, box, box + 6, box + 6 + c)


@uncounted
def place(q, arm, at):
    """Fills in the capsules in the base frame at joint angles `q`."""
    R, p = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for joint in range(at.joints + 1):
        row = CHAIN + joint
        if joint > 0:
            dx, dy, dz = _rotated(R, arm[row, 3], arm[row, 7], arm[row, 11])
            R, p = _turned(R, arm, row, np.cos(q[joint - 1]), np.sin(q[joint - 1])), (p[0] + dx, p[1] + dy, p[2] + dz)
        for own in range(at.capsule + int(arm[row, BEGIN]), at.capsule + int(arm[row, BEGIN + 1])):
            x, y, z = _rotated(R, arm[own, START], arm[own, START + 1], arm[own, START + 2])
            dx, dy, dz = _rotated(R, arm[own, STEP], arm[own, STEP + 1], arm[own, STEP + 2])
            half = 0.5 * (arm[own, LAST] - arm[own, FIRST])
            x, y, z = p[0] + x, p[1] + y, p[2] + z
            arm[own, CENTER], arm[own, CENTER + 1], arm[own, CENTER + 2] = x, y, z
            arm[own, ALONG], arm[own, ALONG + 1], arm[own, ALONG + 2] = dx, dy, dz
            arm[own, MIDDLE], arm[own, MIDDLE + 1], arm[own, MIDDLE + 2] = x + half * dx, y + half * dy, z + half * dz


@inlined
def _rotated(R, x, y, z):
    return R[0] * x + R[1] * y + R[2] * z, R[3] * x + R[4] * y + R[5] * z, R[6] * x + R[7] * y + R[8] * z


@inlined
def _turned(R, arm, t, cosine, sine):
    """The rotation behind a joint: R, the placement in row `t`, and the turn about its z axis."""
    a0, a3, a6 = _rotated(R, arm[t, 0], arm[t, 4], arm[t, 8])
    a1, a4, a7 = _rotated(R, arm[t, 1], arm[t, 5], arm[t, 9])
    a2, a5, a8 = _rotated(R, arm[t, 2], arm[t, 6], arm[t, 10])
    return (
        a0 * cosine + a1 * sine, a1 * cosine - a0 * sine, a2,
        a3 * cosine + a4 * sine, a4 * cosine - a3 * sine, a5,
        a6 * cosine + a7 * sine, a7 * cosine - a6 * sine, a8,
    )  # fmt: skip


@inlined
def sphere(arm, at, c, s):
    """Centre of sphere `s` of the placed capsule `c`, base frame."""
    own = at.capsule + c
    i = s - arm[own, FIRST]
    x, y, z = i * arm[own, ALONG], i * arm[own, ALONG + 1], i * arm[own, ALONG + 2]
    return arm[own, CENTER] + x, arm[own, CENTER + 1] + y, arm[own, CENTER + 2] + z


@inlined
def middle(arm, at, c):
    """Middle of the placed capsule `c`, base frame."""
    own = at.capsule + c
    return arm[own, MIDDLE], arm[own, MIDDLE + 1], arm[own, MIDDLE + 2]


@inlined
def spared(excess, per_metre):
    """How many of the next spheres of a capsule cannot be nearer than the best, as one is farther by `excess` m."""
    return int(excess * per_metre) if excess > 0.0 else 0


@inlined
def meets(c, arm, at, row, padding):
    """Whether the ball about capsule `c` is nearer than the padding to the box whose centre and half size are a row."""
    x, y, z = middle(arm, at, c)
    return _outside(x, y, z, arm, row) < _squared(arm[at.capsule + c, HALF] + padding + SLACK)


@inlined
def box_clearance(c, arm, at, padding, best, stop, close):
    """(clearance, sphere, box) of capsule `c` where it is below `best` and `close`, else a bound and sphere -1."""
    own, first, second = at.capsule + c, -1, -1
    if at.boxes == 0:
        return best, first, second
    x, y, z = middle(arm, at, c)
    bound = np.sqrt(_outside(x, y, z, arm, HULL)) - arm[own, HALF] - padding
    if bound >= min(best, close):
        return min(best, bound), first, second
    best = min(best, close)
    near, count = _squared(arm[own, HALF] + padding + best), 0  # in lanes, mostly 0
    for b in range(at.boxes):
        count += _outside_box(x, y, z, arm, at, b) <= near and arm[at.mask + c, b] != 0.0
    if count == 0:
        return best, first, second
    for b in range(at.boxes):
        near = _squared(arm[own, HALF] + padding + best)
        if _outside_box(x, y, z, arm, at, b) > near or arm[at.mask + c, b] == 0.0:
            continue
        s = int(arm[own, LAST])
        while s >= int(arm[own, FIRST]):
            sx, sy, sz = sphere(arm, at, c, s)
            d = box_distance(sx, sy, sz, arm, at, b) - arm[own, RADIUS] - padding
            if d < best:
                best, first, second = d, s, b
                if best < stop:
                    return best, first, second
            s -= 1 + spared(d - best - 1e-9, arm[own, PER_METRE])
    return best, first, second


@inlined
def _squared(distance):
    """The square of a distance that does not count below 0."""
    return max(distance, 0.0) ** 2


@inlined
def _outside(x, y, z, arm, row):
    """Squared distance of a point from the box whose centre and half size are a row, 0 inside."""
    return _beyond(x - arm[row, 0], y - arm[row, 1], z - arm[row, 2], arm[row, 3], arm[row, 4], arm[row, 5])


@inlined
def _outside_box(x, y, z, arm, at, b):
    """Squared distance of a point from box `b`, 0 inside."""
    own = at.box
    dx, dy, dz = x - arm[own, b], y - arm[own + 1, b], z - arm[own + 2, b]
    return _beyond(dx, dy, dz, arm[own + 3, b], arm[own + 4, b], arm[own + 5, b])


@inlined
def _beyond(dx, dy, dz, half_x, half_y, half_z):
    """Squared distance from a box of a point that is so far from its centre, 0 inside."""
    dx, dy, dz = max(abs(dx) - half_x, 0.0), max(abs(dy) - half_y, 0.0), max(abs(dz) - half_z, 0.0)
    return dx * dx + dy * dy + dz * dz


@inlined
def box_distance(x, y, z, arm, at, b):
    """Distance of a point from box `b`, negative inside."""
    dx = abs(x - arm[at.box, b]) - arm[at.box + 3, b]
    dy = abs(y - arm[at.box + 1, b]) - arm[at.box + 4, b]
    dz = abs(z - arm[at.box + 2, b]) - arm[at.box + 5, b]
    inside = max(dx, dy, dz)
    if inside <= 0.0:
        return inside
    return np.sqrt(max(dx, 0.0) ** 2 + max(dy, 0.0) ** 2 + max(dz, 0.0) ** 2)


@inlined
def near_pair(k, arm, at, padding):
    """Whether the ball about the second capsule of pair `k` is nearer than the padding to the first: to the ball about
    it, and then to itself."""
    row = at.pair + k
    a, b = int(arm[row, 0]), int(arm[row, 1])
    (ax, ay, az), (bx, by, bz) = middle(arm, at, a), middle(arm, at, b)
    if (ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2 >= _squared(arm[row, 2] + padding + SLACK):
        return False
    own = at.capsule + a
    x, y, z = bx - arm[own, CENTER], by - arm[own, CENTER + 1], bz - arm[own, CENTER + 2]
    along = x * arm[own, ALONG] + y * arm[own, ALONG + 1] + z * arm[own, ALONG + 2]
    steps = min(max(along * arm[own, PER_STEP], 0.0), arm[own, LAST] - arm[own, FIRST])
    x, y, z = x - steps * arm[own, ALONG], y - steps * arm[own, ALONG + 1], z - steps * arm[own, ALONG + 2]
    return x * x + y * y + z * z < _squared(arm[own, RADIUS] + arm[at.capsule + b, HALF] + padding + SLACK)


@inlined
def pair_clearance(k, arm, at, padding, best, stop, close):
    """(clearance, sphere, sphere) of pair `k` of capsules where it is below `best` and `close`, else a bound and -1.

    Bounds are the distance of the middles, and then that of the axes.
    """
    a, b = int(arm[at.pair + k, 0]), int(arm[at.pair + k, 1])
    own, other, least = at.capsule + a, at.capsule + b, min(best, close)
    (ax, ay, az), (bx, by, bz) = middle(arm, at, a), middle(arm, at, b)
    bound = np.sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2) - arm[own, HALF] - arm[other, HALF] - padding
    if bound >= least:
        return min(best, bound), -1, -1
    gap, first, second = arm[own, RADIUS] + arm[other, RADIUS] + padding, -1, -1
    bound = _axis_distance(a, b, arm, at) - gap - 1e-8  # what nearly parallel axes cost in precision
    if bound >= least:
        return min(best, bound), -1, -1
    best, s = least, int(arm[own, LAST])
    while s >= int(arm[own, FIRST]):
        x, y, z = sphere(arm, at, a, s)
        nearest = _nearest_sphere(x, y, z, arm, at, b)
        bx, by, bz = sphere(arm, at, b, nearest)
        d = np.sqrt((x - bx) ** 2 + (y - by) ** 2 + (z - bz) ** 2) - gap
        if d < best:
            best, first, second = d, s, nearest
            if best < stop:
                break
        s -= 1 + spared(d - best - 1e-9, arm[own, PER_METRE])
    return best, first, second


@inlined
def _axis_distance(a, b, arm, at):
    """Distance between the axes of two placed capsules, from the first to the last centre.

    Source: Ericson, Real-time collision detection, 2005, 5.1.9.
    """
    own, other = at.capsule + a, at.capsule + b
    n, m = arm[own, LAST] - arm[own, FIRST], arm[other, LAST] - arm[other, FIRST]
    ux, uy, uz = n * arm[own, ALONG], n * arm[own, ALONG + 1], n * arm[own, ALONG + 2]
    vx, vy, vz = m * arm[other, ALONG], m * arm[other, ALONG + 1], m * arm[other, ALONG + 2]
    wx, wy = arm[own, CENTER] - arm[other, CENTER], arm[own, CENTER + 1] - arm[other, CENTER + 1]
    wz = arm[own, CENTER + 2] - arm[other, CENTER + 2]
    uu, vv, uv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    uw, vw = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    across = uu * vv - uv * uv
    s = _share(uv * vw - uw * vv, across)
    t = _share(uv * s + vw, vv)
    s = _share(uv * t - uw, uu)
    dx, dy, dz = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@inlined
def _share(part, whole):
    """part / whole within 0..1; 0 where the whole vanishes."""
    return min(max(part / whole, 0.0), 1.0) if whole > 1e-18 else 0.0


@inlined
def _nearest_sphere(x, y, z, arm, at, c):
    """The sphere of capsule `c` whose centre is nearest to a point: they stand at equal steps on a line."""
    own = at.capsule + c
    dx, dy, dz = x - arm[own, CENTER], y - arm[own, CENTER + 1], z - arm[own, CENTER + 2]
    along = dx * arm[own, ALONG] + dy * arm[own, ALONG + 1] + dz * arm[own, ALONG + 2]
    steps = max(along * arm[own, PER_STEP] + 0.5, 0.0)
    return int(min(arm[own, FIRST] + steps, arm[own, LAST]))
