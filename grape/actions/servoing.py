"""Visual servoing inside an action: frames in, hand velocities out, until the features are where they should be."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, Status
from grape.actions.hand_path import follow_hand_path, hand_correction, straight
from grape.actions.look_around import CAMERA, FRAME_AGE_MAX_S
from grape.actions.servo_sample import ServoSample
from grape.control.differential_ik import DifferentialIk, DifferentialIkOptions, JointVelocityCommand, shift_twist
from grape.control.ibvs import MarkerServo
from grape.control.point_servo import PointServo
from grape.drivers import ArmDriver
from grape.errors import ActionFailed, LeaseRevoked, Reason, StaleData
from grape.geometry import inverse, pose, transform
from grape.messages import Array, RgbdImage
from grape.perception.markers import MarkerDetector, corner_points, project

HALTED_S = 1.0  # a run that an obstacle or a singularity holds for so long is given up
IK = DifferentialIkOptions(clearance_slow_m=0.01, clearance_stop_m=0.0)  # the clearance has a padding of its own
Clearance = Callable[[Array], float]  # gap (m) to the nearest obstacle at joint angles (n,) rad


@dataclass(frozen=True, kw_only=True)
class ServoOutcome:
    """How a converged run ended: corner or point error in px, frames used, duration in s."""

    error_px: float
    iterations: int
    duration_s: float


def servo_on_markers(
    ctx: Context,
    arm: ArmDriver,
    servo: MarkerServo,
    desired: Callable[[float], Mapping[int, Array]],
    detector: MarkerDetector,
    marker_side_m: float,
    *,
    name: str,
    status: str,
    timeout_s: float = 25.0,
    clearance: Clearance | None = None,
) -> Generator[Feedback, None, ServoOutcome]:
    """Moves the hand until the corners of the visible markers are on their targets.

    Args:
        ctx, arm: context and leased arm.
        servo: the controller, at its start.
        desired: stand-off (m) -> `T_camera_marker` by id; for the record.
        detector, marker_side_m: how markers are found, and their side.
        name: of the action, for the record.
        status: what to tell meanwhile.
        timeout_s: the run is given up after this.
        clearance: what the hand slows down and halts before; None where nothing is in the way.

    Raises:
        ActionFailed: FEATURE_LOST, STALE_DATA, NOT_CONVERGED, UNREACHABLE (halted before a singularity) or
            IN_COLLISION (before an obstacle).
    """

    def take(image: RgbdImage, T_base_camera: Array) -> ServoSample:
        seen = {marker.id: marker.corners for marker in detector.detect(image.bgr)}
        state = servo.update(image.stamp, seen, T_base_camera)
        goals = desired(state.standoff_m)
        square = corner_points(marker_side_m)
        targets = {i: project(transform(goals[i], square), image.info.K) for i in state.visible}
        corners = {i: seen[i] for i in state.visible if i in seen}
        return ServoSample(image, state.error_px, corners, [*targets.values()], state.converged)

    loop = _Loop(ctx, arm, name=name, status=status, timeout_s=timeout_s, clearance=clearance)
    return (
        yield from loop.run(
            take,
            servo.twist,
            describe=lambda: f"{servo.state.error_px:.1f} px, {servo.state.stage}",
            measure=lambda: (servo.state.error_px, servo.state.frames),
        )
    )


def servo_on_point(
    ctx: Context,
    arm: ArmDriver,
    servo: PointServo,
    find: Callable[[RgbdImage, Array, float], tuple[Array | None, float | None]],
    target: Callable[[float], Array],
    *,
    name: str,
    status: str,
    timeout_s: float = 25.0,
    clearance: Clearance | None = None,
    calibrated: bool = False,
) -> Generator[Feedback, None, ServoOutcome]:
    """Moves the hand, at constant orientation, until one image point with depth is where it should be.

    Args:
        ctx, arm: context and leased arm.
        servo: the controller, at its start, with a first guess of the point.
        find: gets a frame, the predicted pixel (2,) and depth (m); returns pixel and depth, None where there is none.
        target: stand-off (m) -> desired point (3,) m in the optical frame; for the record.
        name, status, timeout_s, clearance: as in `servo_on_markers`.
        calibrated: poses are those of `calibrated_joints`, which carry the point on where the camera sees nothing.

    Raises:
        ActionFailed: as `servo_on_markers`, or DISTANCE_GROWS.
    """
    error_px = float("inf")

    def take(image: RgbdImage, T_base_camera: Array) -> ServoSample:
        nonlocal error_px
        guess = servo.predict(T_base_camera)
        pixel, depth = (None, None) if guess is None else find(image, *guess)
        state = servo.update(image.stamp, pixel, depth, T_base_camera)
        goal = project(target(state.standoff_m)[None], image.info.K)[0]
        after = servo.predict(T_base_camera)
        shown = pixel if state.seen else None if after is None else after[0]
        error_px = float("inf") if shown is None else float(np.linalg.norm(shown - goal))
        return ServoSample(image, error_px, {} if shown is None else {0: shown[None]}, [goal[None]], state.converged)

    loop = _Loop(ctx, arm, name=name, status=status, timeout_s=timeout_s, clearance=clearance, calibrated=calibrated)
    return (
        yield from loop.run(
            take,
            servo.twist,
            describe=lambda: f"{1e3 * servo.state.error_m:.0f} mm, {servo.state.stage}",
            measure=lambda: (error_px, servo.state.frames),
        )
    )


class _Loop:
    """The beat that both kinds of servoing share."""

    def __init__(
        self,
        ctx: Context,
        arm: ArmDriver,
        *,
        name: str,
        status: str,
        timeout_s: float,
        clearance: Clearance | None,
        calibrated: bool = False,
    ) -> None:
        self._ctx, self._arm, self._calibrated = ctx, arm, calibrated
        self._name, self._status, self._timeout_s = name, status, timeout_s
        self._solver = DifferentialIk.for_arm(ctx.robot.arm, ctx.robot.description.arm.set_point_max, IK, clearance)
        self._begin = self._free = ctx.clock.now()
        self._last: ServoSample | None = None

    def run(
        self,
        take: Callable[[RgbdImage, Array], ServoSample],
        twist: Callable[[float, Array], Array],
        describe: Callable[[], str],
        measure: Callable[[], tuple[float, int]],
    ) -> Generator[Feedback, None, ServoOutcome]:
        """Servo to the end, and write down how it ended.

        Args:
            take: gets a frame and `T_base_camera`; tells where the features are and where they should be.
            twist: (6,) of the camera at a time, in base_link.
            describe: how it stands, for a person.
            measure: error in px and frames used so far.
        """
        reason = str(Reason.INTERNAL_ERROR)
        try:
            yield from self._follow(take, twist, describe)
            reason = ""
        except ActionFailed as failed:
            reason = str(failed.reason)
            raise
        except StaleData:
            reason = str(Reason.STALE_DATA)
            raise
        except (GeneratorExit, LeaseRevoked):
            reason = str(Status.PREEMPTED)
            raise
        finally:
            outcome = self._finish(*measure(), reason)
        return outcome

    def _follow(
        self,
        take: Callable[[RgbdImage, Array], ServoSample],
        twist: Callable[[float, Array], Array],
        describe: Callable[[], str],
    ) -> Generator[Feedback, None, None]:
        ctx = self._ctx
        stamp = self._begin
        while True:
            now = ctx.clock.now()
            image = self._new_image(stamp)
            if image is not None:
                stamp = image.stamp
                self._last = take(image, self._pose(CAMERA, stamp))
                self._last.record(ctx.log, self._name)
                if self._last.converged:
                    return
            if now - self._begin > self._timeout_s:
                raise ActionFailed(Reason.NOT_CONVERGED, f"{describe()} after {self._timeout_s} s")
            T_base_camera, T_base_hand = self._pose(CAMERA), self._pose("hand")
            wish = shift_twist(twist(now, T_base_camera), T_base_camera[:3, 3], T_base_hand[:3, 3])
            command = self._solver.solve(ctx.world.joints(), wish)
            self._arm.send(command.velocity)
            self._watch_halt(command, now)
            yield Feedback(status=f"{self._status} ({describe()})")

    def _pose(self, frame: str, stamp: float | None = None) -> Array:
        """(4, 4) of a frame of the hand in base_link, the newest when no stamp is given."""
        T = self._ctx.world.frames.lookup("base_link", frame, stamp)
        return hand_correction(self._ctx) @ T if self._calibrated else T

    def _watch_halt(self, command: JointVelocityCommand, now: float) -> None:
        if not command.hindrance or command.velocity.any():
            self._free = now
        elif now - self._free > HALTED_S:
            reason = Reason.IN_COLLISION if command.hindrance == "obstacle" else Reason.UNREACHABLE
            raise ActionFailed(reason, f"halted before {command.hindrance} for {HALTED_S:.0f} s")

    def _finish(self, error_px: float, iterations: int, reason: str) -> ServoOutcome:
        outcome = ServoOutcome(error_px=error_px, iterations=iterations, duration_s=self._ctx.clock.now() - self._begin)
        self._ctx.log.event(
            "servo",
            action=self._name,
            converged=not reason,
            reason=reason,
            error_px=error_px,
            iterations=iterations,
            duration_s=outcome.duration_s,
        )
        if self._last is not None and reason != Status.PREEMPTED:
            self._ctx.log.picture(f"{self._name}_{reason}" if reason else self._name, self._last.picture())
        return outcome

    def _new_image(self, stamp: float) -> RgbdImage | None:
        try:
            image = self._ctx.camera.latest(max_age_s=FRAME_AGE_MAX_S)
        except StaleData:
            return None
        return image if image.stamp > stamp else None


def go_straight(
    ctx: Context, arm: ArmDriver, T_base_hand: Array, *, status: str, speed: float = 0.05
) -> Generator[Feedback, None, None]:
    """Moves the hand straight to a pose (4, 4), m/s on the way; unplanned, so only where it came along before."""
    T = ctx.robot.hand_pose(ctx.world.joints())
    duration = max(0.3, float(np.linalg.norm(T_base_hand[:3, 3] - T[:3, 3])) / speed)
    yield from follow_hand_path(ctx, arm, straight(T, T_base_hand, duration), duration, status=status)


def leave(ctx: Context, arm: ArmDriver, direction: Array, distance_m: float) -> Generator[Feedback, None, None]:
    """Moves the hand straight along `direction` (3,), a unit vector in base_link: back out of where servoing led it."""
    T = ctx.robot.hand_pose(ctx.world.joints())
    T_out = pose(T[:3, :3], T[:3, 3] + distance_m * np.asarray(direction))
    yield from go_straight(ctx, arm, T_out, status="leaving the target")


def hand_shift(T_base_hand: Array, T_base_expected: Array) -> Array:
    """(3,) m by which the hand ended beside where kinematics alone would have put it: what servoing corrected."""
    return T_base_hand[:3, 3] - T_base_expected[:3, 3]


def camera_mount(ctx: Context) -> Array:
    """`T_hand_camera` of the wrist camera."""
    return inverse(ctx.world.frames.lookup("base_link", "hand")) @ ctx.world.frames.lookup("base_link", CAMERA)
