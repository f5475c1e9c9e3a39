"""Timed elastic band: poses and the times between them, pulled tight by sparse least squares.

Source: Rösmann, Feiten, Wösch, Hoffmann and Bertram, Trajectory modification considering dynamic constraints of
autonomous robots, ROBOTIK 2012; several bands at once: Rösmann, Hoffmann and Bertram, Integrated online trajectory
planning and optimization in distinctive topologies, Robotics and Autonomous Systems 88, 2017.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array
from grape.navigation.follower import PursuitOptions
from grape.navigation.tracking import Situation, TrackingPlanner, Wish


@dataclass(frozen=True, kw_only=True)
class TebOptions:
    """Size of the band and what counts.

    Args:
        period: s between poses that is aimed at.
        iterations: of least squares on a band that was optimised before; a new one gets three times as many.
        bulges: m, how far to either side new bands go around what is on the path.
        margin: m from lethal cells from which on distance counts.
        command_s: the command is the mean velocity within this time.
        look_s: a band that touches something within this time blocks.
        nonholonomic, velocity, acceleration, time, obstacle, path, heading, backwards: weights of the residuals.
    """

    period: float = 0.25
    iterations: int = 8
    bulges: tuple[float, ...] = (0.0, 0.6, -0.6)
    margin: float = 0.15
    command_s: float = 0.3
    look_s: float = 1.5
    nonholonomic: float = 30.0
    velocity: float = 10.0
    acceleration: float = 3.0
    time: float = 1.0
    obstacle: float = 30.0
    path: float = 8.0
    heading: float = 1.0
    backwards: float = 3.0

    def __post_init__(self) -> None:
        if not self.period > 0 or self.iterations < 1 or not self.bulges:
            raise InvalidInput(f"period > 0, at least one iteration and one bulge, got {self}")


class Teb(TrackingPlanner):
    """Keeps one band and starts others beside it where it is blocked; drives its first piece."""

    def __init__(self, motion: PursuitOptions | None = None, options: TebOptions | None = None) -> None:
        super().__init__(motion)
        self.search_options = options or TebOptions()

    def search(self, situation: Situation, memory: Array | None, steps: int) -> Wish:
        """See `TrackingPlanner.search`; the memory is the band (n, 4) x, y, yaw, s to the next pose."""
        o = self.search_options
        if memory is not None:
            band, _ = self._optimised(self._moved_on(memory, situation), situation, o.iterations)
            if self._free(band, situation):
                return self._driven(band)
        found = [self._optimised(self._new(situation, bulge), situation, 3 * o.iterations) for bulge in o.bulges]
        free = [(cost, n) for n, (band, cost) in enumerate(found) if self._free(band, situation)]
        if not free:
            return Wish(v=0.0, w=0.0, blocked=True)
        return self._driven(found[min(free)[1]][0])

    def _optimised(self, band: Array, situation: Situation, iterations: int) -> tuple[Array, float]:
        from grape.navigation.teb_kernels import optimise

        o, motion = self.search_options, self.options
        limits = np.array(
            [motion.reverse_speed, motion.turn_speed, motion.acceleration, 0.8 * motion.turn_acceleration]
        )
        weights = np.array(
            [o.nonholonomic, o.velocity, o.acceleration, o.time, o.obstacle, o.margin, o.path, o.heading, o.backwards]
        )
        return optimise(
            np.ascontiguousarray(band),
            iterations,
            situation.velocity,
            limits,
            weights,
            situation.ahead,
            situation.field,
            situation.frame,
            situation.discs,
        )

    def _free(self, band: Array, situation: Situation) -> bool:
        """Whether nothing is touched soon that is not touched now."""
        from grape.navigation.teb_kernels import least_gap

        field, frame, discs = situation.field, situation.frame, situation.discs
        now = least_gap(np.vstack([band[0], band[0]]), 0.0, field, frame, discs)
        return bool(least_gap(band, self.search_options.look_s, field, frame, discs) >= min(0.0, now) - 0.02)

    def _new(self, situation: Situation, bulge: float) -> Array:
        """A band along the path ahead that goes `bulge` m to the left in its middle."""
        ahead, pose = situation.ahead, situation.pose
        share = ahead[:, 3] / ahead[-1, 3]
        off = np.hypot(*(pose[:2] - ahead[0, :2]))
        join = np.clip(1.0 - ahead[:, 3] / max(1.0, 2.0 * off), 0.0, 1.0)[:, None]
        points = ahead[:, :2] + join * (pose[:2] - ahead[0, :2])
        side = bulge * np.sin(np.pi * share)[:, None]
        points = points + side * np.column_stack([-np.sin(ahead[:, 2]), np.cos(ahead[:, 2])])
        d = np.diff(points, axis=0)
        yaw = np.append(np.arctan2(d[:, 1], d[:, 0]), ahead[-1, 2])
        yaw = np.unwrap(np.concatenate([[pose[2]], yaw[1:]]))
        times = np.append(np.hypot(*d.T) / np.maximum(ahead[:-1, 4], 0.1), 0.0)
        return self._resampled(np.column_stack([points, yaw, times]))

    def _moved_on(self, memory: Array, situation: Situation) -> Array:
        """The last band from where the robot is now to the new end of the path ahead."""
        pose, ahead = situation.pose, situation.ahead
        half = max(1, len(memory) // 2)
        first = int(np.argmin(np.hypot(*(memory[:half, :2] - pose[:2]).T)))
        direction = np.array([np.cos(memory[first, 2]), np.sin(memory[first, 2])])
        if (memory[first, :2] - pose[:2]) @ direction < 0.02:
            first += 1
        rest = memory[first:-1]
        begin = np.array([*pose, 0.0])
        begin[3] = max(0.05, situation.dt) if len(rest) == 0 else max(0.05, memory[max(first - 1, 0), 3] - situation.dt)
        end = np.array([*ahead[-1, :3], 0.0])
        band = np.vstack([begin, rest, end])
        gap = np.hypot(*(band[-1, :2] - band[-2, :2]))
        band[-2, 3] = max(0.05, gap / max(float(ahead[-1, 4]), 0.1))
        band[:, 2] = np.unwrap(band[:, 2])
        return self._resampled(band)

    def _resampled(self, band: Array) -> Array:
        """As many poses as the period asks for, evenly in time."""
        time = np.concatenate([[0.0], np.cumsum(np.maximum(band[:-1, 3], 1e-3))])
        count = int(np.clip(round(time[-1] / self.search_options.period), 3, 40))
        at = np.linspace(0.0, time[-1], count + 1)
        poses = [np.interp(at, time, band[:, k]) for k in range(3)]
        return np.column_stack([*poses, np.append(np.diff(at), 0.0)])

    def _driven(self, band: Array) -> Wish:
        """The mean velocity of the first pieces."""
        ends = np.cumsum(band[:-1, 3])
        k = min(len(band) - 1, int(np.searchsorted(ends, self.search_options.command_s)) + 1)
        d = np.diff(band[: k + 1], axis=0)
        yaw = 0.5 * (band[:k, 2] + band[1 : k + 1, 2])
        length = float((np.cos(yaw) * d[:, 0] + np.sin(yaw) * d[:, 1]).sum())
        time = float(ends[k - 1])
        return Wish(v=length / time, w=float(band[k, 2] - band[0, 2]) / time, memory=band)
