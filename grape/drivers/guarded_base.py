"""A base driver that lets no command through unjudged: the one place between every action and the wheels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from grape.clock import AHEAD_S, Clock
from grape.drivers.ports import BaseDriver, SensorDriver
from grape.errors import InvalidInput, StaleData
from grape.messages import Array, JointState, LaserScan, Twist
from grape.navigation.collision_monitor import (
    CollisionMonitor,
    Decision,
    MonitorState,
    Verdict,
    blind_stop,
    motion_of,
    scan_hits,
)
from grape.navigation.fence_guard import FenceGuard
from grape.trajectory.online import VelocityLimiter

FENCE, POSE = "fence", "pose"  # what may decide beside the monitor's zones


@dataclass(frozen=True, kw_only=True)
class GuardOptions:
    """Limits of a guarded base; pairs are (linear, angular) in m and rad.

    Slowing down is never delayed.

    Args:
        velocity: per s; no wheel is asked for more than the linear one. Where a command would, its turn wins.
        effective_track: m between ideal wheels that would turn the base as its own do.
        acceleration: per s^2, with which commands may pick up speed.
        gentle, jerk: per s^2 and s^3, with which they do after they were slowed down.
        max_age_s: of a scan and, where there are fences, of the pose.
        period_s: between two commands.
        control_s: a controller that changes its commands no more often than this may do so in one step.
    """

    velocity: tuple[float, float]
    effective_track: float
    acceleration: tuple[float, float]
    gentle: tuple[float, float] = (0.7, 1.6)
    jerk: tuple[float, float] = (3.0, 8.0)
    max_age_s: float = 0.3
    period_s: float = 0.01
    control_s: float = 0.05


class GuardedBase:
    """Judges each command by the newest scans and the fences, and sends on what is left of it.

    A command that nothing speaks against goes through unchanged. `send` returns what was sent, so that an action sees
    when it was slowed down.

    Args:
        base: the driver behind.
        monitor: judges commands by scans.
        fences: judges commands by the site's prohibited areas.
        scans: scanners on the base by name, and where each sits: `T_base_sensor` (4, 4).
        pose: stamp (s) and (3,) x y yaw of base_link in map; None when it is not good enough.
        on_change: told about each zone that begins to decide: zone, verdict and point (m, base_link).
    """

    def __init__(
        self,
        base: BaseDriver,
        clock: Clock,
        monitor: CollisionMonitor,
        fences: FenceGuard,
        scans: Mapping[str, tuple[SensorDriver[LaserScan], Array]],
        pose: Callable[[], tuple[float, Array] | None],
        options: GuardOptions,
        on_change: Callable[[Decision], None] = lambda decision: None,
    ) -> None:
        self._base, self._clock = base, clock
        self._monitor, self._fences, self._scans, self._pose = monitor, fences, dict(scans), pose
        self._options, self._on_change = options, on_change
        self._state = MonitorState()
        self._seen: dict[str, tuple[float, Array, float]] = {}  # per scanner: stamp, points in base_link, blind share
        self._asked: tuple[float, ...] = ()  # command and stamps of the scans that were judged last
        self._judged = blind_stop(self._state)
        self._zone = ""
        self._pace = _Pace(options)

    def send(self, linear_x: float, angular_z: float) -> Twist:
        """Set-point of the body velocity (m/s, rad/s); returns what was sent after zones, fences and limits.

        Raises:
            InvalidInput: a value is not finite.
        """
        if not (np.isfinite(linear_x) and np.isfinite(angular_z)):
            raise InvalidInput(f"base: send finite velocities, got {linear_x} m/s and {angular_z} rad/s")
        v, w = self._within(linear_x, angular_z)
        if motion_of(v, w) is None:
            self._pace.rest()
            return self._base.send(v, w)
        decision = self._decide(v, w)
        self._state = decision.state
        self._tell(decision)
        return self._base.send(*self._pace.step(v, w, decision.factor, self._clock.now()))

    def stop(self) -> None:
        """Brake now and hold."""
        self._pace.rest()
        self._base.stop()

    def latest(self, max_age_s: float | None = None) -> JointState:
        """Wheel angles and speeds from the encoders."""
        return self._base.latest(max_age_s)

    def since(self, stamp: float) -> tuple[JointState, ...]:
        """Buffered wheel states newer than `stamp`, oldest first."""
        return self._base.since(stamp)

    def _within(self, v: float, w: float) -> tuple[float, float]:
        """The command within the limits of the base and of its wheels."""
        linear, angular = self._options.velocity
        per_rad = 0.5 * self._options.effective_track  # m/s of a wheel for each rad/s
        fastest = min(angular, linear / per_rad)
        w = float(np.clip(w, -fastest, fastest))
        left = linear - per_rad * abs(w)
        return float(np.clip(v, -left, left)), w

    def _decide(self, v: float, w: float) -> Decision:
        now = self._clock.now()
        try:
            views = [self._view(name, now) for name in self._scans]
        except StaleData:
            return blind_stop(self._state)
        if any(blind > self._monitor.options.blind for _, blind in views):
            return blind_stop(self._state)
        points = np.vstack([np.empty((0, 2)), *(points for points, _ in views)])
        asked = (v, w, *(self._seen[name][0] for name in self._scans))
        if asked != self._asked or self._state.holds:  # time counts only while a zone holds
            self._asked, self._judged = asked, self._monitor.decide(v, w, points, now, self._state)
        decision = self._judged
        if self._fences.empty or decision.factor == 0.0:
            return decision
        found = self._pose()
        if found is None or now - found[0] > self._options.max_age_s:
            return Decision(verdict=Verdict.STOP, factor=0.0, zone=POSE, state=decision.state)
        factor = self._fences.factor(decision.factor * v, decision.factor * w, found[1])
        if factor == 1.0:
            return decision
        verdict = Verdict.STOP if factor == 0.0 else Verdict.SLOW
        return Decision(verdict=verdict, factor=factor * decision.factor, zone=FENCE, state=decision.state)

    def _view(self, name: str, now: float) -> tuple[Array, float]:
        """Points (n, 2) and share of blind beams of a scanner's newest scan; each scan is worked out once."""
        driver, T_base_sensor = self._scans[name]
        scan = driver.latest(self._options.max_age_s)
        if scan.stamp > now + AHEAD_S:
            raise StaleData(f"{name}: stamped {scan.stamp - now:.3f} s ahead of the clock, so its age is not known")
        known = self._seen.get(name)
        if known is None or known[0] != scan.stamp:
            known = self._seen[name] = (scan.stamp, *scan_hits(scan, T_base_sensor, self._monitor.options))
        return known[1], known[2]

    def _tell(self, decision: Decision) -> None:
        if decision.zone and decision.zone != self._zone:
            self._on_change(decision)
        self._zone = decision.zone


