"""Moving the hand along a given path in time, with the fingers moving along: the short, exact motions near contact."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback
from grape.control.approach import ApproachWatch
from grape.control.differential_ik import DifferentialIk
from grape.drivers import ArmDriver, GripperDriver
from grape.errors import ActionFailed, Reason
from grape.geometry import interpolate, inverse, pose_error
from grape.messages import Array

BEAT_S = 0.01
SLOWEST = 4.0  # times its duration a path may take
FINGERS_BEHIND_MAX = 0.2  # rad, that fingers which move along may be behind
FINGERS_AGE_MAX_S = 0.2
CABLE_SLACK = 0.1  # rad beyond its budget: a line that was planned to its very end is followed not quite exactly
JOINT_OFFSETS = "joint_offsets"  # in world.committed: (n,) rad by which the encoders tell too much, where one looked


class FingersStuck(ActionFailed):
    """Fingers that were to move along with the hand do not: where the hand goes to is meant for others."""


class HandPressed(ActionFailed):
    """The hand presses on something harder than it may on this path."""


@dataclass(frozen=True, kw_only=True)
class HandPathOptions:
    """How closely the hand must follow.

    Attributes:
        gain: 1/s on the pose error.
        tolerance_m, tolerance_rad: largest error on the way before the motion is given up.
        settle_s: time to come to rest at the end.
        calibrated: the path is meant for `calibrated_joints`.
        felt_max: share of the torques that the arm's guard allows, from which the path is given up; see `World.felt`.
        legs: s, the times at which straight parts of the path end, rising; on each the distance to its end must shrink.
    """

    gain: float = 4.0
    tolerance_m: float = 0.04
    tolerance_rad: float = 0.25
    settle_s: float = 0.2
    calibrated: bool = False
    felt_max: float = np.inf
    legs: tuple[float, ...] = ()


def smooth_step(s: float) -> float:
    """Minimum-jerk blend from 0 to 1 for s in [0, 1] (Flash and Hogan, 1985)."""
    s = min(max(s, 0.0), 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def straight(T_start: Array, T_end: Array, duration_s: float) -> Callable[[float], Array]:
    """A straight, minimum-jerk hand path of `duration_s` between two poses (4, 4)."""

    def pose_at(t: float) -> Array:
        return interpolate(T_start, T_end, smooth_step(t / duration_s) if duration_s > 0 else 1.0)

    return pose_at


def calibrated_joints(ctx: Context) -> Array:
    """Joint angles (n,) rad, less what the encoders were found to tell too much.

    They are for short motions from a place where servoing has put the hand. Motions from afar are planned with what
    the encoders tell: only what a camera sees is known to be where it is.
    """
    offsets: Array | None = ctx.world.committed.get(JOINT_OFFSETS)
    return ctx.world.joints() if offsets is None else ctx.world.joints() - offsets


def hand_correction(ctx: Context, q: Array | None = None) -> Array:
    """(4, 4) in base_link, by which a pose of the hand, as the encoders tell it, is off: `true = correction @ told`.

    Args:
        ctx: context.
        q: (n,) rad, where; now when None.
    """
    offsets: Array | None = ctx.world.committed.get(JOINT_OFFSETS)
    if offsets is None:
        return np.eye(4)
    q = ctx.world.joints() if q is None else np.asarray(q, float)
    return np.asarray(ctx.robot.hand_pose(q - offsets) @ inverse(ctx.robot.hand_pose(q)))


def follow_hand_path(
    ctx: Context,
    arm: ArmDriver,
    pose_at: Callable[[float], Array],
    duration_s: float,
    *,
    status: str,
    gripper: GripperDriver | None = None,
    fingers_at: Callable[[float], Array] | None = None,
    options: HandPathOptions | None = None,
) -> Generator[Feedback, None, Array]:
    """Moves the hand along `pose_at(t)` (`T_base_hand`, t from 0 to duration_s) and the fingers along `fingers_at(t)`.

    Differential inverse kinematics with feed-forward at 100 Hz. Where the joints cannot keep up, the path's time runs
    slower, for hand and fingers alike. At the end it waits for the hand to come to rest.

    Returns:
        (6,) the last pose error, m and rad.

    Raises:
        ActionFailed: TRACKING_ERROR when the hand falls behind by more than the tolerance, or cannot go on;
            DISTANCE_GROWS when it moves away from the end of a leg; CABLE_BUDGET when it winds a cable too far.
        HandPressed: CONTACT, when more than `felt_max` is felt.
        FingersStuck: the fingers fall behind, by what they tell; fingers that tell nothing are believed.
    """
    options = options or HandPathOptions()
    solver = DifferentialIk.for_arm(ctx.robot.arm, ctx.robot.description.arm.set_point_max)
    legs, cables = _Legs(pose_at, options.legs), _Cables(ctx)
    begin = last = ctx.clock.now()
    t, scale, arrived = 0.0, 1.0, begin  # time along the path, its present share of the clock's, when it was at its end
    while True:
        now = ctx.clock.now()
        t = min(t + scale * (now - last), duration_s)
        arrived = now if t < duration_s else arrived
        last = now
        q = calibrated_joints(ctx) if options.calibrated else ctx.world.joints()
        T_now, T_next = pose_at(t), pose_at(min(t + BEAT_S, duration_s))
        T_hand = ctx.robot.hand_pose(q)
        legs.observe(t, T_hand[:3, 3])
        cables.check(ctx.world.joints(), status)
        error = pose_error(T_now, T_hand)
        _check_tracking(error, options, status)
        if t < duration_s and now - begin > SLOWEST * duration_s:
            raise ActionFailed(
                Reason.TRACKING_ERROR, f"{status}: only {t:.1f} of {duration_s:.1f} s of the path were possible"
            )
        command = solver.solve(q, pose_error(T_next, T_now) / BEAT_S + options.gain * error)
        scale = command.scale
        arm.send(command.velocity)
        if ctx.world.felt > options.felt_max:
            told = f"{status}: the arm feels {ctx.world.felt:.2f} of what it may elsewhere, allowed are"
            raise HandPressed(Reason.CONTACT, f"{told} {options.felt_max:g}")
        if gripper is not None and fingers_at is not None:
            _check_fingers(ctx, fingers_at(t), fingers_at(0.0) != fingers_at(duration_s), status)
            gripper.send(fingers_at(min(t + BEAT_S, duration_s)))
        if t >= duration_s and now - arrived >= options.settle_s:
            return error
        yield Feedback(status=status, progress=t / duration_s if duration_s > 0 else 1.0)


class _Legs:
    """The straight parts of a path: the hand must come nearer to the end of the one it is on."""

    def __init__(self, pose_at: Callable[[float], Array], ends: Sequence[float]) -> None:
        self._ahead = [(t, pose_at(t)[:3, 3]) for t in ends]
        self._watch: ApproachWatch | None = None

    def observe(self, t: float, p: Array) -> None:
        """Look at a hand that is at `p` (3,) m at the path's time `t`; past the last end it may come to rest."""
        while self._ahead and t >= self._ahead[0][0]:
            del self._ahead[0]
            self._watch = None
        if self._ahead:
            self._watch = self._watch or ApproachWatch(p, self._ahead[0][1])
            self._watch.observe(p)


