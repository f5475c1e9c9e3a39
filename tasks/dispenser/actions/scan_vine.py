"""Sweep the wrist LiDAR and the depth camera along a vine."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from grape.actions.core import Context, Feedback, action
from grape.actions.hand_path import HandPathOptions, follow_hand_path
from grape.actions.move_arm import move_to_pose
from grape.actions.servoing import camera_mount
from grape.errors import ActionFailed, Reason, StaleData
from grape.geometry import interpolate, pose, pose_error, rotation_x, rotation_z
from grape.messages import Array, LaserScan, RgbdImage
from grape.perception.sweep import AssembleOptions, Sweep, assemble
from grape.tasks.dispenser.row import ROW, expect_row, row_distance
from grape.tasks.dispenser.scan_views import remember_views

WRIST_LIDAR = "wrist_lidar"
NEAREST_M = 0.22  # of the hand to the arm's base, across the row: nearer there is no arm posture
TURN_RATE = 0.3  # rad/s, between the passes
SWEEP = AssembleOptions(range_m=(0.30, 1.2), bearing_rad=(-1.3, 1.3))


@dataclass(frozen=True, kw_only=True)
class ScanVineGoal:
    """What to scan and how.

    Attributes:
        plant: id in the site file.
        half_length_m: the sweep goes this far to both sides of the arm's base, along the robot's x.
        speed: m/s of the hand (0.12 at most; the vine gets a scan every few millimetres).
        pitch: rad, hand tilted from pointing down towards the row; it is rolled so that the camera looks over it.
        stand_off_m: of the hand's origin from the row's line.
        height_m: of the hand over the arm's base.
        return_pitch, return_stand_off_m, return_height_m: the same for the way back, which looks down into the vine, at
            low and near wood that is under the first pictures. Pitch 0: there is no way back.
        images: depth frames kept along the sweep.
    """

    plant: str
    half_length_m: float = 0.34
    speed: float = 0.10
    pitch: float = np.radians(80.0)
    stand_off_m: float = 0.44
    height_m: float = 0.40
    return_pitch: float = np.radians(60.0)
    return_stand_off_m: float = 0.48
    return_height_m: float = 0.35
    images: int = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class VineScan:
    """What a sweep saw, in base_link: LiDAR returns, and depth frames with the camera's poses and its mount.

    `holding` tells whether a dispenser was in the hand, and so in the pictures.
    """

    sweep: Sweep
    images: tuple[RgbdImage, ...]
    T_base_camera: tuple[Array, ...]
    T_hand_camera: Array
    holding: bool = False


@dataclass(frozen=True, kw_only=True)
class ScanVineResult:
    """Attributes: scan: what the sweep saw."""

    scan: VineScan


@action("ScanVine")
def scan_vine(goal: ScanVineGoal, ctx: Context) -> Generator[Feedback, None, ScanVineResult]:
    """Moves the wrist along the vine in a straight line at constant orientation and keeps LiDAR scans and frames."""
    path = sweep_path(goal, ctx.robot.description.arm.T_base_link_arm_base, row_distance(ctx, goal.plant))
    expect_row(ctx, goal.plant)
    with ctx.arm.lease("ScanVine") as arm, ctx.gripper.lease("ScanVine") as gripper:
        if not ctx.ledger.dispensers().get("hand", 0):  # open fingers keep a dispenser
            closed = ctx.robot.description.gripper.closed_angle
            gripper.send(np.array([ctx.robot.description.gripper.thumb_clear, closed, closed]))
        begin = yield from move_to_pose(
            ctx, arm, path.poses, either_end=True, status="moving to the scan", touch_boxes=(ROW,)
        )
        path = path if begin == 0 else path.backwards()
        collector = _Collector(ctx, goal.images)
        options = HandPathOptions(legs=path.times[1:])
        motion = follow_hand_path(ctx, arm, path.at, path.times[-1], status="scanning", options=options)
        try:
            while True:
                feedback = next(motion)
                collector.collect(feedback.progress or 0.0)
                yield feedback
        except StopIteration:
            pass
    scan = collector.scan()
    ctx.log.event("scan", plant=goal.plant, returns=len(scan.sweep.points), images=len(scan.images))
    if len(scan.sweep.points) == 0 and not scan.images:
        raise ActionFailed(Reason.STALE_DATA, "neither LiDAR nor camera gave anything during the sweep")
    return ScanVineResult(scan=scan)


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepPath:
    """The hand's way along a vine: straight between poses (4, 4) in base_link that it passes at times (s)."""

    poses: tuple[Array, ...]
    times: tuple[float, ...]

    def at(self, t: float) -> Array:
        """`T_base_hand` at a time from the start."""
        k = int(np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2))
        share = (t - self.times[k]) / (self.times[k + 1] - self.times[k])
        return interpolate(self.poses[k], self.poses[k + 1], float(np.clip(share, 0.0, 1.0)))

    def backwards(self) -> SweepPath:
        """The same way from its end."""
        return SweepPath(
            poses=tuple(reversed(self.poses)), times=tuple(self.times[-1] - t for t in reversed(self.times))
        )


