"""Deployment poses: the spurs of a vine's cloud, ordered best first.

`extract_poses` works on one cloud. The recommended way for a scan is one call for each depth frame and `merge_poses`
over the results: poses merge well under errors of the arm that blur a merged cloud.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array
from grape.perception.checks import as_points, as_unit
from grape.perception.cloud import outlier_mask, voxel_grid
from grape.tasks.dispenser.perception.deployment_pose import (
    DeploymentPose,
    ScoreOptions,
    SpurMeasure,
    ramp,
    score_factors,
)
from grape.tasks.dispenser.perception.geodesic import GeodesicOptions, geodesic_candidates
from grape.tasks.dispenser.perception.silhouette import SilhouetteOptions, silhouette_candidates
from grape.tasks.dispenser.perception.spur_measure import RefineOptions, Surroundings, measure_spur

GENERATORS = ("geodesic", "silhouette")


@dataclass(frozen=True, kw_only=True)
class SpurOptions:
    """The whole extraction.

    Args:
        voxel_m: the cloud is thinned to this; 0 takes it as it is.
        outlier_m, outlier_neighbours: points with fewer neighbours this near are dropped first; 0 neighbours: none.
        generators: which of `GENERATORS` propose candidates.
        group_m: of refined spurs whose tips are this near, the best stays.
        min_score: poses with less are left out.
    """

    voxel_m: float = 0.002
    outlier_m: float = 0.009
    outlier_neighbours: int = 8
    generators: tuple[str, ...] = GENERATORS
    geodesic: GeodesicOptions = field(default_factory=GeodesicOptions)
    silhouette: SilhouetteOptions = field(default_factory=SilhouetteOptions)
    refine: RefineOptions = field(default_factory=RefineOptions)
    score: ScoreOptions = field(default_factory=ScoreOptions)
    group_m: float = 0.025
    min_score: float = 0.2

    def __post_init__(self) -> None:
        unknown = set(self.generators) - set(GENERATORS)
        if unknown or not self.generators:
            raise InvalidInput(f"generators must be some of {GENERATORS}, got {self.generators}")
        if self.voxel_m < 0 or self.group_m <= 0 or self.outlier_neighbours < 0 or not 0 <= self.min_score < 1:
            raise InvalidInput(f"spur options must be positive, got {self}")


# For a smoothed sweep of the wrist LiDAR: sparser points, a 7 mm beam spot that widens stems; the diameter only leaves
# arms out.
LIDAR_SPURS = SpurOptions(
    voxel_m=0.003,
    outlier_m=0.013,
    outlier_neighbours=4,
    geodesic=GeodesicOptions(edge_m=0.013),
    silhouette=SilhouetteOptions(jump_m=0.04),
    refine=RefineOptions(
        lateral_m=0.014,
        depth_m=0.025,
        wide_m=0.028,
        gap_m=0.012,
        tip_beyond_m=-0.003,
        diameter_bias_m=0.002,
        depth_share=0.35,
    ),
    score=ScoreOptions(diameter_m=(0.002, 0.0055, 0.015, 0.022)),
)


def extract_poses(
    points: Array,
    origins: Array,
    options: SpurOptions | None = None,
    *,
    up: Any = (0.0, 0.0, 1.0),
    reach: Callable[[Array], float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[DeploymentPose, ...]:
    """The spurs of one vine on which a dispenser can be hung, best first.

    Args:
        points: (n, 3) m, cropped to the vine; any frame. An empty cloud has no spurs.
        origins: (k, 3) m, places of the sensor, same frame; they tell the lines of sight and the robot's side.
        options: see `SpurOptions`.
        up: (3,) against gravity, same frame.
        reach: gives 0...1 for a tip (3,); None takes every tip as reachable.
        progress: called with 0...100.

    Raises:
        InvalidInput: arrays of another shape or not finite, or no origin.
    """
    options, report = options or SpurOptions(), progress or (lambda percent: None)
    points, origins, up = as_points(points), as_points(origins, "origins"), as_unit(up, "up")
    if len(origins) == 0:
        raise InvalidInput("at least one origin of the sensor is needed")
    report(0.0)
    points = _prepare(points, options)
    if len(points) < 2 * options.geodesic.min_component:
        report(100.0)
        return ()
    scene = _surroundings(points, origins, up, options)
    report(20.0)
    candidates = _candidates(points, up, scene.toward_robot, options)
    report(60.0)
    found: list[tuple[SpurMeasure, dict[str, float]]] = []
    for k, candidate in enumerate(candidates):
        spur = measure_spur(candidate[:3], candidate[3:], scene, options.refine)
        if spur is not None and spur.direction @ up > 0.2:
            found.append((spur, score_factors(spur, up, 1.0 if reach is None else reach(spur.tip), options.score)))
        report(60.0 + 40.0 * (k + 1) / len(candidates))
    report(100.0)
    return rank([_pose_of(*pair) for pair in found], options.min_score, options.group_m)


def _prepare(points: Array, options: SpurOptions) -> Array:
    if options.voxel_m > 0:
        points = voxel_grid(points, options.voxel_m)
    if options.outlier_neighbours > 0 and len(points):
        points = points[outlier_mask(points, options.outlier_m, options.outlier_neighbours)]
    return np.ascontiguousarray(points)


def _surroundings(points: Array, origins: Array, up: Array, options: SpurOptions) -> Surroundings:
    middle = np.median(np.ascontiguousarray(points.T), axis=1)
    to_robot = origins.mean(axis=0) - middle
    to_robot = to_robot - (to_robot @ up) * up
    toward_robot = as_unit(to_robot, "the horizontal direction from the cloud to the origins")
    pitch = np.radians(options.score.pitch_deg)
    return Surroundings(
        points=points,
        origins=origins,
        approach=np.cos(pitch) * toward_robot + np.sin(pitch) * up,
        toward_robot=toward_robot,
        middle=middle,
        corridor_radius_m=options.score.corridor_radius_m,
    )


def _candidates(points: Array, up: Array, toward_robot: Array, options: SpurOptions) -> Array:
    """(k, 6) tips and directions of all generators."""
    parts = []
    if "geodesic" in options.generators:
        parts.append(geodesic_candidates(points, up, options.geodesic))
    if "silhouette" in options.generators:
        parts.append(silhouette_candidates(points, up, toward_robot, options.silhouette))
    return np.vstack(parts)


def _pose_of(spur: SpurMeasure, factors: dict[str, float]) -> DeploymentPose:
    return DeploymentPose(
        tip=spur.tip,
        base=spur.base,
        direction=spur.direction,
        diameter_m=spur.diameter_m,
        length_m=spur.length_m,
        score=float(np.prod(list(factors.values()))),
        factors=factors,
    )


def rank(poses: Sequence[DeploymentPose], min_score: float = 0.0, group_m: float = 0.025) -> tuple[DeploymentPose, ...]:
    """Best first; of poses with tips within `group_m`, or on one axis within 90 mm, only the best."""
    kept: list[DeploymentPose] = []
    for pose in sorted((p for p in poses if p.score >= min_score), key=lambda p: -p.score):
        if not any(_same_spur(pose, other, group_m) for other in kept):
            kept.append(pose)
    return tuple(kept)


def _same_spur(pose: DeploymentPose, other: DeploymentPose, group_m: float) -> bool:
    offset = pose.tip - other.tip
    distance = float(np.linalg.norm(offset))
    beside = float(np.linalg.norm(np.cross(offset, other.direction)))
    return distance < group_m or (distance < 0.09 and beside < 0.012)


@dataclass(frozen=True, kw_only=True)
class MergeOptions:
    """How poses of several views become one list.

    Args:
        group_m, group_cos: poses of one spur have tips this near and directions with at least this cosine.
        support: views that give full weight; a spur that fewer saw keeps `single` to 1 of its mean score.
        single: weight of a spur that one view saw.
        agreement: views that found a spur, relative to those that should have: without weight up to the first, with
            full weight from the second.
        min_score: poses with less are left out.
    """

    group_m: float = 0.025
    group_cos: float = 0.85
    support: int = 3
    single: float = 0.7
    agreement: tuple[float, float] = (0.35, 0.7)
    min_score: float = 0.3

    def __post_init__(self) -> None:
        low, high = self.agreement
        if self.group_m <= 0 or self.support < 1 or not 0 < self.single <= 1 or not low < high:
            raise InvalidInput(f"merge options must be positive, got {self}")


def merge_poses(
    views: Sequence[Sequence[DeploymentPose]],
    options: MergeOptions | None = None,
    shows: Sequence[Callable[[DeploymentPose], float]] = (),
) -> tuple[DeploymentPose, ...]:
    """Poses of several views in one frame, best first: medians of those that belong to one spur.

    Args:
        views: what `extract_poses` gave for each view; all in one frame.
        options: see `MergeOptions`.
        shows: for each view, how sure (0...1) it should have shown a spur; a spur that few of those views found loses.
            Without, views are not asked.
    """
    options = options or MergeOptions()
    groups: list[list[DeploymentPose]] = []
    for pose in sorted((p for view in views for p in view), key=lambda p: -p.score):
        for group in groups:
            near = np.linalg.norm(pose.tip - group[0].tip) < options.group_m
            if near and pose.direction @ group[0].direction > options.group_cos:
                group.append(pose)
                break
        else:
            groups.append([pose])
    full = min(options.support, max(len(views), 1))
    merged = [_merge_group(group, _weights(group, full, shows, options)) for group in groups]
    return rank(merged, options.min_score, options.group_m)


def _weights(
    group: list[DeploymentPose], full: int, shows: Sequence[Callable[[DeploymentPose], float]], options: MergeOptions
) -> dict[str, float]:
    """Factors of how many views found a spur, and which share of those that should have."""
    rise = 1.0 if full == 1 else min(1.0, (len(group) - 1) / (full - 1))
    expected = max(sum(view(group[0]) for view in shows), 1.0)
    agreement = ramp(len(group) / expected, *options.agreement) if shows else 1.0
    return {"support": options.single + (1.0 - options.single) * rise, "agreement": agreement}


def _merge_group(group: list[DeploymentPose], weights: dict[str, float]) -> DeploymentPose:
    names = group[0].factors
    factors = {name: float(np.mean([p.factors.get(name, 1.0) for p in group])) for name in names}
    return replace(
        group[0],
        tip=np.median([p.tip for p in group], axis=0),
        base=np.median([p.base for p in group], axis=0),
        direction=np.median([p.direction for p in group], axis=0),
        diameter_m=float(np.median([p.diameter_m for p in group])),
        length_m=float(np.median([p.length_m for p in group])),
        score=float(np.mean([p.score for p in group]) * np.prod(list(weights.values()))),
        factors={**factors, **weights},
        frames=sum(p.frames for p in group),
    )