class _Cables:
    """What the cables allow from here; from beyond their budget they may be turned back, not farther."""

    def __init__(self, ctx: Context) -> None:
        q, planner = ctx.world.joints(), ctx.robot.planner
        lower, upper = planner.bounds(ctx.robot.description.arm.unwound)
        self._joints = np.flatnonzero(~(np.isfinite(planner.lower) & np.isfinite(planner.upper)))
        self._lower, self._upper = np.minimum(lower, q) - CABLE_SLACK, np.maximum(upper, q) + CABLE_SLACK

    def check(self, q: Array, status: str) -> None:
        """Refuse joint angles (n,) rad at which a cable is wound too far."""
        for k in self._joints:
            if not self._lower[k] <= q[k] <= self._upper[k]:
                detail = f"{status}: joint {k + 1} is at {q[k]:.2f} rad, its cable allows {self._lower[k]:.2f} to"
                raise ActionFailed(Reason.CABLE_BUDGET, f"{detail} {self._upper[k]:.2f}")


def _check_tracking(error: Array, options: HandPathOptions, status: str) -> None:
    distance, angle = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    if distance > options.tolerance_m or angle > options.tolerance_rad:
        raise ActionFailed(
            Reason.TRACKING_ERROR,
            f"{status}: the hand is {distance * 1e3:.0f} mm and {np.degrees(angle):.0f} deg off its path",
        )


def _check_fingers(ctx: Context, wanted: Array, moving: Array, status: str) -> None:
    told = ctx.world.gripper
    if told is None or ctx.clock.now() - told.stamp > FINGERS_AGE_MAX_S:
        return
    behind = float(np.abs(wanted - told.position)[moving].max(initial=0.0))
    if behind > FINGERS_BEHIND_MAX:
        raise FingersStuck(Reason.TRACKING_ERROR, f"{status}: the fingers are {behind:.2f} rad behind")
