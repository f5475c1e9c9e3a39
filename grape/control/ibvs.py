"""Image-based visual servoing on marker corners, in two stages: a stand-off first, then in.

Source: Chaumette and Hutchinson, Visual servo control, part I, 2006; adaptive gain as in ViSP.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import exp

import numpy as np

from grape.control.compiled import kernels
from grape.control.features import (
    adaptive_gain,
    marker_corners,
    normalise,
    project,
    square_depths,
    view_velocity,
)
from grape.control.servo_run import FeatureWatch, ServoStage, StageGate, descent
from grape.errors import InvalidInput
from grape.geometry import transform
from grape.messages import Array

DesiredView = Callable[[float], Array]  # stand-off (m) -> T_camera_marker (4, 4) to be seen there


@dataclass(frozen=True, kw_only=True)
class MarkerServoOptions:
    """Stages, gains and time-outs.

    Args:
        standoff_m: distance of the first stage (0.05 at the feeder, 0.08 at the nail).
        standoff_px, standoff_frames: corner error below which, for so many frames, the second stage begins.
        descend_speed, descend_slow_m: m/s at which the stand-off shrinks then, and where it begins to slow down.
        descend_px: corner error from which on the stand-off waits.
        stop_px, stop_frames: corner error below which, for so many frames at stand-off 0, it has converged
            (0.5 px with two markers on the nail).
        gain_at_zero, gain_at_infinity, gain_slope: adaptive gain, 1/s.
        smoothing: share of a new frame in the corners that the motion follows; kinematics carry them on in between, so
            this costs no lag. The error and the stages use the raw frames.
        switch_rate: 1/s at which the jump of a change of markers fades.
        fade_from_s, fade_to_s: age of the last seen marker between which the motion fades to zero.
        lost_s: age at which the run is given up.
    """

    standoff_m: float = 0.05
    standoff_px: float = 2.0
    standoff_frames: int = 4
    descend_speed: float = 0.05
    descend_slow_m: float = 0.05
    descend_px: float = 6.0
    stop_px: float = 0.4
    stop_frames: int = 8
    gain_at_zero: float = 1.6
    gain_at_infinity: float = 0.8
    gain_slope: float = 20.0
    smoothing: float = 0.4
    switch_rate: float = 6.0
    fade_from_s: float = 0.2
    fade_to_s: float = 0.3
    lost_s: float = 2.0

    def __post_init__(self) -> None:
        if not (self.standoff_m >= 0 and 0 < self.fade_from_s < self.fade_to_s <= self.lost_s):
            raise InvalidInput(
                "standoff_m >= 0 and 0 < fade_from_s < fade_to_s <= lost_s must hold, got "
                f"{self.standoff_m}, {self.fade_from_s}, {self.fade_to_s}, {self.lost_s}"
            )


@dataclass(frozen=True, kw_only=True)
class ServoState:
    """How a servo run stands after a frame.

    Attributes:
        stage: see `ServoStage`.
        error_px: root mean square distance of the corners from where they should be; inf before any was seen.
        standoff_m: the present stand-off.
        visible: ids of the markers in use.
        frames: frames with at least one marker.
    """

    stage: ServoStage = ServoStage.STAND_OFF
    error_px: float = float("inf")
    standoff_m: float = 0.0
    visible: tuple[int, ...] = ()
    frames: int = 0

    @property
    def converged(self) -> bool:
        """Whether the run is over."""
        return self.stage is ServoStage.CONVERGED


class MarkerServo:
    """One servo run on any subset of known markers.

    Between frames the corners are carried on by the arm's kinematics, so a late frame costs little; the frames alone
    decide the error and the stages.

    Args:
        targets: for each marker id, its desired pose `T_camera_marker` as a function of the stand-off (m).
        marker_side: m.
        K: (3, 3) px.
        options: stages, gains and time-outs.
    """

    def __init__(
        self,
        targets: Mapping[int, DesiredView],
        marker_side: float,
        K: Array,
        options: MarkerServoOptions | None = None,
    ) -> None:
        if not targets or not marker_side > 0 or np.shape(K) != (3, 3):
            raise InvalidInput(f"needs a target, a side > 0 and a 3 x 3 K, got {targets}, {marker_side}, {np.shape(K)}")
        self.options = options or MarkerServoOptions()
        self.state = ServoState(standoff_m=self.options.standoff_m)
        self._targets, self._side, self._K = dict(targets), marker_side, np.asarray(K, float)
        self._square = marker_corners(marker_side)
        self._corners: dict[int, Array] = {}  # (4, 3) m in the base frame, markers of the last frame that had any
        self._standoffs: deque[tuple[float, float]] = deque(maxlen=100)  # (time, stand-off)
        options = self.options
        self._watch = FeatureWatch(f"markers {sorted(targets)}", options.fade_from_s, options.fade_to_s, options.lost_s)
        self._gate = StageGate(
            standoff_limit=options.standoff_px,
            standoff_frames=options.standoff_frames,
            stop_limit=options.stop_px,
            stop_frames=options.stop_frames,
        )
        self._command, self._jump, self._jump_time = np.zeros(6), np.zeros(6), -np.inf
        self._markers_changed = True

    def update(self, stamp: float, markers: Mapping[int, Array], T_base_camera: Array) -> ServoState:
        """Take in one frame.

        Args:
            stamp: s, when the frame was taken; a frame not newer than the last is ignored.
            markers: detected corners (4, 2) px by id, in the order of OpenCV; unknown ids are ignored.
            T_base_camera: (4, 4) pose of the optical frame at `stamp`, by kinematics.

        Returns:
            The state after it.
        """
        if not self._watch.frame(stamp):
            return self.state
        seen = {i: np.asarray(corners, float) for i, corners in markers.items() if i in self._targets}
        if not seen:
            self._gate.miss()
            return self.state
        self._watch.seen(stamp)
        visible = tuple(sorted(seen))
        self._markers_changed |= visible != tuple(sorted(self._corners))
        before, errors = self._corners, []
        self._corners = {}
        standoff = self._standoff_at(stamp)
        for i in visible:
            xy = normalise(seen[i].reshape(4, 2), self._K)
            rays = np.column_stack([xy, np.ones(4)])
            corners = transform(T_base_camera, square_depths(xy, self._side)[:, None] * rays)
            if i in before:
                corners = before[i] + self.options.smoothing * (corners - before[i])
            self._corners[i] = corners
            errors.append(xy - project(transform(self._targets[i](standoff), self._square)))
        error_px = float(np.sqrt((np.concatenate(errors) ** 2).sum(axis=1).mean()) * self._K[0, 0])
        stage = self._gate.after(self.state.stage, error_px, self.state.standoff_m)
        self.state = replace(self.state, stage=stage, error_px=error_px, visible=visible, frames=self.state.frames + 1)
        return self.state

    def twist(self, now: float, T_base_camera: Array) -> Array:
        """The camera's velocity to command.

        Args:
            now: s.
            T_base_camera: (4, 4) pose of the optical frame now, by kinematics.

        Returns:
            (6,) linear m/s and angular rad/s of the optical centre, along the base axes.

        Raises:
            ActionFailed: FEATURE_LOST when no marker, or STALE_DATA when no frame came for too long.
        """
        dt = self._watch.beat(now)
        share = self._watch.share(now)
        if share == 0.0 or self.state.converged:
            self._command, self._markers_changed = np.zeros(6), True
            self._remember(now)
            return self._command.copy()
        speed = self._descend(dt, share)
        self._remember(now)
        wish = self._servo_twist(T_base_camera, speed)
        if self._markers_changed:  # start from what was commanded last and let the difference fade
            self._jump, self._jump_time, self._markers_changed = self._command - wish, now, False
        self._command = share * (wish + self._jump * exp(-self.options.switch_rate * (now - self._jump_time)))
        return self._command.copy()

    def _servo_twist(self, T_base_camera: Array, speed: float) -> Array:
        """-gain L^+ (s - s*) plus the motion of s*, turned into the base axes."""
        standoff, options = self.state.standoff_m, self.options
        corners = np.concatenate(list(self._corners.values()))
        views = np.array([self._targets[i](standoff) for i in self._corners])
        twist, error = kernels().feature_twist(np.ascontiguousarray(T_base_camera), corners, views, self._square)
        twist *= adaptive_gain(error, options.gain_at_zero, options.gain_at_infinity, options.gain_slope)
        if speed > 0.0:
            v_camera = view_velocity(self._targets[next(iter(self._corners))], standoff, speed)
            R = T_base_camera[:3, :3]
            twist += np.concatenate([R @ v_camera[:3], R @ v_camera[3:]])
        return twist

    def _descend(self, dt: float, share: float) -> float:
        """Shrink the stand-off; returns its speed (m/s)."""
        options, standoff = self.options, self.state.standoff_m
        if self.state.stage is not ServoStage.DESCEND or self.state.error_px >= options.descend_px or share < 1.0:
            return 0.0
        speed = descent(standoff, options.descend_speed, options.descend_slow_m)
        self.state = replace(self.state, standoff_m=max(0.0, standoff - speed * dt))
        return speed

    def _remember(self, now: float) -> None:
        self._standoffs.append((now, self.state.standoff_m))

    def _standoff_at(self, stamp: float) -> float:
        """The stand-off that was asked for when a frame was taken."""
        if not self._standoffs:
            return self.state.standoff_m
        times, values = zip(*self._standoffs, strict=True)
        return float(np.interp(stamp, times, values))
