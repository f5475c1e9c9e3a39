"""Dynamic window approach: the best of the circular arcs that can be reached within one period.

Source: Fox, Burgard and Thrun, The dynamic window approach to collision avoidance, IEEE Robotics and Automation
Magazine 4(1), 1997; scored along a path as ROS's base_local_planner does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array
from grape.navigation.follower import PursuitOptions
from grape.navigation.tracking import Situation, TrackingPlanner, Wish


@dataclass(frozen=True, kw_only=True)
class DwaOptions:
    """Size of the search and what counts.

    Args:
        v_samples, w_samples: number of speeds and yaw rates.
        sim_s, period: how long an arc is, s between the poses on it that are looked at.
        window_s: within how long a velocity must be reachable; the control period when None.
        least_v: m/s of the slowest arc.
        path, goal: 1/m, cost of the arc's end being away from the path and from the local goal, `goal_ahead` m on.
        heading: of the end facing away from the path.
        obstacle: of the arc's worst cost 0..1, which falls by exp(-scaling gap).
        speed: s/m, cost of being slower than wanted.
    """

    v_samples: int = 10
    w_samples: int = 41
    sim_s: float = 1.5
    period: float = 0.1
    window_s: float | None = 0.4
    least_v: float = 0.05
    path: float = 3.0
    goal: float = 1.0
    heading: float = 0.4
    obstacle: float = 0.6
    scaling: float = 12.0
    speed: float = 1.0
    goal_ahead: float = 1.2

    def __post_init__(self) -> None:
        if self.v_samples < 2 or self.w_samples < 2 or not 0 < self.period <= self.sim_s:
            raise InvalidInput(f"at least 2 samples of v and w, 0 < period <= sim_s, got {self}")


# as in the defaults of ROS 1: distances count in cells of 5 cm, so obstacles weigh little beside path and goal
CLASSIC = DwaOptions(
    v_samples=3,
    w_samples=20,
    sim_s=1.7,
    window_s=None,
    least_v=0.1,
    path=0.6,
    goal=0.8,
    heading=0.0,
    obstacle=0.01 * 252 * 0.05,
    scaling=10.0,
    speed=0.0,
    goal_ahead=3.0,
)


class Dwa(TrackingPlanner):
    """Scores every arc of the window and drives the best; it remembers nothing."""

    def __init__(self, motion: PursuitOptions | None = None, options: DwaOptions | None = None) -> None:
        super().__init__(motion)
        self.search_options = options or DwaOptions()

    def search(self, situation: Situation, memory: Array | None, steps: int) -> Wish:
        """See `TrackingPlanner.search`."""
        from grape.navigation.dwa_kernels import arc_costs

        o = self.search_options
        arcs = self._window(situation)
        weights = np.array([o.path, o.goal, o.heading, o.obstacle, o.scaling, o.speed])
        ahead = situation.ahead
        goal = min(len(ahead) - 1, int(np.searchsorted(ahead[:, 3], o.goal_ahead)))
        costs = arc_costs(
            arcs,
            round(o.sim_s / o.period),
            o.period,
            weights,
            goal,
            situation.pose,
            ahead,
            situation.field,
            situation.frame,
            situation.discs,
        )
        best = int(np.argmin(costs))
        if not np.isfinite(costs[best]):
            return Wish(v=0.0, w=0.0, blocked=True)
        return Wish(v=float(arcs[best, 0]), w=float(arcs[best, 1]))

    def _window(self, situation: Situation) -> Array:
        """(n, 2) m/s, rad/s: the reachable velocities; those on the spot come last."""
        o, motion = self.search_options, self.options
        span = o.window_s or situation.dt
        v0, w0 = situation.velocity
        high = min(float(situation.ahead[0, 4]), v0 + motion.acceleration * span)
        low = max(o.least_v, v0 - 2.0 * motion.deceleration * span)
        reach = motion.turn_acceleration * span
        w = np.linspace(max(-motion.turn_speed, w0 - reach), min(motion.turn_speed, w0 + reach), o.w_samples)
        w = np.append(w, 0.0)
        v = np.linspace(min(low, max(high, o.least_v)), max(high, o.least_v), o.v_samples)
        grid = np.stack(np.meshgrid(v, w, indexing="ij"), axis=-1).reshape(-1, 2)
        spot = np.column_stack([np.zeros(len(w)), w])
        return np.concatenate([grid, spot[np.abs(w) > 0.3]])
