"""Lead the closed nails into the loop on top of the feeder, by the feeder's markers."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.hand_path import JOINT_OFFSETS
from grape.actions.look_around import look_around, marker_in_view
from grape.actions.move_arm import checker_for
from grape.actions.servo_tries import with_retries
from grape.actions.servoing import ServoOutcome, camera_mount, go_straight, servo_on_markers
from grape.control.ibvs import MarkerServo, MarkerServoOptions
from grape.control.joint_offsets import joint_offsets
from grape.geometry import inverse
from grape.messages import Array
from grape.perception.markers import MarkerDetector
from grape.tasks.dispenser.feeder import FEEDER_BOXES, feeder_geometry, hand_at_feeder


@dataclass(frozen=True, kw_only=True)
class ServoToFeederGoal:
    """Which loop to go into, and how.

    Attributes:
        level: of the dispenser, 0 is the lowest.
        stand_off_m: height over the feeder's topmost level at which the first stage settles: from there on the hand
            goes down between the trays.
        timeout_s: of one servo run.
        tries: runs from the staging pose, the one in which this action was started.
    """

    level: int
    stand_off_m: float = 0.05
    timeout_s: float = 20.0
    tries: int = 2


@action("ServoToFeeder")
def servo_to_feeder(goal: ServoToFeederGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Servos on the corners of both feeder markers, or of the one that is seen, until the nails are inside the loop.

    Where the hand is then is known better than its joints tell: what they are off is kept for the motions that follow.
    """
    robot = ctx.robot
    feeder, described = feeder_geometry(robot), robot.description.feeder
    T_hand_camera, K = camera_mount(ctx), ctx.camera.latest().info.K
    detector = MarkerDetector(described.marker_dictionary)
    clearance = checker_for(ctx, without=FEEDER_BOXES, holding=False).clearance
    stand_off_m = (described.levels - 1 - goal.level) * described.pitch + goal.stand_off_m

    def desired(height: float) -> Mapping[int, Array]:
        T_camera_base = inverse(hand_at_feeder(robot, goal.level, height) @ T_hand_camera)
        return {i: T_camera_base @ described.T_base_link_feeder @ T for i, T in feeder.T_feeder_marker.items()}

    with ctx.ledger.step("insert", level=int(goal.level)), ctx.arm.lease("ServoToFeeder") as arm:
        T_staging = robot.hand_pose(ctx.world.joints())

        def look() -> Generator[Feedback, None, None]:
            return look_around(
                ctx, arm, marker_in_view(detector, feeder.T_feeder_marker), name="ServoToFeeder",
                what=f"markers {sorted(feeder.T_feeder_marker)}", away=np.array([0.0, 0.0, 1.0]),
                checker=checker_for(ctx),
            )  # fmt: skip

        def attempt() -> Generator[Feedback, None, ServoOutcome]:
            servo = MarkerServo(
                {i: lambda height, i=i: desired(height)[i] for i in feeder.T_feeder_marker},  # type: ignore[misc]
                feeder.marker_side_m,
                K,
                MarkerServoOptions(standoff_m=stand_off_m, standoff_px=1.5, stop_px=0.7, stop_frames=6),
            )
            return (
                yield from servo_on_markers(
                    ctx, arm, servo, desired, detector, feeder.marker_side_m,
                    name="ServoToFeeder", status="servoing to feeder", timeout_s=goal.timeout_s, clearance=clearance,
                )
            )  # fmt: skip

        def back() -> Generator[Feedback, None, None]:
            yield from go_straight(ctx, arm, T_staging, status="back above the feeder")

        yield from with_retries(ctx, goal.tries, attempt, back, look)
    T_arm_base_hand = robot.in_arm_base(hand_at_feeder(robot, goal.level, 0.0))
    offsets = joint_offsets(robot.arm, ctx.world.joints(), T_arm_base_hand)
    ctx.world.committed[JOINT_OFFSETS] = offsets
    ctx.ledger.remember(JOINT_OFFSETS, offsets.tolist())
    return NoResult()
