"""Compiled kernels of the arm's shape: where its capsules are, and how far from one another and from boxes.

All that is known of arm and boxes stands in one flat array, since a call that takes few arrays costs little; `packed`
in `checker.py` fills it. It is read by index, not by slices, since each slice costs two counts of a reference.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

GRID = 5  # where origin, voxel and reach of the distance field stand, behind the counts
CHAIN = 10  # where the placements of the joints begin, 12 numbers each
FIRST, LAST, HALF, PER_METRE, RADIUS, PER_STEP, START, STEP = (
    0,
    1,
    2,
    3,
    4,
    5,
    6,
    9,
)  # columns of a capsule, see `packed`
COLUMNS = 12
ALONG, MIDDLE, PLACED = 3, 6, 9  # of a placed capsule: its first centre at 0, the step to the next one, its middle


class Places(NamedTuple):
    """How many joints, capsules, pairs and boxes the flat array holds, and where its parts begin."""

    joints: int
    capsules: int
    pairs: int
    boxes: int
    first: int  # first capsule of each joint
    capsule: int
    pair: int
    owner: int  # capsule of each sphere
    box: int
    mask: int
    placed: int  # room for the capsules in the base frame
    gap: int  # room for the gaps to the boxes
    hull: int  # the box about all boxes


@njit(cache=True)
def places(arm):
    """Where everything is in the flat array."""
    n, c, k, b, m = int(arm[0]), int(arm[1]), int(arm[2]), int(arm[3]), int(arm[4])
    first = CHAIN + 12 * n
    capsule = first + n + 2
    pair = capsule + COLUMNS * c
    owner = pair + 2 * k
    box = owner + m
    mask = box + 6 * b
    placed = mask + c * b
    gap = placed + PLACED * c
    return Places(n, c, k, b, first, capsule, pair, owner, box, mask, placed, gap, gap + b)


@njit(cache=True)
def place(q, arm, at):
    """Fills in the capsules in the base frame at joint angles `q`."""
    R, p = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for joint in range(at.joints + 1):
        if joint > 0:
            t = CHAIN + 12 * (joint - 1)
            dx, dy, dz = _rotated(R, arm[t + 3], arm[t + 7], arm[t + 11])
            R, p = _turned(R, arm, t, np.cos(q[joint - 1]), np.sin(q[joint - 1])), (p[0] + dx, p[1] + dy, p[2] + dz)
        for c in range(int(arm[at.first + joint]), int(arm[at.first + joint + 1])):
            own, out = at.capsule + COLUMNS * c, at.placed + PLACED * c
            x, y, z = _rotated(R, arm[own + START], arm[own + START + 1], arm[own + START + 2])
            dx, dy, dz = _rotated(R, arm[own + STEP], arm[own + STEP + 1], arm[own + STEP + 2])
            half = 0.5 * (arm[own + LAST] - arm[own + FIRST])
            arm[out], arm[out + 1], arm[out + 2] = p[0] + x, p[1] + y, p[2] + z
            arm[out + 3], arm[out + 4], arm[out + 5] = dx, dy, dz
            arm[out + 6], arm[out + 7], arm[out + 8] = p[0] + x + half * dx, p[1] + y + half * dy, p[2] + z + half * dz


@njit(cache=True, forceinline=True)
def _rotated(R, x, y, z):
    return R[0] * x + R[1] * y + R[2] * z, R[3] * x + R[4] * y + R[5] * z, R[6] * x + R[7] * y + R[8] * z


@njit(cache=True, forceinline=True)
def _turned(R, arm, t, cosine, sine):
    """The rotation behind a joint: R, the placement at `t`, and the turn about its z axis."""
    a0, a3, a6 = _rotated(R, arm[t], arm[t + 4], arm[t + 8])
    a1, a4, a7 = _rotated(R, arm[t + 1], arm[t + 5], arm[t + 9])
    a2, a5, a8 = _rotated(R, arm[t + 2], arm[t + 6], arm[t + 10])
    return (
        a0 * cosine + a1 * sine, a1 * cosine - a0 * sine, a2,
        a3 * cosine + a4 * sine, a4 * cosine - a3 * sine, a5,
        a6 * cosine + a7 * sine, a7 * cosine - a6 * sine, a8,
    )  # fmt: skip


@njit(cache=True, forceinline=True)
def sphere(arm, at, c, s):
    """Centre of sphere `s` of the placed capsule `c`, base frame."""
    own, i = at.placed + PLACED * c, s - arm[at.capsule + COLUMNS * c + FIRST]
    return arm[own] + i * arm[own + 3], arm[own + 1] + i * arm[own + 4], arm[own + 2] + i * arm[own + 5]


@njit(cache=True, forceinline=True)
def middle(arm, at, c):
    """Middle of the placed capsule `c`, base frame."""
    own = at.placed + PLACED * c + MIDDLE
    return arm[own], arm[own + 1], arm[own + 2]


@njit(cache=True, forceinline=True)
def spared(excess, per_metre):
    """How many of the next spheres of a capsule cannot be nearer than the best, as one is farther by `excess` m."""
    return int(excess * per_metre) if excess > 0.0 else 0


@njit(cache=True, error_model="numpy", forceinline=True)
def box_clearance(c, arm, at, padding, best, stop, close):
    """(clearance, sphere, box) of capsule `c` where it is below `best` and `close`, else a bound and sphere -1."""
    own, first, second = at.capsule + COLUMNS * c, -1, -1
    if at.boxes == 0:
        return best, first, second
    x, y, z = middle(arm, at, c)
    bound = np.sqrt(_outside(x, y, z, arm, at.hull, 1)) - arm[own + HALF] - padding
    if bound >= min(best, close):
        return min(best, bound), first, second
    best = min(best, close)
    _outside_all(x, y, z, arm, at)
    for b in range(at.boxes):
        near = _squared(arm[own + HALF] + padding + best)
        if arm[at.gap + b] > near or arm[at.mask + c * at.boxes + b] == 0.0:
            continue
        s = int(arm[own + LAST])
        while s >= int(arm[own + FIRST]):
            x, y, z = sphere(arm, at, c, s)
            d = box_distance(x, y, z, arm, at, b) - arm[own + RADIUS] - padding
            if d < best:
                best, first, second = d, s, b
                if best < stop:
                    return best, first, second
            s -= 1 + spared(d - best - 1e-9, arm[own + PER_METRE])
    return best, first, second


@njit(cache=True, forceinline=True)
def _squared(distance):
    """The square of a distance that does not count below 0."""
    return max(distance, 0.0) ** 2


@njit(cache=True, error_model="numpy", forceinline=True)
def _outside(x, y, z, table, box, stride):
    """Squared distance of a point from a box, 0 inside; its centre and half size stand `stride` apart."""
    dx = max(abs(x - table[box]) - table[box + 3 * stride], 0.0)
    dy = max(abs(y - table[box + stride]) - table[box + 4 * stride], 0.0)
    dz = max(abs(z - table[box + 2 * stride]) - table[box + 5 * stride], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, error_model="numpy", forceinline=True)
def _outside_all(x, y, z, arm, at):
    """Fills in the squared distances of a point from all boxes; slices let the compiler run the loop in lanes."""
    table, gaps = arm[at.box : at.mask], arm[at.gap : at.hull]
    for b in range(len(gaps)):
        gaps[b] = _outside(x, y, z, table, b, len(gaps))


@njit(cache=True, error_model="numpy", forceinline=True)
def box_distance(x, y, z, arm, at, b):
    """Distance of a point from box `b`, negative inside."""
    own, total = at.box + b, at.boxes
    dx = abs(x - arm[own]) - arm[own + 3 * total]
    dy = abs(y - arm[own + total]) - arm[own + 4 * total]
    dz = abs(z - arm[own + 2 * total]) - arm[own + 5 * total]
    inside = max(dx, dy, dz)
    if inside <= 0.0:
        return inside
    return np.sqrt(max(dx, 0.0) ** 2 + max(dy, 0.0) ** 2 + max(dz, 0.0) ** 2)


@njit(cache=True, error_model="numpy", forceinline=True)
def pair_clearance(k, arm, at, padding, best, stop, close):
    """(clearance, sphere, sphere) of pair `k` of capsules where it is below `best` and `close`, else a bound and -1.

    Bounds are the distance of the middles, and then that of the axes.
    """
    a, b = int(arm[at.pair + 2 * k]), int(arm[at.pair + 2 * k + 1])
    own, other, least = at.capsule + COLUMNS * a, at.capsule + COLUMNS * b, min(best, close)
    (ax, ay, az), (bx, by, bz) = middle(arm, at, a), middle(arm, at, b)
    bound = np.sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2) - arm[own + HALF] - arm[other + HALF] - padding
    if bound >= least:
        return min(best, bound), -1, -1
    gap, first, second = arm[own + RADIUS] + arm[other + RADIUS] + padding, -1, -1
    bound = _axis_distance(a, b, arm, at) - gap - 1e-8  # what nearly parallel axes cost in precision
    if bound >= least:
        return min(best, bound), -1, -1
    best, s = least, int(arm[own + LAST])
    while s >= int(arm[own + FIRST]):
        x, y, z = sphere(arm, at, a, s)
        nearest = _nearest_sphere(x, y, z, arm, at, b)
        bx, by, bz = sphere(arm, at, b, nearest)
        d = np.sqrt((x - bx) ** 2 + (y - by) ** 2 + (z - bz) ** 2) - gap
        if d < best:
            best, first, second = d, s, nearest
            if best < stop:
                break
        s -= 1 + spared(d - best - 1e-9, arm[own + PER_METRE])
    return best, first, second


@njit(cache=True, error_model="numpy", forceinline=True)
def _axis_distance(a, b, arm, at):
    """Distance between the axes of two placed capsules, from the first to the last centre.

    Source: Ericson, Real-time collision detection, 2005, 5.1.9.
    """
    one, two = at.placed + PLACED * a, at.placed + PLACED * b
    own, other = at.capsule + COLUMNS * a, at.capsule + COLUMNS * b
    n, m = arm[own + LAST] - arm[own + FIRST], arm[other + LAST] - arm[other + FIRST]
    ux, uy, uz = n * arm[one + 3], n * arm[one + 4], n * arm[one + 5]
    vx, vy, vz = m * arm[two + 3], m * arm[two + 4], m * arm[two + 5]
    wx, wy, wz = arm[one] - arm[two], arm[one + 1] - arm[two + 1], arm[one + 2] - arm[two + 2]
    uu, vv, uv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    uw, vw = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    across = uu * vv - uv * uv
    s = _share(uv * vw - uw * vv, across)
    t = _share(uv * s + vw, vv)
    s = _share(uv * t - uw, uu)
    dx, dy, dz = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True, error_model="numpy", forceinline=True)
def _share(part, whole):
    """part / whole within 0..1; 0 where the whole vanishes."""
    return min(max(part / whole, 0.0), 1.0) if whole > 1e-18 else 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _nearest_sphere(x, y, z, arm, at, c):
    """The sphere of capsule `c` whose centre is nearest to a point: they stand at equal steps on a line."""
    own, out = at.capsule + COLUMNS * c, at.placed + PLACED * c
    along = (x - arm[out]) * arm[out + 3] + (y - arm[out + 1]) * arm[out + 4] + (z - arm[out + 2]) * arm[out + 5]
    steps = max(along * arm[own + PER_STEP] + 0.5, 0.0)
    return int(min(arm[own + FIRST] + steps, arm[own + LAST]))
