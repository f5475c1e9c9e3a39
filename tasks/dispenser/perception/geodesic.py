"""Spur candidates as ends of branches: layers of equal geodesic distance on a neighbourhood graph of the cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from grape.errors import InvalidInput
from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class GeodesicOptions:
    """The graph and its layers.

    Args:
        neighbours: of each point.
        edge_m: longest edge.
        layer_m: thickness of a layer of equal geodesic distance.
        min_component: smaller connected parts are noise.
        axis_layers: layers below the end that give the branch's direction.
        min_layers: shorter branches are knobs and buds.
        min_rise: smallest upward part of the direction (sine of its elevation).
    """

    neighbours: int = 10
    edge_m: float = 0.009
    layer_m: float = 0.010
    min_component: int = 25
    axis_layers: int = 6
    min_layers: int = 3
    min_rise: float = 0.1

    def __post_init__(self) -> None:
        if min(self.neighbours, self.min_component, self.min_layers) < 1 or self.axis_layers < 2:
            raise InvalidInput(f"counts must be positive and axis_layers at least 2, got {self}")
        if self.edge_m <= 0 or self.layer_m <= 0:
            raise InvalidInput(f"edge_m and layer_m must be positive, got {self.edge_m}, {self.layer_m}")


def geodesic_candidates(points: Array, up: Array, options: GeodesicOptions | None = None) -> Array:
    """(k, 6): tip (m) and unit direction of every branch end that points upwards.

    Args:
        points: (n, 3) m, thinned to about 3 mm.
        up: (3,) unit vector against gravity, same frame.
        options: see `GeodesicOptions`.

    Source: Verroust and Lazarus, Extracting skeletal curves from 3D scattered data, 2000 (level sets of the geodesic
    distance), one root for each connected part.
    """
    options = options or GeodesicOptions()
    if len(points) <= options.neighbours:
        return np.empty((0, 6))
    graph = _graph(points, options)
    distance = _distance_from_lowest(graph, points @ up, options)
    node, layer = _layer_nodes(graph, distance, options)
    return _branch_ends(graph, points, node, layer, up, options)


def _graph(points: Array, options: GeodesicOptions) -> csr_matrix:
    """Symmetric graph (n, n) of the nearest neighbours, weights are distances in m."""
    n = len(points)
    distance, index = cKDTree(points).query(points, k=options.neighbours + 1, distance_upper_bound=options.edge_m)
    row = np.repeat(np.arange(n), options.neighbours)
    column, weight = index[:, 1:].ravel(), distance[:, 1:].ravel()
    real = column < n
    graph = csr_matrix((weight[real] + 1e-6, (row[real], column[real])), shape=(n, n))
    return graph.maximum(graph.T).tocsr()


def _distance_from_lowest(graph: csr_matrix, height: Array, options: GeodesicOptions) -> Array:
    """(n,) m along the graph from the lowest point of each connected part; infinite in parts that are too small."""
    _, part = connected_components(graph, directed=False)
    order = np.lexsort((height, part))
    first = np.r_[True, np.diff(part[order]) != 0]
    roots = order[first]
    roots = roots[np.bincount(part)[part[roots]] >= options.min_component]
    if len(roots) == 0:
        return np.full(graph.shape[0], np.inf)
    return dijkstra(graph, indices=roots, min_only=True)


def _layer_nodes(graph: csr_matrix, distance: Array, options: GeodesicOptions) -> tuple[Array, Array]:
    """Node of each point (-1: none), and layer of each node: a node is a connected part of one layer."""
    reached = np.isfinite(distance)
    layer = np.where(reached, np.where(reached, distance, 0.0) / options.layer_m, -1).astype(int)
    edges = graph.tocoo()
    same = (layer[edges.row] == layer[edges.col]) & (layer[edges.row] >= 0)
    inside = csr_matrix((np.ones(int(same.sum())), (edges.row[same], edges.col[same])), shape=graph.shape)
    _, part = connected_components(inside, directed=False)
    _, node = np.unique(part[reached], return_inverse=True)
    full = np.full(len(distance), -1)
    full[reached] = node
    layers = np.zeros(node.max() + 1 if len(node) else 0, int)
    layers[node] = layer[reached]
    return full, layers


def _parents(graph: csr_matrix, node: Array, layer: Array) -> Array:
    """(nodes,) the node one layer nearer to the root that shares most edges, -1 at roots."""
    edges = graph.tocoo()
    a, b = node[edges.row], node[edges.col]
    down = (a >= 0) & (b >= 0)
    a, b = a[down], b[down]
    down = layer[b] == layer[a] - 1
    shared = csr_matrix((np.ones(int(down.sum())), (a[down], b[down])), shape=(len(layer), len(layer)))
    shared.sum_duplicates()
    parent = np.full(len(layer), -1)
    rows = np.repeat(np.arange(len(layer)), np.diff(shared.indptr))
    order = np.argsort(shared.data, kind="stable")  # the last write of a row is its largest
    parent[rows[order]] = shared.indices[order]
    return parent


def _branch_ends(
    graph: csr_matrix, points: Array, node: Array, layer: Array, up: Array, options: GeodesicOptions
) -> Array:
    """Follows each end node down to where a longer branch joins; its first layers give tip and direction."""
    if len(layer) == 0:
        return np.empty((0, 6))
    parent = _parents(graph, node, layer)
    height, best = np.zeros(len(layer), int), np.full(len(layer), -1)
    for i in np.argsort(-layer, kind="stable"):
        p = parent[i]
        if p >= 0 and height[i] + 1 > height[p]:
            height[p], best[p] = height[i] + 1, i
    has = node >= 0
    count = np.bincount(node[has], minlength=len(layer))
    sums = np.stack([np.bincount(node[has], points[has, k], len(layer)) for k in range(3)], axis=1)
    centre = sums / np.maximum(count, 1)[:, None]
    found = []
    for leaf in np.nonzero(best < 0)[0]:
        path, i = [leaf], leaf
        while parent[i] >= 0 and best[parent[i]] == i and len(path) < options.axis_layers:
            i = parent[i]
            path.append(i)
        axis = centre[path[0]] - centre[path[-1]]
        length = float(np.linalg.norm(axis))
        long_enough = len(path) >= options.min_layers and length > 1.2 * options.layer_m
        if long_enough and axis @ up >= options.min_rise * length:
            found.append(np.r_[centre[leaf], axis / length])
    return np.array(found).reshape(-1, 6)
