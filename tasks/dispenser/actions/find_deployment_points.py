"""Find where on a scanned vine a dispenser can hang, and how the hand gets there."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, action
from grape.actions.move_arm import find_postures
from grape.actions.obstacles import OBSTACLES, UNSEEN, Obstacles, remember_obstacles
from grape.actions.rocking import up_in_base
from grape.errors import ActionFailed, Reason
from grape.geometry import transform
from grape.messages import Array
from grape.perception.cloud import crop_mask, image_to_points, voxel_grid
from grape.perception.sweep import Sweep, debias, range_bias, smooth_sweep
from grape.tasks.dispenser.actions.scan_vine import VineScan
from grape.tasks.dispenser.own_hand import without_hand
from grape.tasks.dispenser.perception.deployment_pose import DeploymentPose
from grape.tasks.dispenser.perception.depth_view import DepthView
from grape.tasks.dispenser.perception.spurs import LIDAR_SPURS, MergeOptions, extract_poses, merge_poses, rank
from grape.tasks.dispenser.perception.wires import find_wires, going_on
from grape.tasks.dispenser.row import plant_in_base
from grape.tasks.dispenser.stops import AZIMUTHS, PITCHES, SPUR_STAND_OFF_M, orientations
from grape.tasks.dispenser.targets import HangTarget, hang_line, remember_spurs
from grape.tasks.dispenser.ways import is_tight, tight_last, ways_by_ease

NEW_M = 0.03  # from the scan's points: those seen near the hand are coarse, and the LiDAR's of them off by as much
MOST_UNSEEN_M = 0.12  # of a spur beyond what was seen of it


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
    pitches: tuple[float, ...] = PITCHES
    azimuths: tuple[float, ...] = AZIMUTHS
    most: int = 5


@dataclass(frozen=True, kw_only=True)
class FindDeploymentPointsResult:
    """Attributes: targets: reachable deployment poses, best first; those at which the nails may press come last."""

    targets: tuple[HangTarget, ...]


@action("FindDeploymentPoints")
def find_deployment_points(
    goal: FindDeploymentPointsGoal, ctx: Context
) -> Generator[Feedback, None, FindDeploymentPointsResult]:
    """Extracts spurs from the scan, ranks them and keeps those that the hand reaches without touching the vine."""
    up = up_in_base(ctx)
    box = vine_box(goal, plant_in_base(ctx, goal.plant), ctx.robot.description.base.height)
    looks: list[Look] = []
    for k in range(len(goal.scan.images)):
        looks.append((yield from ctx.jobs.run(look, goal.scan, k, box)))
        yield Feedback(status="looking for spurs", progress=0.5 * (k + 1) / len(goal.scan.images))
    poses, cloud = yield from ctx.jobs.run(fuse, looks, goal.scan.sweep, box)
    cloud = np.vstack([cloud, not_in(cloud, goal.scan.near)])
    seen = ctx.world.committed[OBSTACLES] = Obstacles(cloud, up=up)
    ctx.world.committed.pop(UNSEEN, None)
    remember_obstacles(ctx, seen)
    ctx.log.event(
        "deployment_poses",
        plant=goal.plant,
        points=len(cloud),
        poses=[
            {"tip": p.tip, "direction": p.direction, "score": p.score, "diameter": p.diameter_m} for p in poses[:12]
        ],
    )
    spurs = [_target(goal, found, up) for found in poses]
    remember_spurs(ctx, spurs)
    targets: list[HangTarget] = []
    clear = 0
    for k, spur in enumerate(spurs):
        yield Feedback(status="checking which spurs can be reached", progress=0.5 + 0.5 * k / len(spurs))
        target = yield from ctx.jobs.run(_reachable, goal, ctx, spur, cloud)
        if target is not None:
            targets.append(target)
            clear += not is_tight(ctx.robot, target, cloud)
        if clear >= goal.most:
            break
    targets = tight_last(ctx.robot, targets, cloud)[: goal.most]
    if not targets:
        raise ActionFailed(Reason.NO_DEPLOYMENT_POINT, f"{len(poses)} spurs found on {goal.plant}, none within reach")
    return FindDeploymentPointsResult(targets=tuple(targets))


Box = tuple[Array, Array]  # corners (3,) m in base_link


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What one depth frame shows: its points (n, 3) m in base_link, and the spurs that lie wholly in its picture."""

    view: DepthView
    points: Array
    poses: tuple[DeploymentPose, ...]


