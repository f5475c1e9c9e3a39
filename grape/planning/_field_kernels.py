"""Compiled kernels of the distance field; imported only where they are used."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.planning._compiled import inlined


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


@inlined
def field_at(x, y, z, field, grid):
    """Trilinear distance at a point, outside of the grid the reach; `grid` is origin, voxel and reach."""
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


@inlined
def nearest_at(x, y, z, field, grid):
    """Distance of the voxel whose centre is nearest to a point; see `field_at`."""
    per_metre = 1.0 / grid[3]
    u = (x - grid[0]) * per_metre + 0.5
    v = (y - grid[1]) * per_metre + 0.5
    w = (z - grid[2]) * per_metre + 0.5
    nx, ny, nz = field.shape
    inside = (u >= 0.0) & (v >= 0.0) & (w >= 0.0) & (u < nx) & (v < ny) & (w < nz)
    return field[int(u), int(v), int(w)] if inside else grid[4]


@njit(cache=True)
def query_field(points, field, grid):
    """Distance of each point (m, 3)."""
    out = np.empty(len(points))
    for i in range(len(points)):
        out[i] = field_at(points[i, 0], points[i, 1], points[i, 2], field, grid)
    return out
