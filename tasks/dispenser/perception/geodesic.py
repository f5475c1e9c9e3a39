"""Spur candidates as ends of branches: layers of equal geodesic distance on a neighbourhood graph of the cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array
from grape.perception.cloud import voxel_grid


@dataclass(frozen=True, kw_only=True)
class GeodesicOptions:
    """The graph and its layers.

    Args:
        voxel_m: the cloud is thinned to this first; 0 takes it as it is.
        neighbours: of each point.
        edge_m: longest edge.
        layer_m: thickness of a layer of equal geodesic distance.
        min_component: smaller connected parts are noise.
        axis_layers: layers below the end that give the branch's direction.
        min_layers: shorter branches are knobs and buds.
        min_rise: smallest upward part of the direction (sine of its elevation).
    """

    voxel_m: float = 0.003
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
    from grape.perception.neighbour_kernels import nearest
    from grape.tasks.dispenser.perception.geodesic_kernels import both_ways, distance_from, longest_children, parents

    if options.voxel_m > 0:
        points = voxel_grid(points, options.voxel_m)
    points = np.ascontiguousarray(points, dtype=np.float64)
    start, other, length = both_ways(*nearest(points, options.edge_m, options.neighbours))
    distance = distance_from(_lowest(start, other, points @ up, options), start, other, length)
    node, layer = _layer_nodes(start, other, distance, options)
    parent = parents(start, other, node, layer, len(layer))
    return _branch_ends(points, node, layer, parent, longest_children(parent, layer), up, options)


def _lowest(start: Array, other: Array, height: Array, options: GeodesicOptions) -> Array:
    """Indices of the lowest point of each connected part that is large enough."""
    from grape.tasks.dispenser.perception.geodesic_kernels import parts

    part, _ = parts(start, other, np.zeros(len(height), np.int64))
    order = np.lexsort((height, part))
    roots = order[np.r_[True, np.diff(part[order]) != 0]]
    return roots[np.bincount(part)[part[roots]] >= options.min_component]


def _layer_nodes(start: Array, other: Array, distance: Array, options: GeodesicOptions) -> tuple[Array, Array]:
    """Node of each point (-1: none), and layer of each node: a node is a connected part of one layer."""
    from grape.tasks.dispenser.perception.geodesic_kernels import parts

    reached = np.isfinite(distance)
    layer = np.where(reached, np.where(reached, distance, 0.0) / options.layer_m, -1).astype(np.int64)
    node, total = parts(start, other, layer)
    layers = np.zeros(total, np.int64)
    layers[node[reached]] = layer[reached]
    return node, layers


def _branch_ends(
    points: Array, node: Array, layer: Array, parent: Array, child: Array, up: Array, options: GeodesicOptions
) -> Array:
    """Follows each end node down to where a longer branch joins; its first layers give tip and direction."""
    has = node >= 0
    count = np.bincount(node[has], minlength=len(layer))
    sums = np.stack([np.bincount(node[has], points[has, k], len(layer)) for k in range(3)], axis=1)
    centre = sums / np.maximum(count, 1)[:, None]
    found = []
    for leaf in np.nonzero(child < 0)[0]:
        path, i = [leaf], leaf
        while parent[i] >= 0 and child[parent[i]] == i and len(path) < options.axis_layers:
            i = parent[i]
            path.append(i)
        axis = centre[path[0]] - centre[path[-1]]
        length = float(np.linalg.norm(axis))
        long_enough = len(path) >= options.min_layers and length > 1.2 * options.layer_m
        if long_enough and axis @ up >= options.min_rise * length:
            found.append(np.r_[centre[leaf], axis / length])
    return np.array(found).reshape(-1, 6)
