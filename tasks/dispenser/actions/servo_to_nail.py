"""Lead the held loop over a nail, by the markers beside it."""

from __future__ import annotations

from collections.abc import Generator, Mapping

from grape.actions.core import Context, Feedback, action
from grape.actions.look_around import look_around, marker_in_view
from grape.actions.move_arm import checker_for
from grape.actions.servoing import ServoOutcome, camera_mount, servo_on_markers
from grape.control.ibvs import MarkerServo, MarkerServoOptions
from grape.messages import Array
from grape.perception.markers import MarkerDetector
from grape.tasks.dispenser.nail_board import MARKER_DICTIONARY, MARKER_SIDE_M, NailBoard, desired_markers
from grape.tasks.dispenser.row import ROW
from grape.tasks.dispenser.servo_target import ServoToTargetGoal, ServoToTargetResult, servo_to_target


@action("ServoToNail")
def servo_to_nail(goal: ServoToTargetGoal, ctx: Context) -> Generator[Feedback, None, ServoToTargetResult]:
    """Servos on the corners of the nail's markers until the nail passes through the loop."""
    robot, board = ctx.robot, NailBoard()
    ids = ctx.world.site.plant(goal.target.plant).markers
    T_hand_camera = camera_mount(ctx)
    T_hand_nails = robot.hand.T_hand_nails(robot.description.gripper.open_angle)
    detector, K = MarkerDetector(MARKER_DICTIONARY), ctx.camera.latest().info.K
    clearance = checker_for(ctx, without=(ROW,), holding=False).clearance

    def desired(stand_off: float) -> Mapping[int, Array]:
        return desired_markers(goal.target, board, ids, T_hand_nails, T_hand_camera, stand_off)

    step = ctx.ledger.step("place", goal.target.plant, target=goal.target.as_record())
    with step, ctx.arm.lease("ServoToNail") as arm:

        def look() -> Generator[Feedback, None, None]:
            return look_around(
                ctx, arm, marker_in_view(detector, ids), name="ServoToNail", what=f"markers {sorted(ids)}",
                away=goal.target.approach, checker=checker_for(ctx),
            )  # fmt: skip

        def attempt() -> Generator[Feedback, None, ServoOutcome]:
            servo = MarkerServo(
                {i: lambda stand_off, i=i: desired(stand_off)[i] for i in ids},  # type: ignore[misc]
                MARKER_SIDE_M,
                K,
                MarkerServoOptions(standoff_m=goal.stand_off_m, stop_px=1.0, stop_frames=6),
            )
            return (
                yield from servo_on_markers(
                    ctx, arm, servo, desired, detector, MARKER_SIDE_M,
                    name="ServoToNail", status="servoing to target", timeout_s=goal.timeout_s, clearance=clearance,
                )
            )  # fmt: skip

        return (yield from servo_to_target(goal, ctx, arm, T_hand_nails, attempt, look))