def sweep_path(goal: ScanVineGoal, T_base_arm: Array, row_y: float) -> SweepPath:
    """The hand's way of a scan.

    Args:
        goal: how to scan.
        T_base_arm: pose of the arm's base in base_link.
        row_y: m, how far left of base_link the row's line runs.
    """
    x, y, z = T_base_arm[:3, 3]
    passes = [(1, goal.pitch, goal.stand_off_m, goal.height_m)]
    if goal.return_pitch > 0:
        passes.append((-1, goal.return_pitch, goal.return_stand_off_m, goal.return_height_m))
    poses = [
        pose(
            rotation_x(pitch) @ rotation_z(np.pi),
            (x + side * way * goal.half_length_m, max(row_y - stand_off, y + NEAREST_M), z + height),
        )
        for way, pitch, stand_off, height in passes
        for side in (-1, 1)
    ]
    steps = [
        max(np.linalg.norm(error[:3]) / goal.speed, np.linalg.norm(error[3:]) / TURN_RATE)
        for error in (pose_error(b, a) for a, b in pairwise(poses))
    ]
    return SweepPath(poses=tuple(poses), times=(0.0, *(float(t) for t in np.cumsum(steps))))


class _Collector:
    """Gathers LiDAR scans and a few camera frames while the hand moves."""

    def __init__(self, ctx: Context, images: int) -> None:
        self._ctx = ctx
        self._wanted = images
        self._scans: list[LaserScan] = []
        self._images: list[RgbdImage] = []
        self._joints: list[Array] = []
        self._newest = ctx.clock.now()
        self._next_scan_read = 0.0

    def collect(self, progress: float) -> None:
        """Takes what is new; `progress` 0..1 of the sweep."""
        if progress * 20 >= self._next_scan_read:
            self._next_scan_read += 1
            self._read_scans()
        if len(self._images) < self._wanted and progress * (self._wanted - 1) >= len(self._images):
            try:
                image = self._ctx.camera.latest(max_age_s=0.3)
            except StaleData:
                return
            if not self._images or image.stamp > self._images[-1].stamp:
                self._images.append(image)
                self._joints.append(self._ctx.world.joints())

    def _read_scans(self) -> None:
        new = self._ctx.drivers.scans[WRIST_LIDAR].since(self._newest)
        if new:
            self._scans.extend(new)
            self._newest = new[-1].stamp

    def scan(self) -> VineScan:
        """Everything gathered, placed in base_link through stamped transforms."""
        self._read_scans()
        frames = self._ctx.world.frames
        stamped = [frames.lookup("base_link", WRIST_LIDAR, scan.stamp) for scan in self._scans]
        now = self._ctx.clock.now()  # the last scan may end later: the hand rests by then
        ends = [frames.lookup("base_link", WRIST_LIDAR, min(s.stamp + s.scan_time, now)) for s in self._scans]
        sweep = assemble(self._scans, stamped, SWEEP, T_map_lidar_end=ends)
        cameras = tuple(frames.lookup("base_link", "camera_optical", image.stamp) for image in self._images)
        remember_views(self._ctx, cameras, self._joints)
        return VineScan(
            sweep=sweep,
            images=tuple(self._images),
            T_base_camera=cameras,
            T_hand_camera=camera_mount(self._ctx),
            holding=self._ctx.ledger.dispensers().get("hand", 0) > 0,
        )
