"""How much a drive slows down for raw range points in its way, whatever the costmap says.

`DriveToPose` asks it of its own commands; what holds the commands of every action is `collision_monitor`.

Source: Nav2 collision monitor, "approach" model: the footprint is moved along the commanded arc.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grape.messages import Array
from grape.navigation.grid import Footprint


@dataclass(frozen=True, kw_only=True)
class MonitorOptions:
    """Zones in time and space.

    Args:
        footprint: of the robot.
        lateral: m added at the sides; vines stand a hand's breadth beside the robot, so it is small.
        ahead: m added in front and behind: never nearer than this.
        stop_s: points met within this time stop the robot; `slow_s`: within this time they slow it down.
        least_points: fewer points than this are noise.
        least_speed: m/s at which slower driving is judged.
    """

    footprint: Footprint = field(default_factory=Footprint)
    lateral: float = 0.02
    ahead: float = 0.12
    stop_s: float = 0.6
    slow_s: float = 2.0
    least_points: int = 3
    least_speed: float = 0.25


def arc_poses(v: float, w: float, times: Array) -> Array:
    """Poses (n, 3) x y yaw, relative to now, of a body that keeps v (m/s) and w (rad/s) for the given times (s)."""
    yaw = w * times
    if abs(w) < 1e-6:
        return np.column_stack([v * times, np.zeros_like(times), yaw])
    return np.column_stack([v / w * np.sin(yaw), v / w * (1.0 - np.cos(yaw)), yaw])


def time_to_contact(v: float, w: float, points: Array, options: MonitorOptions) -> float:
    """Seconds until enough of the points (n, 2) m in base_link lie in the grown footprint; inf beyond `slow_s`.

    Points already inside it count only when the motion drives into them.
    """
    if (abs(v) < 1e-6 and abs(w) < 1e-6) or len(points) < options.least_points:
        return np.inf
    print_ = options.footprint
    zone = Footprint(
        front=print_.front + (options.ahead if v > 0 else 0.0),
        rear=print_.rear + (options.ahead if v < 0 else 0.0),
        half_width=print_.half_width + options.lateral,
    )
    near = points[np.hypot(points[:, 0], points[:, 1]) < zone.circumscribed + abs(v) * options.slow_s]
    # beside the robot nothing is driven into unless it turns
    if abs(w) < 0.02:
        near = near[(near[:, 0] * np.sign(v)) > 0.0]
    if len(near) < options.least_points:
        return np.inf
    times = np.arange(0.0, options.slow_s + 1e-9, 0.1)
    for t, (x, y, yaw) in zip(times, arc_poses(v, w, times), strict=True):
        c, s = np.cos(yaw), np.sin(yaw)
        dx, dy = near[:, 0] - x, near[:, 1] - y
        inside = zone.contains(np.column_stack([c * dx + s * dy, -s * dx + c * dy]))
        if int(inside.sum()) >= options.least_points:
            return float(t)
    return np.inf


def speed_factor(v: float, w: float, points: Array, options: MonitorOptions | None = None) -> float:
    """Factor 0..1 by which a command must be slowed: 1 when nothing is near, 0 to stop."""
    options = options or MonitorOptions()
    if 0.0 < abs(v) < options.least_speed:  # who creeps would else creep until it touches
        v, w = v * options.least_speed / abs(v), w * options.least_speed / abs(v)
    contact_s = time_to_contact(v, w, points, options)
    if contact_s <= options.stop_s:
        return 0.0
    return float(min(1.0, (contact_s - options.stop_s) / (options.slow_s - options.stop_s) + 0.2))