class _Pace:
    """How fast commands pick up speed: as fast as the base can, and gently after they were cut."""

    def __init__(self, options: GuardOptions) -> None:
        self._options = options
        velocity = np.array(options.velocity)
        self._quick = VelocityLimiter(velocity, np.array(options.acceleration), options.period_s)
        self._gentle = VelocityLimiter(velocity, np.array(options.gentle), options.period_s, np.array(options.jerk))
        self._sent = np.zeros(2)
        self._changed_s = -np.inf
        self._cut = False

    def rest(self) -> None:
        """The base stands."""
        self._sent, self._cut = np.zeros(2), False

    def step(self, v: float, w: float, factor: float, now: float) -> tuple[float, float]:
        """What to send (m/s, rad/s) of a command of which the guard has left `factor`."""
        target = factor * np.array([v, w])
        if factor < 1.0 and not self._cut:
            self._cut = True
            self._gentle.reset(self._sent)
        before = self._sent
        self._sent = self._gently(target) if self._cut else self._quickly(target, now)
        if (self._sent != before).any():
            self._changed_s = now
        if factor == 1.0 and np.abs(self._sent - target).max() < 1e-3:
            self._cut, self._sent = False, target
        return float(self._sent[0]), float(self._sent[1])

    def _gently(self, target: Array) -> Array:
        slowed = _slowed(self._sent, target)
        if (slowed != self._sent).any():
            self._gentle.reset(slowed)
        return self._gentle.step(target)

    def _quickly(self, target: Array, now: float) -> Array:
        slowed = _slowed(self._sent, target)
        step = np.array(self._options.acceleration) * min(now - self._changed_s, self._options.control_s)
        if (np.abs(target - slowed) <= step).all():
            return target
        self._quick.reset(slowed)
        return self._quick.step(target)


def _slowed(before: Array, target: Array) -> Array:
    """What may be sent at once on the way from one command (2,) to another: braking, to rest at most."""
    return np.where(before * target > 0.0, np.sign(target) * np.minimum(np.abs(target), np.abs(before)), 0.0)