def vine_box(goal: FindDeploymentPointsGoal, foot: Array, base_height: float) -> Box:
    """What belongs to the vine: its half of the way to its neighbours, off the ground.

    Args:
        goal: with the limits.
        foot: (2,) m or more, where the trunk stands, in base_link.
        base_height: m, of base_link over the ground.
    """
    reach = np.array([goal.half_width_m, goal.depth_m])
    low, high = (height - base_height for height in goal.height_m)
    return np.array([*(foot[:2] - reach), low]), np.array([*(foot[:2] + reach), high])


def look(scan: VineScan, k: int, box: Box) -> Look:
    """Spurs in frame `k` of a scan."""
    image, T_base_camera = scan.images[k], scan.T_base_camera[k]
    points = transform(T_base_camera, without_hand(image_to_points(image), scan.T_hand_camera, scan.holding))
    view = DepthView(image=image, T_base_camera=T_base_camera)
    poses = extract_poses(points[crop_mask(points, *box)], T_base_camera[None, :3, 3])
    return Look(view=view, points=points, poses=tuple(pose for pose in poses if view.inside(pose)))


def fuse(looks: Sequence[Look], sweep: Sweep, box: Box) -> tuple[tuple[DeploymentPose, ...], Array]:
    """Spurs of a scan in base_link, best first, and the cloud (n, 3) m of all that is known to be near the arm.

    Depth frames give the geometry: the poses of all of them are merged. The LiDAR, its range error taken out against
    the depth frames, adds spurs that lie in no frame; it is the only source when no frame came. Wires, which it alone
    sees, go on where it has not looked.
    """
    camera = voxel_grid(np.vstack([look.points for look in looks]), 0.005) if looks else np.empty((0, 3))
    sweep = smooth_sweep(sweep)
    bias = range_bias(sweep, camera)
    sweep = sweep if bias is None else debias(sweep, bias)
    cloud = voxel_grid(np.vstack([camera, sweep.points]), 0.005) if len(sweep.points) else camera
    poses = merge_poses([look.poses for look in looks], shows=[look.view.shows for look in looks])
    if not looks or bias is not None:
        more = extract_poses(sweep.points[crop_mask(sweep.points, *box)], _places(sweep), LIDAR_SPURS)
        hidden = [pose for pose in more if not any(look.view.shows(pose) for look in looks)]
        poses = rank([*poses, *hidden], MergeOptions().min_score)
    wires = going_on(find_wires(sweep.points[sweep.points[:, 2] > box[0][2]]))
    ends = [unseen_ends(pose, [look.view for look in looks]) for pose in poses if looks]
    return poses, np.vstack([cloud, wires, *ends])


def not_in(cloud: Array, points: Array) -> Array:
    """Those of points (n, 3) m that are farther than `NEW_M` from all of a cloud."""
    if not len(points) or not len(cloud):
        return points
    from scipy.spatial import cKDTree

    gaps = cKDTree(cloud).query(points, distance_upper_bound=NEW_M)[0]
    return points[np.isinf(gaps)]


def unseen_ends(pose: DeploymentPose, views: Sequence[DepthView]) -> Array:
    """(n, 3) m, where a spur may go on beyond its tip as far as no frame has looked: it was cut off by the pictures."""
    steps = np.arange(0.01, MOST_UNSEEN_M + 0.005, 0.01)
    beyond = pose.tip + steps[:, None] * pose.direction
    looked = np.any([view.looked_at(beyond) for view in views], axis=0)
    return beyond[: int(np.argmax(looked)) if looked.any() else len(beyond)]


def _places(sweep: Sweep, most: int = 20) -> Array:
    """(k, 3) some of the sensor's places; a sweep without returns has one, which does not matter."""
    return sweep.origins[:: max(1, len(sweep.origins) // most)] if len(sweep.origins) else np.zeros((1, 3))


def _target(goal: FindDeploymentPointsGoal, found: DeploymentPose, up: Array | None) -> HangTarget:
    """The spur as a target with the first hand orientation."""
    return HangTarget(
        plant=goal.plant,
        kind="spur",
        tip=found.tip,
        direction=found.direction,
        pitch=goal.pitches[0],
        azimuth=goal.azimuths[0],
        diameter=found.diameter_m,
        score=found.score,
        up=up,
    )


def _reachable(goal: FindDeploymentPointsGoal, ctx: Context, spur: HangTarget, cloud: Array) -> HangTarget | None:
    """The target with the best orientation of the hand that touches nothing, None when there is none."""
    for way in ways_by_ease(ctx.robot, orientations(spur, goal.pitches, goal.azimuths), cloud):
        if find_postures(ctx, hang_line(ctx.robot, way, SPUR_STAND_OFF_M), touch=way.touched(), holding=True):
            return way
    return None
