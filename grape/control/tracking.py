"""Following a trajectory with joint velocities at 100 Hz."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grape.errors import ActionFailed, InvalidInput, Reason
from grape.messages import Array
from grape.trajectory.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class TrackingOptions:
    """How closely a trajectory is followed.

    Args:
        gain: 1/s on the joint error.
        lag_s: how late the arm follows a velocity; the set-point is taken that far ahead for the feed-forward.
        error_max_rad: more than this at any joint ends the motion.
        done_rad: all joints nearer than this after the end: done.
        rest_s: how long after the end joints are put right before they may count as done.
        settle_s: how long the arm may take to settle after the end.
    """

    gain: float = 4.0
    lag_s: float = 0.0
    error_max_rad: float = 0.15
    done_rad: float = 0.01
    rest_s: float = 0.0
    settle_s: float = 1.5


@dataclass(frozen=True, kw_only=True)
class TrackingCommand:
    """Joint velocities (n,) rad/s to send, the largest joint error (rad), progress 0..1, and whether it is done."""

    velocity: Array
    error_rad: float
    progress: float
    done: bool


@dataclass(frozen=True, kw_only=True)
class TrajectoryTracker:
    """Feed-forward plus proportional correction.

    Args:
        trajectory: what to follow.
        velocity_max: (n,) rad/s.
        options: gain and thresholds.
    """

    trajectory: Trajectory
    velocity_max: Array
    options: TrackingOptions = field(default_factory=TrackingOptions)

    def __post_init__(self) -> None:
        if np.shape(self.velocity_max) != self.trajectory.start.shape:
            raise InvalidInput(
                f"velocity_max must have shape {self.trajectory.start.shape}, got {np.shape(self.velocity_max)}"
            )

    def step(self, t: float, q: Array) -> TrackingCommand:
        """The command `t` seconds after the start for measured joint angles `q` (n,) rad.

        Raises:
            ActionFailed: TRACKING_ERROR when a joint is too far off, or does not settle after the end.
        """
        options, trajectory = self.options, self.trajectory
        error = trajectory.sample(t).position - np.asarray(q, float)
        largest = float(np.abs(error).max())
        joint = int(np.abs(error).argmax()) + 1
        if not largest <= options.error_max_rad:  # NaN neither
            raise ActionFailed(Reason.TRACKING_ERROR, f"joint {joint} is {largest:.3f} rad off at {t:.2f} s")
        if t > trajectory.duration + options.settle_s and largest >= options.done_rad:
            raise ActionFailed(Reason.TRACKING_ERROR, f"joint {joint} stays {largest:.3f} rad off after the end")
        done = t >= trajectory.duration + options.rest_s and largest < options.done_rad
        velocity = trajectory.sample(t + options.lag_s).velocity + options.gain * error
        velocity = np.clip(velocity, -np.asarray(self.velocity_max), self.velocity_max)
        return TrackingCommand(
            velocity=np.zeros_like(error) if done else velocity,
            error_rad=largest,
            progress=trajectory.progress(t),
            done=done,
        )
