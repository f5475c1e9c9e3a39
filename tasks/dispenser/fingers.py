"""Turning the fingers while the arm keeps their nails where they are."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from grape.actions.core import Context, Feedback
from grape.actions.hand_path import HandPathOptions, follow_hand_path, smooth_step
from grape.drivers import ArmDriver, GripperDriver
from grape.geometry import interpolate, inverse
from grape.messages import Array

CLOSE_S = 2.0  # to close fully opened fingers
CAREFUL_S = 5.0  # the same beside the wood of a spur: what the nails meet there is felt before they press on it


def finger_angle(ctx: Context) -> tuple[float, float]:
    """rad, and 0 (closed) to 1 (open)."""
    gripper = ctx.robot.description.gripper
    angle = gripper.closed_angle if ctx.world.gripper is None else float(ctx.world.gripper.position[1:].mean())
    return angle, (angle - gripper.closed_angle) / (gripper.open_angle - gripper.closed_angle)


def turn_fingers(
    ctx: Context,
    arm: ArmDriver,
    fingers: GripperDriver,
    nails: tuple[Array, Array],
    angles: tuple[float, float],
    duration_s: float,
    *,
    status: str,
    options: HandPathOptions | None = None,
) -> Generator[Feedback, None, None]:
    """Turns the fingers from one of `angles` (rad) to the other while the nails go from one pose to the other.

    Args:
        ctx: context.
        arm, fingers: leased.
        nails: `T_base_nails` (4, 4) at the beginning and in the end: the same where they stay in place.
        angles: rad, of the fingers at the beginning and in the end.
        duration_s: of the whole turn.
        status: for feedback.
        options: how closely the hand must follow.

    Raises:
        ActionFailed: as in `follow_hand_path`.
    """
    thumb = ctx.robot.description.gripper.thumb_clear

    def angle_at(t: float) -> float:
        return angles[0] + smooth_step(t / duration_s) * (angles[1] - angles[0])

    def hand_at(t: float) -> Array:
        T_base_nails = interpolate(*nails, smooth_step(t / duration_s))
        return np.asarray(T_base_nails @ inverse(ctx.robot.hand.T_hand_nails(angle_at(t))))

    yield from follow_hand_path(
        ctx, arm, hand_at, duration_s, status=status, gripper=fingers,
        fingers_at=lambda t: np.array([thumb, angle_at(t), angle_at(t)]), options=options,
    )  # fmt: skip
