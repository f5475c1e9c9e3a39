"""Visual servoing inside an action: frames in, hand velocities out, until the features are where they should be."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from grape.actions.core import Context, Feedback, Status
from grape.actions.hand_path import follow_hand_path, straight
from grape.control.differential_ik import DifferentialIk, DifferentialIkOptions, JointVelocityCommand, shift_twist
from grape.control.ibvs import MarkerServo
from grape.control.point_servo import PointServo
from grape.drivers import ArmDriver
from grape.errors import ActionFailed, InvalidInput, LeaseRevoked, Reason, StaleData
from grape.geometry import inverse, pose, transform
from grape.messages import Array, RgbdImage
from grape.perception.markers import MarkerDetector, corner_points, project

R = TypeVar("R")
CAMERA = "camera_optical"
FRAME_AGE_MAX_S = 0.25  # an older frame is not servoed on: kinematics would have to carry the features on for too long
HALTED_S = 1.0  # a run that an obstacle or a singularity holds for so long is given up
IK = DifferentialIkOptions(clearance_slow_m=0.01, clearance_stop_m=0.0)  # the clearance has a padding of its own
TRY_AGAIN = (Reason.FEATURE_LOST, Reason.NOT_CONVERGED, Reason.DISTANCE_GROWS, Reason.IN_COLLISION, Reason.UNREACHABLE)
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

    def take(image: RgbdImage, T_base_camera: Array) -> bool:
        seen = {marker.id: marker.corners for marker in detector.detect(image.bgr)}
        state = servo.update(image.stamp, seen, T_base_camera)
        goals = desired(state.standoff_m)
        square = corner_points(marker_side_m)
        targets = {i: project(transform(goals[i], square), image.info.K) for i in state.visible}
        _record(ctx, name, image.stamp, state.error_px, [seen.get(i) for i in state.visible], list(targets.values()))
        return state.converged

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
) -> Generator[Feedback, None, ServoOutcome]:
    """Moves the hand, at constant orientation, until one image point with depth is where it should be.

    Args:
        ctx, arm: context and leased arm.
        servo: the controller, at its start, with a first guess of the point.
        find: gets a frame, the predicted pixel (2,) and depth (m); returns pixel and depth, None where there is none.
        target: stand-off (m) -> desired point (3,) m in the optical frame; for the record.
        name, status, timeout_s, clearance: as in `servo_on_markers`.

    Raises:
        ActionFailed: as `servo_on_markers`, or DISTANCE_GROWS.
    """
    error_px = float("inf")

    def take(image: RgbdImage, T_base_camera: Array) -> bool:
        nonlocal error_px
        guess = servo.predict(T_base_camera)
        pixel, depth = (None, None) if guess is None else find(image, *guess)
        state = servo.update(image.stamp, pixel, depth, T_base_camera)
        goal = project(target(state.standoff_m)[None], image.info.K)[0]
        after = servo.predict(T_base_camera)
        shown = pixel if pixel is not None else None if after is None else after[0]
        error_px = float("inf") if shown is None else float(np.linalg.norm(shown - goal))
        _record(ctx, name, image.stamp, error_px, [None if shown is None else shown[None]], [goal[None]])
        return state.converged

    loop = _Loop(ctx, arm, name=name, status=status, timeout_s=timeout_s, clearance=clearance)
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
        self, ctx: Context, arm: ArmDriver, *, name: str, status: str, timeout_s: float, clearance: Clearance | None
    ) -> None:
        self._ctx, self._arm = ctx, arm
        self._name, self._status, self._timeout_s = name, status, timeout_s
        self._solver = DifferentialIk.for_arm(ctx.robot.arm, ctx.robot.description.arm.velocity_max, IK, clearance)
        self._begin = self._free = ctx.clock.now()

    def run(
        self,
        take: Callable[[RgbdImage, Array], bool],
        twist: Callable[[float, Array], Array],
        describe: Callable[[], str],
        measure: Callable[[], tuple[float, int]],
    ) -> Generator[Feedback, None, ServoOutcome]:
        """Servo to the end, and write down how it ended.

        Args:
            take: gets a frame and `T_base_camera`; tells whether the features are where they should be.
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
        take: Callable[[RgbdImage, Array], bool],
        twist: Callable[[float, Array], Array],
        describe: Callable[[], str],
    ) -> Generator[Feedback, None, None]:
        ctx, frames = self._ctx, self._ctx.world.frames
        stamp = self._begin
        while True:
            now = ctx.clock.now()
            image = self._new_image(stamp)
            if image is not None:
                stamp = image.stamp
                if take(image, frames.lookup("base_link", CAMERA, stamp)):
                    ctx.log.picture(self._name, image.bgr)
                    return
            if now - self._begin > self._timeout_s:
                raise ActionFailed(Reason.NOT_CONVERGED, f"{describe()} after {self._timeout_s} s")
            T_base_camera = frames.lookup("base_link", CAMERA)
            T_base_hand = frames.lookup("base_link", "hand")
            wish = shift_twist(twist(now, T_base_camera), T_base_camera[:3, 3], T_base_hand[:3, 3])
            command = self._solver.solve(ctx.world.joints(), wish)
            self._arm.send(command.velocity)
            self._watch_halt(command, now)
            yield Feedback(status=f"{self._status} ({describe()})")

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
        return outcome

    def _new_image(self, stamp: float) -> RgbdImage | None:
        try:
            image = self._ctx.camera.latest(max_age_s=FRAME_AGE_MAX_S)
        except StaleData:
            return None
        return image if image.stamp > stamp else None


def with_retries(
    ctx: Context,
    tries: int,
    attempt: Callable[[], Generator[Feedback, None, R]],
    back: Callable[[], Generator[Feedback, None, None]],
) -> Generator[Feedback, None, R]:
    """Servo again from the staging pose when a run failed for a reason that another look may cure.

    Args:
        tries: how often in all.
        attempt: makes one run, with a controller of its own.
        back: goes from where a run failed back to the staging pose; after the last run too.

    Raises:
        ActionFailed: why the last run failed.
    """
    for left in range(tries - 1, -1, -1):
        try:
            return (yield from attempt())
        except ActionFailed as failed:
            yield from back()
            if left == 0 or failed.reason not in TRY_AGAIN:
                raise
            ctx.log.event("servo_again", reason=str(failed.reason), detail=failed.detail, left=left)
    raise InvalidInput(f"tries must be at least 1, got {tries}")


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


def _record(
    ctx: Context, name: str, stamp: float, error_px: float, seen: list[Array | None], desired: list[Array]
) -> None:
    corners = [corner for corners in seen if corners is not None for corner in corners.tolist()]
    goals = [corner for corners in desired for corner in corners.tolist()]
    ctx.log.event("servo_sample", action=name, t=stamp, error_px=error_px, corners=corners, desired=goals)
