"""Find where on a scanned vine a dispenser can hang, and how the hand gets there."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from grape.actions.core import Context, Feedback, action
from grape.actions.move_arm import find_postures
from grape.actions.obstacles import OBSTACLES, Obstacles
from grape.errors import ActionFailed, Reason
from grape.geometry import transform
from grape.messages import Array
from grape.perception.cloud import crop_mask, image_to_points, voxel_grid
from grape.perception.sweep import debias, range_bias, smooth_sweep
from grape.tasks.dispenser.actions.scan_vine import VineScan
from grape.tasks.dispenser.perception.deployment_pose import DeploymentPose
from grape.tasks.dispenser.perception.spurs import LIDAR_SPURS, extract_poses, merge_poses
from grape.tasks.dispenser.row import GROUND_CLEARANCE_M, row_distance
from grape.tasks.dispenser.targets import HangTarget, hang_line

OWN_HAND = (np.array([-0.13, -0.13, -0.30]), np.array([0.13, 0.13, 0.10]))  # m, corners in the hand's frame


@dataclass(frozen=True, kw_only=True)
class FindDeploymentPointsGoal:
    """What to look for.

    Attributes:
        plant: id in the site file.
        scan: what the sweep saw.
        half_width_m: the vine is trimmed to this far from its trunk along the row.
        depth_m: and to this far from the row's line.
        height_m: and to heights over the ground between these.
        pitches, azimuths: rad, hand orientations to try for each spur, best first.
        most: how many reachable poses are returned at most.
    """

    plant: str
    scan: VineScan
    half_width_m: float = 0.60
    depth_m: float = 0.36
    height_m: tuple[float, float] = (0.25, 1.3)
    pitches: tuple[float, ...] = (np.radians(55.0), np.radians(65.0))
    azimuths: tuple[float, ...] = (0.0, np.radians(25.0), np.radians(-25.0))
    most: int = 5


@dataclass(frozen=True, kw_only=True)
class FindDeploymentPointsResult:
    """Attributes: targets: reachable deployment poses, best first."""

    targets: tuple[HangTarget, ...]


@action("FindDeploymentPoints")
def find_deployment_points(
    goal: FindDeploymentPointsGoal, ctx: Context
) -> Generator[Feedback, None, FindDeploymentPointsResult]:
    """Extracts spurs from the scan, ranks them and keeps those that the hand reaches without touching the vine."""
    poses, cloud = yield from ctx.jobs.run(extract, goal, row_distance(ctx, goal.plant))
    ctx.world.committed[OBSTACLES] = Obstacles(cloud)
    ctx.ledger.remember(OBSTACLES, cloud.astype(np.float32).tobytes())
    ctx.log.event(
        "deployment_poses",
        plant=goal.plant,
        points=len(cloud),
        poses=[
            {"tip": p.tip, "direction": p.direction, "score": p.score, "diameter": p.diameter_m} for p in poses[:12]
        ],
    )
    targets: list[HangTarget] = []
    for k, found in enumerate(poses):
        yield Feedback(status="checking which spurs can be reached", progress=k / len(poses))
        target = yield from ctx.jobs.run(_reachable, goal, ctx, found)
        if target is not None:
            targets.append(target)
        if len(targets) >= goal.most:
            break
    if not targets:
        raise ActionFailed(Reason.NO_DEPLOYMENT_POINT, f"{len(poses)} spurs found on {goal.plant}, none within reach")
    return FindDeploymentPointsResult(targets=tuple(targets))


def extract(goal: FindDeploymentPointsGoal, row_y: float) -> tuple[tuple[DeploymentPose, ...], Array]:
    """Spurs of a scan in base_link, best first, and the cloud of all that was seen near the arm.

    Depth frames give the geometry: poses are extracted from each and merged. The LiDAR, its range error taken out
    against the depth frames, fills in where the camera saw nothing; it is the only source when no frame came.

    Args:
        goal: scan and limits.
        row_y: m, distance of the row's line to the left of base_link.
    """
    scan = goal.scan
    low = np.array([-2.0, row_y - goal.depth_m, goal.height_m[0] - GROUND_CLEARANCE_M])
    high = np.array([2.0, row_y + goal.depth_m, goal.height_m[1] - GROUND_CLEARANCE_M])
    frames, views = [], []
    for image, T_base_camera in zip(scan.images, scan.T_base_camera, strict=True):
        points = transform(T_base_camera, _without_hand(image_to_points(image), scan.T_hand_camera))
        frames.append(points)
        vine = points[crop_mask(points, low, high)]
        views.append(extract_poses(vine, T_base_camera[None, :3, 3]))
    camera = voxel_grid(np.vstack(frames), 0.005) if frames else np.empty((0, 3))
    sweep = smooth_sweep(scan.sweep)
    bias = range_bias(sweep, camera)
    lidar = (sweep if bias is None else debias(sweep, bias)).points
    cloud = voxel_grid(np.vstack([camera, lidar]), 0.005) if len(lidar) else camera
    if frames:
        return merge_poses(views), cloud
    vine = lidar[crop_mask(lidar, low, high)]
    return extract_poses(vine, sweep.origins[:: max(1, len(sweep.origins) // 20)], LIDAR_SPURS), cloud


def _without_hand(points: Array, T_hand_camera: Array) -> Array:
    """Points (n, 3) of the optical frame that are not the robot's own hand and fingers."""
    own = crop_mask(transform(T_hand_camera, points), *OWN_HAND)
    return points[~own]


def _reachable(goal: FindDeploymentPointsGoal, ctx: Context, found: DeploymentPose) -> HangTarget | None:
    """The spur as a target with the first hand orientation that reaches it, None when none does."""
    target = HangTarget(
        plant=goal.plant,
        kind="spur",
        tip=found.tip,
        direction=found.direction,
        pitch=goal.pitches[0],
        diameter=found.diameter_m,
        score=found.score,
    )
    for pitch in goal.pitches:
        for azimuth in goal.azimuths:
            candidate = replace(target, pitch=pitch, azimuth=azimuth)
            if find_postures(ctx, hang_line(ctx.robot, candidate, 0.10), touch=(candidate.tip, 0.12), holding=True):
                return candidate
    return None
