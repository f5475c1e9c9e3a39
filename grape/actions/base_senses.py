"""What a driving action senses: pose, scans and clouds of the sensors on the base, and what they make of the map."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import numpy as np

from grape.actions.core import Context, Feedback
from grape.actions.held_places import held_areas
from grape.actions.shortest_way import footprint_of, site_surroundings
from grape.drivers import BaseDriver
from grape.errors import ActionFailed, Reason, StaleData
from grape.frames import FrameError
from grape.geometry import planar_of
from grape.messages import Array
from grape.navigation.beams import scan_points
from grape.navigation.grid import LETHAL, Costmap
from grape.navigation.newcomers import NewcomerWatch
from grape.navigation.surroundings import Surroundings

SCAN_PERIOD_S = 0.10
CLOUD_PERIOD_S = 0.30
MAP_PERIOD_S = 0.20
MAX_AGE_S = 0.30  # of pose, scan and cloud
PATIENCE_S = 1.0  # with stale data, standing
LOST_S = 45.0  # standing until the pose is good enough again: a receiver without integer fix gets it back within 30 s


class Due:
    """Which of several things that are done in their own periods are due."""

    def __init__(self) -> None:
        self._next: dict[str, float] = {}

    def ask(self, name: str, now: float, period_s: float) -> bool:
        """Whether it is due; then it is put off by a period."""
        if now + 1e-9 < self._next.get(name, -np.inf):
            return False
        self._next[name] = now + period_s
        return True


def base_pose(ctx: Context) -> Array:
    """(3,) x y yaw of base_link in map, the newest estimate.

    Raises:
        ActionFailed: NOT_LOCALIZED, when there is none yet.
    """
    try:
        T_map_base = ctx.world.base_pose()
    except StaleData as error:
        raise ActionFailed(Reason.NOT_LOCALIZED, str(error)) from error
    return planar_of(T_map_base)


class BaseSenses:
    """Newest pose and surroundings of a driving base.

    Args:
        targets: (n, 3) x y yaw in map that the costmaps must cover.

    Attributes:
        surroundings: what is known of the site and its obstacles.
        points: (n, 2) m in base_link, hits of the newest scans.
        scan_pose: (3,) x y yaw of base_link in map when the last of them was taken.
        arrived: (n, 2) m in map, outside rows and fences, where something is that was not there a second ago.
        local: costs around the robot; None before the first `update`.
        silent: what was too old when `fresh` was asked last, pose estimate or sensor; empty when nothing was.
    """

    def __init__(self, ctx: Context, targets: Array) -> None:
        self._ctx = ctx
        self.footprint = footprint_of(ctx.robot.description.base.footprint)
        self.surroundings: Surroundings = site_surroundings(
            ctx.world.site, targets, ctx.robot.description.base, held_areas(ctx, self.footprint)
        )
        self.points, self.scan_pose = np.empty((0, 2)), np.zeros(3)
        self.arrived = np.empty((0, 2))
        self.local: Costmap | None = None
        self.silent = ""
        self._watches: dict[str, NewcomerWatch] = {}
        self._due = Due()
        self._fresh_s = ctx.clock.now()

    def pose(self) -> Array:
        """(3,) x y yaw of base_link in map, the newest estimate."""
        return base_pose(self._ctx)

    def fresh(self, now: float, *, clouds: bool = False) -> bool:
        """Whether pose and scans, and `clouds` where there are sensors of such, are young enough to move by.

        Raises:
            ActionFailed: STALE_DATA or NOT_LOCALIZED, when they stay too old.
        """
        odometry = self._ctx.world.odometry
        old = ""
        if odometry is None or now - odometry.stamp > MAX_AGE_S:
            old = "pose estimate"
        drivers = self._ctx.drivers
        sensors: dict[str, Any] = {**drivers.scans, **(drivers.clouds if clouds else {})}
        for name, driver in sensors.items():
            if self._on_base(name):
                try:
                    driver.latest(MAX_AGE_S)
                except StaleData:
                    old = name
        self.silent = old
        lost = not self._ctx.world.localized
        if not old and not lost:
            self._fresh_s = now
            return True
        if now - self._fresh_s > (LOST_S if lost else PATIENCE_S):
            if lost:
                raise ActionFailed(Reason.NOT_LOCALIZED, "the pose estimate became too uncertain to drive by")
            raise ActionFailed(Reason.STALE_DATA, f"{old} is older than {MAX_AGE_S} s")
        return False

    def update(self, force: bool = False) -> None:
        """Newest scans and clouds into the obstacle layers, and the local costmap from them, each in its period."""
        now = self._ctx.clock.now()
        if self._due.ask("scan", now, SCAN_PERIOD_S) or force:
            self._take_scans()
        if self._due.ask("cloud", now, CLOUD_PERIOD_S) or force:
            self._take_clouds()
        if self._due.ask("map", now, MAP_PERIOD_S) or force:
            self.local = self.surroundings.local(self.pose()[:2])

    def look_around(self, base: BaseDriver) -> Generator[Feedback, None, None]:
        """Stand for a few scans, so that what is in view is known.

        Raises:
            ActionFailed: STALE_DATA or NOT_LOCALIZED.
        """
        self.update(force=True)
        yield Feedback(status="looking around")
        until = self._ctx.clock.now() + 3.2 * SCAN_PERIOD_S
        while self._ctx.clock.now() < until:
            base.send(0.0, 0.0)
            self.fresh(self._ctx.clock.now())
            self.update()
            yield Feedback(status="looking around")

    def _take_scans(self) -> None:
        points, arrived = [np.empty((0, 2))], [np.empty((0, 2))]
        for name, driver in self._ctx.drivers.scans.items():
            scan = self._latest(driver) if self._on_base(name) else None
            if scan is None:
                continue
            T_base_sensor = self._ctx.robot.description.T_base_link_sensor(name)
            T_map_base = self._pose_at(scan.stamp)
            self.scan_pose = planar_of(T_map_base)
            beams = self.surroundings.add_scan(name, scan, T_map_base, T_base_sensor)
            points.append(scan_points(scan, T_base_sensor)[:, :2])
            arrived.append(self._watches.setdefault(name, NewcomerWatch()).update(scan.stamp, beams))
        self.points, self.arrived = np.vstack(points), self._outside_rows(np.vstack(arrived))

    def _outside_rows(self, points: Array) -> Array:
        """Points (n, 2) in no prohibited area: in a row, canes and weeds come into a tilted scanner's plane."""
        return points[self.surroundings.fences().cost_at(points) != LETHAL]

    def _take_clouds(self) -> None:
        for name, driver in self._ctx.drivers.clouds.items():
            cloud = self._latest(driver)
            if self._on_base(name) and cloud is not None:
                T_base_sensor = self._ctx.robot.description.T_base_link_sensor(name)
                self.surroundings.add_cloud(name, cloud, self._pose_at(cloud.stamp), T_base_sensor)

    @staticmethod
    def _latest(driver: Any) -> Any:
        """The newest message, or None when it is too old: `fresh` deals with that."""
        try:
            return driver.latest(MAX_AGE_S)
        except StaleData:
            return None

    def _on_base(self, name: str) -> bool:
        mount = self._ctx.robot.description.mounts.get(name)
        return mount is not None and mount.parent == "base_link"

    def _pose_at(self, stamp: float) -> Array:
        try:
            return self._ctx.world.frames.lookup("map", "base_link", stamp)
        except FrameError:
            return self._ctx.world.base_pose()
