"""Looking around for features that are not in view: a small, fixed pattern of camera poses, away from everything."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback
from grape.actions.hand_path import follow_hand_path, straight
from grape.drivers import ArmDriver
from grape.errors import ActionFailed, Reason, StaleData
from grape.geometry import interpolate, inverse, pose, rotation_exp
from grape.kinematics import inverse_path
from grape.messages import Array, RgbdImage
from grape.perception.markers import MarkerDetector
from grape.planning import StateChecker

CAMERA = "camera_optical"
FRAME_AGE_MAX_S = 0.25  # an older frame does not show where the features are now
DIRECTIONS = 8  # places on the ring around the middle
STEPS = 6  # of a way at which it is checked

Seen = Callable[[RgbdImage, Array], bool]  # a frame and `T_base_camera` when it was taken -> features are in it


@dataclass(frozen=True, kw_only=True)
class LookAroundOptions:
    """How far and how fast the camera looks around.

    Args:
        back_m: first, away from what is before the hand: from farther off more is in view.
        turn_rad: then to all sides, about the camera's own centre; 0 where the orientation has to stay.
        shift_m: and so far to all sides: past what hides the feature.
        frames: that are looked at in each place.
        speed, turn_speed: mean, m/s and rad/s.
    """

    back_m: float = 0.06
    turn_rad: float = np.radians(17.0)
    shift_m: float = 0.0
    frames: int = 3
    speed: float = 0.10
    turn_speed: float = 0.5


def camera_looks(T_base_camera: Array, away: Array, options: LookAroundOptions) -> tuple[Array, ...]:
    """`T_base_camera` (4, 4) of every look: back, the ring around there, and the first pose again.

    Args:
        T_base_camera: (4, 4) where it begins.
        away: (3,) unit vector in base_link, out of what is before the hand.
        options: see `LookAroundOptions`.
    """
    T_back = pose(T_base_camera[:3, :3], T_base_camera[:3, 3] + options.back_m * np.asarray(away, float))
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    ring = [
        T_back @ pose(rotation_exp(options.turn_rad * np.array([-y, x, 0.0])), options.shift_m * np.array([x, y, 0.0]))
        for x, y in zip(np.cos(angles), np.sin(angles), strict=True)
    ]
    return T_back, *ring, T_base_camera


def look_around(
    ctx: Context,
    arm: ArmDriver,
    seen: Seen,
    *,
    name: str,
    what: str,
    away: Array,
    checker: StateChecker,
    options: LookAroundOptions | None = None,
) -> Generator[Feedback, None, None]:
    """Ends at once when the features are in view, else in the first place around from which they are.

    To be called where the hand may move freely: every way is checked before it is gone, and left out when something
    stands in it. With a silent camera it ends too: servoing tells of that.

    Args:
        ctx, arm: context and leased arm.
        seen: tells whether a frame shows the features.
        name: of the action, for the record.
        what: the features, for the error text.
        away: (3,) unit vector in base_link, out of what is before the hand.
        checker: of collisions, with all that must not be touched.
        options: see `LookAroundOptions`.

    Raises:
        ActionFailed: FEATURE_LOST, when they are in view from nowhere; the hand is then back where it began.
    """
    options, watch = options or LookAroundOptions(), _Watch(ctx, seen)
    if (yield from watch.stand(options.frames)) or watch.image is None:
        return
    begin, places = ctx.clock.now(), 0
    T_camera_hand = inverse(ctx.world.frames.lookup("base_link", CAMERA)) @ ctx.world.frames.lookup("base_link", "hand")
    for T_look in camera_looks(ctx.world.frames.lookup("base_link", CAMERA), away, options):
        T_base_hand = T_look @ T_camera_hand
        if not _is_free(ctx, T_base_hand, checker):
            continue
        places += 1
        if (yield from watch.go(arm, T_base_hand, options)) or (yield from watch.stand(options.frames)):
            break
    found = watch.found
    ctx.log.event("look_around", action=name, found=found, places=places, duration_s=ctx.clock.now() - begin)
    if not found:
        ctx.log.picture(f"{name}_{Reason.FEATURE_LOST}", watch.image.bgr)
        raise ActionFailed(Reason.FEATURE_LOST, f"{what} not in view from {places} places around the staging pose")


def marker_in_view(detector: MarkerDetector, ids: Iterable[int]) -> Seen:
    """Whether a frame shows one of some markers."""
    wanted = frozenset(ids)
    return lambda image, T_base_camera: any(marker.id in wanted for marker in detector.detect(image.bgr))


class _Watch:
    """Looks at every new frame until one shows the features."""

    def __init__(self, ctx: Context, seen: Seen) -> None:
        self._ctx, self._seen = ctx, seen
        self.image: RgbdImage | None = None
        self.found = False
        self._frames = 0

    def look(self) -> bool:
        """Takes in the newest frame; whether the features were found."""
        try:
            image = self._ctx.camera.latest(max_age_s=FRAME_AGE_MAX_S)
        except StaleData:
            return self.found
        if self.image is None or image.stamp > self.image.stamp:
            self.image, self._frames = image, self._frames + 1
            self.found = self.found or self._seen(
                image, self._ctx.world.frames.lookup("base_link", CAMERA, image.stamp)
            )
        return self.found

    def stand(self, frames: int) -> Generator[Feedback, None, bool]:
        """Stays for some frames, or as long as those would take."""
        deadline, last = self._ctx.clock.now() + 0.1 * frames, self._frames + frames
        while not self.look() and self._frames < last and self._ctx.clock.now() < deadline:
            yield Feedback(status="looking around")
        return self.found

    def go(self, arm: ArmDriver, T_base_hand: Array, options: LookAroundOptions) -> Generator[Feedback, None, bool]:
        """Moves to a pose of the hand (4, 4), as far as the features are not seen on the way."""
        T = self._ctx.robot.hand_pose(self._ctx.world.joints())
        way = float(np.linalg.norm(T_base_hand[:3, 3] - T[:3, 3]))
        turn = float(np.arccos(np.clip((np.trace(T[:3, :3].T @ T_base_hand[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
        duration = max(0.3, way / options.speed, turn / options.turn_speed)
        motion = follow_hand_path(self._ctx, arm, straight(T, T_base_hand, duration), duration, status="looking around")
        try:
            for feedback in motion:
                if self.look():
                    break
                yield feedback
        except ActionFailed:
            pass  # the arm cannot follow there: the next place is gone to from where it is
        return self.found


def _is_free(ctx: Context, T_base_hand: Array, checker: StateChecker) -> bool:
    """Whether the straight way of the hand to a pose (4, 4) is reached, and no nearer to anything than allowed.

    A start that is too near already may be left: then nothing may come nearer.
    """
    q = ctx.world.joints()
    T = ctx.robot.hand_pose(q)
    steps = np.array([ctx.robot.in_arm_base(interpolate(T, T_base_hand, k / STEPS)) for k in range(1, STEPS + 1)])
    path = inverse_path(ctx.robot.arm, steps, q)
    if path is None:
        return False
    least = min(0.0, checker.clearance(q))
    return all(checker.clearance(q) >= least for q in path)
