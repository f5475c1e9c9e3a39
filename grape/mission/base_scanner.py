"""The laser scanner of the base that a mission's filter is helped by."""

from __future__ import annotations

from typing import Any

from grape.drivers import Drivers
from grape.errors import InvalidInput, StaleData
from grape.messages import LaserScan

OLDEST_S = 0.2  # of a scan that is still used


class BaseScanner:
    """The first scanner that is mounted on the base, read at a pace of its own.

    Args:
        description: `grape.robots.RobotDescription`.
        period_s: between two scans, at least.

    Attributes:
        T_base_scan: (4, 4), the scanner in base_link.

    Raises:
        InvalidInput: the base has none.
    """

    def __init__(self, drivers: Drivers, description: Any, period_s: float) -> None:
        mounts = {name: description.mounts[name] for name in drivers.scans if name in description.mounts}
        name = next((name for name, mount in mounts.items() if mount.parent == "base_link"), None)
        if name is None:
            raise InvalidInput(f"{description.name}: a map or laser odometry needs a laser scanner on the base")
        self.T_base_scan = mounts[name].T_parent_sensor
        self._scanner, self._period_s, self._next_s = drivers.scans[name], period_s, 0.0

    def due(self, now: float) -> LaserScan | None:
        """The newest scan; None where the last one was read too short a time ago, or none has come."""
        if now < self._next_s:
            return None
        self._next_s = now + self._period_s - 1e-6
        try:
            return self._scanner.latest(max_age_s=OLDEST_S)
        except StaleData:
            return None
