"""Lead the closed nails into the loop on top of the feeder, by the feeder's markers."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import follow_hand_path, straight
from grape.actions.servoing import camera_mount, servo_on_markers
from grape.control.ibvs import MarkerServo, MarkerServoOptions
from grape.geometry import inverse
from grape.messages import Array
from grape.perception.markers import MarkerDetector
from grape.tasks.dispenser.feeder import feeder_geometry, hand_at_feeder


@dataclass(frozen=True, kw_only=True)
class ServoToFeederGoal:
    """Which loop to go into, and how.

    Attributes:
        level: of the dispenser, 0 is the lowest.
        stand_off_m: height over the loop at which the first stage settles.
        timeout_s: of the servoing.
    """

    level: int
    stand_off_m: float = 0.05
    timeout_s: float = 20.0


@action("ServoToFeeder")
def servo_to_feeder(goal: ServoToFeederGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Servos on the corners of both feeder markers, or of the one that is seen, until the nails are inside the loop."""
    robot = ctx.robot
    feeder = feeder_geometry(robot)
    T_hand_camera = camera_mount(ctx)
    T_base_feeder = robot.description.feeder.T_base_link_feeder

    def desired(height: float) -> Mapping[int, Array]:
        T_camera_base = inverse(hand_at_feeder(robot, goal.level, height) @ T_hand_camera)
        return {i: T_camera_base @ T_base_feeder @ T for i, T in feeder.T_feeder_marker.items()}

    image = ctx.camera.latest()
    servo = MarkerServo(
        {i: lambda height, i=i: desired(height)[i] for i in feeder.T_feeder_marker},  # type: ignore[misc]
        feeder.marker_side_m,
        image.info.K,
        MarkerServoOptions(standoff_m=goal.stand_off_m, stop_px=0.7, stop_frames=6),
    )
    with ctx.ledger.step("insert", level=int(goal.level)), ctx.arm.lease("ServoToFeeder") as arm:
        T_now = robot.hand_pose(ctx.world.joints())
        T_near = hand_at_feeder(robot, goal.level, goal.stand_off_m + 0.03)
        duration = max(0.8, abs(T_now[2, 3] - T_near[2, 3]) / 0.08)
        yield from follow_hand_path(
            ctx, arm, straight(T_now, T_near, duration), duration, status="moving to feeder", settle=False
        )
        yield from servo_on_markers(
            ctx, arm, servo, desired, MarkerDetector(robot.description.feeder.marker_dictionary), feeder.marker_side_m,
            name="ServoToFeeder", status="servoing to feeder", timeout_s=goal.timeout_s,
        )  # fmt: skip
    return NoResult()
