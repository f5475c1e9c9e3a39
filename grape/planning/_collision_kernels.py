"""Compiled kernels of the collision check; imported only where they are used."""

from __future__ import annotations

import numpy as np
from numba import njit

NOTHING, CLOUD, BOX, SELF = 0, 1, 2, 3


@njit(cache=True)
def squared_distance_transform(grid):
    """In place: each voxel's squared distance (voxels) to the nearest zero; one lower envelope per line and axis."""
    nx, ny, nz = grid.shape
    size = max(nx, ny, nz)
    line, out = np.empty(size, np.float64), np.empty(size, np.float64)
    vertex, border = np.empty(size, np.int64), np.empty(size + 1, np.float64)
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                line[z] = grid[x, y, z]
            if _lower_envelope(line, nz, vertex, border, out):
                for z in range(nz):
                    grid[x, y, z] = out[z]
    for x in range(nx):
        for z in range(nz):
            for y in range(ny):
                line[y] = grid[x, y, z]
            if _lower_envelope(line, ny, vertex, border, out):
                for y in range(ny):
                    grid[x, y, z] = out[y]
    for y in range(ny):
        for z in range(nz):
            for x in range(nx):
                line[x] = grid[x, y, z]
            if _lower_envelope(line, nx, vertex, border, out):
                for x in range(nx):
                    grid[x, y, z] = out[x]


@njit(cache=True)
def _lower_envelope(f, n, vertex, border, out):
    """out[i] = min_j f[j] + (i - j)^2; False when every f is infinite."""
    k = -1
    for q in range(n):
        if f[q] == np.inf:
            continue
        start = -np.inf
        while k >= 0:
            p = vertex[k]
            start = ((f[q] + q * q) - (f[p] + p * p)) / (2.0 * (q - p))
            if start > border[k]:
                break
            k -= 1
        if k < 0:
            start = -np.inf
        k += 1
        vertex[k] = q
        border[k] = start
        border[k + 1] = np.inf
    if k < 0:
        return False
    k = 0
    for q in range(n):
        while border[k + 1] < q:
            k += 1
        d = q - vertex[k]
        out[q] = d * d + f[vertex[k]]
    return True


@njit(cache=True, error_model="numpy")
def _field_at(x, y, z, field, grid):
    """Trilinear distance at a point; outside of the grid the reach."""
    u = (x - grid[0]) / grid[3]
    v = (y - grid[1]) / grid[3]
    w = (z - grid[2]) / grid[3]
    nx, ny, nz = field.shape
    if not (u >= 0.0 and v >= 0.0 and w >= 0.0 and u < nx - 1 and v < ny - 1 and w < nz - 1):
        return grid[4]
    i, j, k = int(u), int(v), int(w)
    a, b, c = u - i, v - j, w - k
    low = (field[i, j, k] * (1 - c) + field[i, j, k + 1] * c) * (1 - b)
    low += (field[i, j + 1, k] * (1 - c) + field[i, j + 1, k + 1] * c) * b
    high = (field[i + 1, j, k] * (1 - c) + field[i + 1, j, k + 1] * c) * (1 - b)
    high += (field[i + 1, j + 1, k] * (1 - c) + field[i + 1, j + 1, k + 1] * c) * b
    return low * (1 - a) + high * a


@njit(cache=True)
def query_field(points, field, grid):
    """Distance of each point (m, 3)."""
    out = np.empty(len(points))
    for i in range(len(points)):
        out[i] = _field_at(points[i, 0], points[i, 1], points[i, 2], field, grid)
    return out


