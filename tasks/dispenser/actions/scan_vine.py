"""Sweep the wrist LiDAR and the depth camera along a vine."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from grape.actions.core import Context, Feedback, action
from grape.actions.hand_path import HandPathOptions, follow_hand_path, straight
from grape.actions.move_arm import move_to_pose
from grape.actions.servoing import camera_mount
from grape.drivers import ArmDriver
from grape.errors import ActionFailed, Reason, StaleData
from grape.geometry import interpolate, pose, pose_error, rotation_x, rotation_z, transform
from grape.messages import Array, LaserScan, RgbdImage
from grape.perception.cloud import DepthOptions, image_to_points
from grape.perception.sweep import AssembleOptions, Sweep, assemble
from grape.tasks.dispenser.row import ROW, expect_row, row_distance
from grape.tasks.dispenser.scan_views import remember_views
from grape.tasks.dispenser.sweep_guard import TIGHT_M, SweepGuard

WRIST_LIDAR = "wrist_lidar"
NEAREST_M = 0.22  # of the hand to the arm's base, across the row: nearer there is no arm posture
TURN_RATE = 0.3  # rad/s, between the passes
NEAR = DepthOptions(range_m=(0.2, 0.6), step=3)  # what may be in the hand's way
NEAR_RETURN_M = 0.22  # of the wrist LiDAR
LOOK_PERIOD_S, IMAGE_PERIOD_S = 0.1, 0.2  # between looks, and between pictures: they cost more
AHEAD_S, SAMPLE_S = 1.5, 0.15  # of the path that must be free; between its samples
UP_S = 0.5  # to begin and end a way up
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
    speed: float = 0.105
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

    `holding` tells whether a dispenser was in the hand, and so in the pictures. `near` (n, 3) m is what was seen near
    the hand on the way, also what was too near for the frames, or between them.
    """

    sweep: Sweep
    images: tuple[RgbdImage, ...]
    T_base_camera: tuple[Array, ...]
    T_hand_camera: Array
    holding: bool = False
    near: Array = field(default_factory=lambda: np.empty((0, 3)))


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
            ctx, arm, path.poses, either_end=True, status="moving to the scan", touch_boxes=(ROW,), limit_rad=0.0
        )  # with one joint held the sweep is not quite straight, which does no harm
        path = path if begin == 0 else path.backwards()
        collector = _Collector(ctx, goal.images)
        near = yield from _sweep(ctx, arm, goal, path, collector)
    scan = collector.scan(near)
    ctx.log.event("scan", plant=goal.plant, returns=len(scan.sweep.points), images=len(scan.images))
    if len(scan.sweep.points) == 0 and not scan.images:
        raise ActionFailed(Reason.STALE_DATA, "neither LiDAR nor camera gave anything during the sweep")
    return ScanVineResult(scan=scan)


def _sweep(
    ctx: Context, arm: ArmDriver, goal: ScanVineGoal, path: SweepPath, collector: _Collector
) -> Generator[Feedback, None, Array]:
    """Follows the path. Where wood is ahead of the hand it passes over it, or turns back there where it cannot.

    Returns:
        (n, 3) m in base_link, what was seen near the hand.
    """
    lookout = _Lookout(ctx)
    guard = lookout.guard
    start, lift, done = 0.0, 0.0, 0.0
    while (stop := (yield from _until_wood(ctx, arm, path, start, lift, done, collector, lookout))) is not None:
        leg_end = next((t for t in path.times if t > stop), stop)
        higher = guard.lift(path.samples(stop, min(max(leg_end, stop + AHEAD_S), path.times[-1])), lift)
        ctx.log.event("sweep_hindered", plant=goal.plant, at=path.at(stop)[:3, 3], lift_m=higher)
        if higher is None:
            back = path.turned_back(stop)
            if back is None:
                break
            done += (1.0 - done) * stop / path.times[-1]
            path, start = back, 0.0
        else:
            duration_s = UP_S + (higher - lift) / goal.speed
            up = straight(raised(path.at(stop), lift), raised(path.at(stop), higher), duration_s)
            yield from follow_hand_path(ctx, arm, up, duration_s, status="passing over wood")
            start, lift = stop, higher
    return guard.seen


