"""Compiled kernels of the geodesic layers; imported only where they run, since numba is slow to load."""

from __future__ import annotations

import numpy as np
from numba import njit

from grape.heap import pop, push


@njit(cache=True)
def both_ways(index, distance):  # type: ignore[no-untyped-def]
    """Edges of a graph of nearest neighbours (n, k), -1 for none, in both directions.

    Returns:
        start (n + 1,), and for each point the other ends and the lengths of its edges.
    """
    n, k = index.shape
    start = np.zeros(n + 1, np.int64)
    for i in range(n):
        for m in range(k):
            if index[i, m] >= 0:
                start[i + 1] += 1
                start[index[i, m] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    filled = start.copy()
    other, length = np.empty(start[n], np.int32), np.empty(start[n])
    for i in range(n):
        for m in range(k):
            j = index[i, m]
            if j >= 0:
                other[filled[i]], length[filled[i]] = j, distance[i, m]
                other[filled[j]], length[filled[j]] = i, distance[i, m]
                filled[i] += 1
                filled[j] += 1
    return start, other, length


@njit(cache=True)
def parts(start, other, group):  # type: ignore[no-untyped-def]
    """(n,) connected part of each point, and how many; edges count within a group alone, group -1 is in no part.

    Args:
        start, other: edges, see `both_ways`.
        group: (n,).
    """
    n = len(group)
    part, stack, total = np.full(n, -1, np.int64), np.empty(n, np.int32), 0
    for seed in range(n):
        if part[seed] >= 0 or group[seed] < 0:
            continue
        part[seed], stack[0], filled = total, seed, 1
        while filled > 0:
            filled -= 1
            i = stack[filled]
            for e in range(start[i], start[i + 1]):
                j = other[e]
                if part[j] < 0 and group[j] == group[i]:
                    part[j] = total
                    stack[filled] = j
                    filled += 1
        total += 1
    return part, total


@njit(cache=True)
def distance_from(roots, start, other, length):  # type: ignore[no-untyped-def]
    """(n,) m along the edges to the nearest root, infinite where none leads (Dijkstra with stale heap entries)."""
    n = len(start) - 1
    distance = np.full(n, np.inf)
    heap_key, heap_node = np.empty(len(other) + len(roots)), np.empty(len(other) + len(roots), np.int64)
    size = 0
    for root in roots:
        distance[root] = 0.0
        push(heap_key, heap_node, size, 0.0, root)
        size += 1
    while size > 0:
        key, i = heap_key[0], heap_node[0]
        pop(heap_key, heap_node, size)
        size -= 1
        if key > distance[i]:
            continue
        for e in range(start[i], start[i + 1]):
            through = key + length[e]
            if through < distance[other[e]]:
                distance[other[e]] = through
                push(heap_key, heap_node, size, through, other[e])
                size += 1
    return distance


@njit(cache=True)
def parents(start, other, node, layer, total):  # type: ignore[no-untyped-def]
    """(total,) the node one layer nearer to the root that shares most edges with each node, -1 at roots.

    Args:
        start, other: edges, see `both_ways`.
        node: (n,) of each point, -1 for none.
        layer: (total,) of each node.
        total: number of nodes.
    """
    members = np.zeros(total + 1, np.int64)
    for i in range(len(node)):
        if node[i] >= 0:
            members[node[i] + 1] += 1
    for a in range(total):
        members[a + 1] += members[a]
    filled, points = members.copy(), np.empty(members[total], np.int64)
    for i in range(len(node)):
        if node[i] >= 0:
            points[filled[node[i]]] = i
            filled[node[i]] += 1
    parent, shared = np.full(total, -1, np.int64), np.zeros(total, np.int64)
    for a in range(total):
        best = 0
        for phase in range(2):  # count, then clear
            for at in range(members[a], members[a + 1]):
                i = points[at]
                for e in range(start[i], start[i + 1]):
                    b = node[other[e]]
                    if b < 0 or layer[b] != layer[a] - 1:
                        continue
                    if phase == 1:
                        shared[b] = 0
                        continue
                    shared[b] += 1
                    if shared[b] > best:
                        best, parent[a] = shared[b], b
    return parent


@njit(cache=True)
def longest_children(parent, layer):  # type: ignore[no-untyped-def]
    """(total,) the child of each node on its longest branch outwards, -1 at ends."""
    total = len(parent)
    height, best = np.zeros(total, np.int64), np.full(total, -1, np.int64)
    order = np.argsort(-layer, kind="mergesort")
    for i in order:
        p = parent[i]
        if p >= 0 and height[i] + 1 > height[p]:
            height[p], best[p] = height[i] + 1, i
    return best