@njit(cache=True)
def _centers(q, chain, spheres, centers):
    """Centres of the spheres (m, 3) in the base frame; spheres are sorted by joint."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    px, py, pz = 0.0, 0.0, 0.0
    s, count = 0, len(spheres)
    for joint in range(len(chain) + 1):
        if joint > 0:
            T = chain[joint - 1]
            px += r00 * T[0, 3] + r01 * T[1, 3] + r02 * T[2, 3]
            py += r10 * T[0, 3] + r11 * T[1, 3] + r12 * T[2, 3]
            pz += r20 * T[0, 3] + r21 * T[1, 3] + r22 * T[2, 3]
            c, n = np.cos(q[joint - 1]), np.sin(q[joint - 1])
            a00, a01, a02 = T[0, 0] * c + T[0, 1] * n, T[0, 1] * c - T[0, 0] * n, T[0, 2]
            a10, a11, a12 = T[1, 0] * c + T[1, 1] * n, T[1, 1] * c - T[1, 0] * n, T[1, 2]
            a20, a21, a22 = T[2, 0] * c + T[2, 1] * n, T[2, 1] * c - T[2, 0] * n, T[2, 2]
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
        while s < count and spheres[s, 0] == joint:
            x, y, z = spheres[s, 1], spheres[s, 2], spheres[s, 3]
            centers[s, 0] = px + r00 * x + r01 * y + r02 * z
            centers[s, 1] = py + r10 * x + r11 * y + r12 * z
            centers[s, 2] = pz + r20 * x + r21 * y + r22 * z
            s += 1


@njit(cache=True)
def sphere_centers(q, chain, spheres):
    """Centres of the spheres (m, 3) in the base frame."""
    centers = np.empty((len(spheres), 3))
    _centers(q, chain, spheres, centers)
    return centers


@njit(cache=True, error_model="numpy")
def _least_clearance(q, model, scene, padding, self_padding, most, stop, centers):
    """(clearance, kind, sphere, other) of the nearest thing; returns early once a clearance is below `stop`.

    Clearances of `most` and above are not told apart. A capsule whose middle is farther away than its half length plus
    the best clearance so far is passed over.
    """
    chain, spheres, capsules, pairs, boxes, mask = model
    field, grid = scene
    _centers(q, chain, spheres, centers)
    best, kind, first, second = most, NOTHING, -1, -1
    for c in range(len(capsules) - 1, -1, -1):  # the hand first: it hits most often
        s0, s1 = int(capsules[c, 0]), int(capsules[c, 1])
        around = capsules[c, 2] + padding
        mx = 0.5 * (centers[s0, 0] + centers[s1, 0])
        my = 0.5 * (centers[s0, 1] + centers[s1, 1])
        mz = 0.5 * (centers[s0, 2] + centers[s1, 2])
        if _field_at(mx, my, mz, field, grid) - around - grid[3] < best:  # a voxel covers the interpolation
            for s in range(s1, s0 - 1, -1):
                distance = _field_at(centers[s, 0], centers[s, 1], centers[s, 2], field, grid)
                d = distance - spheres[s, 4] - padding
                if d < best:
                    best, first, second = d, s, -1
                    kind = CLOUD if distance < grid[4] - 1e-6 else NOTHING
                    if best < stop:
                        return best, kind, first, second
        for b in range(len(boxes)):
            if not mask[c, b] or _box_distance(mx, my, mz, boxes[b]) - around >= best:
                continue
            for s in range(s1, s0 - 1, -1):
                d = _box_distance(centers[s, 0], centers[s, 1], centers[s, 2], boxes[b]) - spheres[s, 4] - padding
                if d < best:
                    best, kind, first, second = d, BOX, s, b
                    if best < stop:
                        return best, kind, first, second
    for k in range(len(pairs)):
        a0, a1, b0, b1 = int(pairs[k, 0]), int(pairs[k, 1]), int(pairs[k, 2]), int(pairs[k, 3])
        dx = 0.5 * (centers[a0, 0] + centers[a1, 0] - centers[b0, 0] - centers[b1, 0])
        dy = 0.5 * (centers[a0, 1] + centers[a1, 1] - centers[b0, 1] - centers[b1, 1])
        dz = 0.5 * (centers[a0, 2] + centers[a1, 2] - centers[b0, 2] - centers[b1, 2])
        near = max(pairs[k, 4] + self_padding + best, 0.0)
        if dx * dx + dy * dy + dz * dz >= near * near:
            continue
        for i in range(a0, a1 + 1):
            for j in range(b0, b1 + 1):
                dx = centers[i, 0] - centers[j, 0]
                dy = centers[i, 1] - centers[j, 1]
                dz = centers[i, 2] - centers[j, 2]
                gap = spheres[i, 4] + spheres[j, 4] + self_padding
                near = max(gap + best, 0.0)
                if dx * dx + dy * dy + dz * dz >= near * near:
                    continue
                best, kind, first, second = np.sqrt(dx * dx + dy * dy + dz * dz) - gap, SELF, i, j
                if best < stop:
                    return best, kind, first, second
    return best, kind, first, second


@njit(cache=True, error_model="numpy")
def _box_distance(x, y, z, box):
    """Distance of a point from a box (centre, half size), negative inside."""
    dx, dy, dz = abs(x - box[0]) - box[3], abs(y - box[1]) - box[4], abs(z - box[2]) - box[5]
    inside = max(dx, dy, dz)
    if inside <= 0.0:
        return inside
    dx, dy, dz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True)
def least_clearance(q, model, scene, padding, self_padding):
    """(clearance m, kind, sphere, other) at one state."""
    centers = np.empty((len(model[1]), 3))
    return _least_clearance(q, model, scene, padding, self_padding, scene[1][4], -np.inf, centers)


@njit(cache=True)
def state_valid(q, model, scene, padding, self_padding):
    """Whether nothing is nearer than the paddings."""
    centers = np.empty((len(model[1]), 3))
    return _least_clearance(q, model, scene, padding, self_padding, 0.0, 0.0, centers)[0] >= 0.0


@njit(cache=True)
def edge_valid(q0, q1, reach, model, scene, padding, self_padding, least_step):
    """(valid, states checked): walk the straight edge by conservative advancement.

    No surface point moves farther than sum |dq_i| reach_i, so a clearance of d frees that much of the edge. Steps of
    `least_step` m keep the walk short where the clearance goes to zero.
    """
    centers = np.empty((len(model[1]), 3))
    n = len(q0)
    travel = 0.0
    for i in range(n):
        travel += abs(q1[i] - q0[i]) * reach[i]
    if _least_clearance(q1, model, scene, padding, self_padding, 0.0, 0.0, centers)[0] < 0.0:
        return False, 1
    q = np.empty(n)
    t, checked = 0.0, 1
    while t < 1.0:
        for i in range(n):
            q[i] = q0[i] + t * (q1[i] - q0[i])
        d = _least_clearance(q, model, scene, padding, self_padding, scene[1][4], 0.0, centers)[0]
        checked += 1
        if d < 0.0:
            return False, checked
        if travel < 1e-9:
            return True, checked
        t += max(d, least_step) / travel
    return True, checked