def _until_wood(
    ctx: Context,
    arm: ArmDriver,
    path: SweepPath,
    start: float,
    lift: float,
    done: float,
    collector: _Collector,
    lookout: _Lookout,
) -> Generator[Feedback, None, float | None]:
    """Follows a path from a time of it on until something is ahead of the hand.

    Args:
        ctx: for camera, account and clock.
        arm: that is leased.
        path: of the hand.
        start: s, from where on.
        lift: m, by which the hand is higher than the path.
        done: share of the whole sweep that lies before the path.
        collector: gets what the sensors see.
        lookout: tells whether something is in the way.

    Returns:
        The path's time at which something is ahead, or None at its end.
    """
    end = path.times[-1]
    options = HandPathOptions(legs=tuple(t - start for t in path.times if t > start))
    motion = follow_hand_path(
        ctx, arm, lambda t: raised(path.at(start + t), lift), end - start, status="scanning", options=options
    )
    for feedback in motion:
        t = start + (feedback.progress or 0.0) * (end - start)
        progress = done + (1.0 - done) * t / end
        collector.collect(progress)
        if lookout.look() and lookout.guard.clearance(path.samples(t, min(t + AHEAD_S, end)), lift) < TIGHT_M:
            motion.close()
            return t
        yield replace(feedback, progress=progress)
    return None


class _Lookout:
    """Shows its guard what the sensors see near the hand.

    The camera measures from 0.2 m on. What is nearer the LiDAR sees, whose plane is 0.1 m ahead of the hand in the
    first pass; farther off its range error would take for wood in the way what is beside it.
    """

    def __init__(self, ctx: Context) -> None:
        holding = ctx.ledger.dispensers().get("hand", 0) > 0
        self.guard = SweepGuard(ctx.robot.loaded_body if holding else ctx.robot.body, holding)
        self._ctx = ctx
        self._T_hand_camera = camera_mount(ctx)
        self._T_hand_lidar = ctx.robot.description.mounts[WRIST_LIDAR].T_parent_sensor
        self._scanned = self._next_look = self._next_image = ctx.clock.now()

    def look(self) -> bool:
        """Whether it was time for another look."""
        now = self._ctx.clock.now()
        if now < self._next_look:
            return False
        self._next_look = now + LOOK_PERIOD_S
        for scan in self._ctx.drivers.scans[WRIST_LIDAR].since(self._scanned):
            self.guard.add(transform(self._T_hand_lidar, near_returns(scan)), self._hand(scan.stamp))
            self._scanned = scan.stamp
        if now >= self._next_image:
            self._next_image = now + IMAGE_PERIOD_S
            try:
                image = self._ctx.camera.latest(max_age_s=0.3)
            except StaleData:
                return True  # the LiDAR goes on
            self.guard.add(transform(self._T_hand_camera, image_to_points(image, NEAR)), self._hand(image.stamp))
        return True

    def _hand(self, stamp: float) -> Array:
        return self._ctx.world.frames.lookup("base_link", "hand", stamp)


def near_returns(scan: LaserScan) -> Array:
    """(n, 3) m in the scanner's frame, of what is nearer than the depth camera measures."""
    near = np.flatnonzero((scan.ranges >= scan.range_min) & (scan.ranges < NEAR_RETURN_M))
    angles, ranges = scan.angle_min + scan.angle_increment * near, scan.ranges[near]
    return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros_like(ranges)])


def raised(T: Array, lift_m: float) -> Array:
    """A pose (4, 4) in base_link, moved straight up."""
    return pose(T[:3, :3], T[:3, 3] + [0.0, 0.0, lift_m])


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

    def samples(self, start: float, end: float) -> Array:
        """(n, 4, 4) `T_base_hand` between two times, at most `SAMPLE_S` apart."""
        return np.array([self.at(t) for t in np.linspace(start, end, int((end - start) / SAMPLE_S) + 2)])

    def turned_back(self, t: float) -> SweepPath | None:
        """From where it is at a time of its first pass to there on its way back, and on; None without a way back."""
        if len(self.poses) < 4 or not 0.0 < t < self.times[1]:
            return None
        share, turn_s = t / self.times[1], self.times[2] - self.times[1]
        there = interpolate(self.poses[2], self.poses[3], 1.0 - share)
        back_s = share * (self.times[3] - self.times[2])
        return SweepPath(poses=(self.at(t), there, self.poses[3]), times=(0.0, turn_s, turn_s + back_s))

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

    def scan(self, near: Array) -> VineScan:
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
            near=near,
        )
