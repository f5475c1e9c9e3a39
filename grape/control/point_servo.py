"""Visual servoing on one image point with depth, at constant orientation: the hand is led to a spur.

The point is kept in the base frame, so the arm's kinematics carry it on between frames and over the last centimetres,
where the depth camera sees nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import dist, hypot

import numpy as np

from grape.control.compiled import kernels
from grape.control.features import adaptive_gain
from grape.control.servo_run import FeatureWatch, ServoStage, StageGate, descent
from grape.errors import ActionFailed, InvalidInput, Reason
from grape.geometry import inverse, transform
from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class PointServoOptions:
    """Stages, gains and time-outs.

    Args:
        standoff_m: distance of the first stage.
        standoff_error_m, standoff_frames: error below which, for so many frames, the second stage begins.
        descend_speed, descend_slow_m: m/s at which the stand-off shrinks then, and where it begins to slow down.
        stop_error_m, stop_frames: error below which, for so many frames at stand-off 0, it has converged.
        gain_at_zero, gain_at_infinity, gain_slope: adaptive gain, 1/s, of the distance in m.
        orientation_gain: 1/s.
        depth_min, depth_max: m, depths outside are no measurement.
        gate_m: a point farther from the prediction than this is not believed.
        drift_m: and one farther than this from the first that was believed is not either: the point stands still in the
            base frame, and what does not is part of the hand.
        smoothing: share of a new measurement in the estimate, more for the first ones: until then it is their mean.
        trust_m: below this stand-off nothing is measured any more, since what the hand holds is too near to the point.
        blind_m: from this distance to the target on, kinematics alone may lead.
        grace_m, growth_max_m: after `grace_m` of motion the distance to the target may exceed its smallest value by
            `growth_max_m`, no more.
        fade_from_s, fade_to_s, lost_s: as in `MarkerServoOptions`.
    """

    standoff_m: float = 0.07
    standoff_error_m: float = 0.004
    standoff_frames: int = 3
    descend_speed: float = 0.03
    descend_slow_m: float = 0.02
    stop_error_m: float = 0.002
    stop_frames: int = 5
    gain_at_zero: float = 1.6
    gain_at_infinity: float = 0.8
    gain_slope: float = 20.0
    orientation_gain: float = 2.0
    depth_min: float = 0.20
    depth_max: float = 1.0
    gate_m: float = 0.03
    drift_m: float = 0.03
    smoothing: float = 0.5
    trust_m: float = 0.0
    blind_m: float = 0.06
    grace_m: float = 0.025
    growth_max_m: float = 0.02
    fade_from_s: float = 0.2
    fade_to_s: float = 0.3
    lost_s: float = 2.0


@dataclass(frozen=True, kw_only=True)
class PointServoState:
    """How a run stands after a frame.

    Attributes:
        stage: see `ServoStage`.
        error_m: distance of the point from where it should be at the present stand-off; inf before it was seen.
        standoff_m: the present stand-off.
        seen: whether the last frame gave a believed measurement.
        frames: frames that did.
    """

    stage: ServoStage = ServoStage.STAND_OFF
    error_m: float = float("inf")
    standoff_m: float = 0.0
    seen: bool = False
    frames: int = 0

    @property
    def converged(self) -> bool:
        """Whether the run is over."""
        return self.stage is ServoStage.CONVERGED


class PointServo:
    """One servo run on one point.

    Args:
        target: desired position (3,) m of the point in the optical frame as a function of the stand-off (m), for the
            orientation that is held.
        K: (3, 3) px.
        options: stages, gains and time-outs.
        p_base_point: (3,) m, first guess of the point in the base frame, such as the deployment pose; with it the first
            measurement is gated too, at `first_gate_m`.
        first_gate_m: m.
    """

    def __init__(
        self,
        target: Callable[[float], Array],
        K: Array,
        options: PointServoOptions | None = None,
        *,
        p_base_point: Array | None = None,
        first_gate_m: float = 0.10,
    ) -> None:
        if np.shape(K) != (3, 3):
            raise InvalidInput(f"K must be 3 x 3, got {np.shape(K)}")
        self.options = options or PointServoOptions()
        self.state = PointServoState(standoff_m=self.options.standoff_m)
        self._target, self._K = target, np.asarray(K, float)
        self._point = None if p_base_point is None else np.array(p_base_point, float)
        self._gate = first_gate_m
        self._anchor: Array | None = None
        self._measured_distance = float("inf")
        options = self.options
        self._watch = FeatureWatch("the point", options.fade_from_s, options.fade_to_s, options.lost_s)
        self._stage_gate = StageGate(
            standoff_limit=options.standoff_error_m,
            standoff_frames=options.standoff_frames,
            stop_limit=options.stop_error_m,
            stop_frames=options.stop_frames,
        )
        self._start: Array | None = None  # (4, 4) of the optical frame when it began
        self._least = float("inf")

    def predict(self, T_base_camera: Array) -> tuple[Array, float] | None:
        """Pixel (2,) and depth (m) at which the point should appear from a camera pose; None before any guess."""
        if self._point is None:
            return None
        x, y, z = transform(inverse(T_base_camera), self._point)
        if z <= 1e-3:
            return None
        return np.array([self._K[0, 0] * x / z + self._K[0, 2], self._K[1, 1] * y / z + self._K[1, 2]]), float(z)

    def update(self, stamp: float, pixel: Array | None, depth: float | None, T_base_camera: Array) -> PointServoState:
        """Take in one frame.

        Args:
            stamp: s, when the frame was taken; a frame not newer than the last is ignored.
            pixel: (2,) px, or None when the point was not found.
            depth: m, or None when there is none; without a valid depth the image is not used either.
            T_base_camera: (4, 4) pose of the optical frame at `stamp`, by kinematics.
        """
        if not self._watch.frame(stamp):
            return self.state
        seen = self.state.standoff_m >= self.options.trust_m and self._measure(pixel, depth, T_base_camera)
        if seen:
            self._watch.seen(stamp)
        if self._point is None or not self._watch.ever_seen:
            self.state = replace(self.state, seen=seen)
            return self.state
        p_camera = transform(inverse(T_base_camera), self._point)
        if seen:
            self._measured_distance = float(np.linalg.norm(p_camera - self._target(0.0)))
        error = float(np.linalg.norm(p_camera - self._target(self.state.standoff_m)))
        self.state = replace(self.state, error_m=error, seen=seen, frames=self.state.frames + int(seen))
        if seen or self._may_go_blind():
            self.state = replace(
                self.state, stage=self._stage_gate.after(self.state.stage, error, self.state.standoff_m)
            )
        else:
            self._stage_gate.miss()
        return self.state

    def twist(self, now: float, T_base_camera: Array) -> Array:
        """The camera's velocity to command.

        Args:
            now: s.
            T_base_camera: (4, 4) pose of the optical frame now, by kinematics.

        Returns:
            (6,) linear m/s and angular rad/s of the optical centre, along the base axes; the angular part only holds
            the orientation of the first call.

        Raises:
            ActionFailed: FEATURE_LOST, STALE_DATA or DISTANCE_GROWS.
        """
        if self._start is None:
            self._start = np.array(T_base_camera, float)
        dt = self._watch.beat(now)
        share = self._watch.share(now, blind=self._may_go_blind())
        if share == 0.0 or self._point is None or self.state.converged:
            return np.zeros(6)
        T = np.ascontiguousarray(T_base_camera, float)
        p_camera = kernels().to_camera(T, self._point)
        self._watch_distance(p_camera, float(dist(T[:3, 3], self._start[:3, 3])))
        options, error = self.options, p_camera - self._target(self.state.standoff_m)
        gain = adaptive_gain(hypot(*error), options.gain_at_zero, options.gain_at_infinity, options.gain_slope)
        v_camera = gain * error + self._descend(dt)
        return share * kernels().holding_twist(T, v_camera, self._start, options.orientation_gain)

    def _measure(self, pixel: Array | None, depth: float | None, T_base_camera: Array) -> bool:
        """Believe a measurement or not; moves the estimate of the point when it does."""
        options = self.options
        if pixel is None or depth is None or not (options.depth_min <= depth <= options.depth_max):
            return False
        x, y = (np.asarray(pixel, float) - self._K[:2, 2]) / (self._K[0, 0], self._K[1, 1])
        p_base = transform(T_base_camera, depth * np.array([x, y, 1.0]))
        if not np.isfinite(p_base).all():
            return False
        first = not self._watch.ever_seen
        if self._point is not None and np.linalg.norm(p_base - self._point) > (self._gate if first else options.gate_m):
            return False
        if self._anchor is not None and np.linalg.norm(p_base - self._anchor) > options.drift_m:
            return False
        if self._point is None or first:
            self._point = self._anchor = p_base
        else:
            share = max(options.smoothing, 1.0 / (self.state.frames + 1))
            self._point = self._point + share * (p_base - self._point)
        return True

    def _may_go_blind(self) -> bool:
        """Whether the last centimetres are reached, where kinematics alone may lead."""
        return (
            self.state.stage in (ServoStage.DESCEND, ServoStage.FINAL)
            and self._measured_distance <= self.options.standoff_m + self.options.blind_m
        )

    def _watch_distance(self, p_camera: Array, travelled: float) -> None:
        distance = dist(p_camera, self._target(0.0))
        self._least = min(self._least, distance)
        if travelled > self.options.grace_m and distance > self._least + self.options.growth_max_m:
            raise ActionFailed(
                Reason.DISTANCE_GROWS,
                f"{distance * 1e3:.0f} mm from the target after {self._least * 1e3:.0f} mm were reached",
            )

    def _descend(self, dt: float) -> Array:
        """Shrink the stand-off; returns the camera velocity (3,) that follows it, optical frame."""
        standoff = self.state.standoff_m
        speed = descent(standoff, self.options.descend_speed, self.options.descend_slow_m)
        if self.state.stage is not ServoStage.DESCEND or standoff <= 0.0 or dt <= 0.0:
            return np.zeros(3)
        shorter = max(0.0, standoff - speed * dt)
        self.state = replace(self.state, standoff_m=shorter)
        return (self._target(standoff) - self._target(shorter)) / dt
