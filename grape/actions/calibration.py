"""What the arm's encoders are off: shown by servoing, adopted when nothing that was seen before is in use any more."""

from __future__ import annotations

import numpy as np

from grape.actions.core import Context
from grape.actions.hand_path import JOINT_OFFSETS
from grape.messages import Array

ENCODER_OFFSETS = "encoder_offsets"  # in the ledger's memory of this stop


def adopt_offsets(ctx: Context) -> None:
    """From the next beat on joint angles are told without the offsets that servoing has shown since the last call.

    Everything in base_link that was seen by the wrist's sensors moves by that, so it is done between two stops.
    """
    shown: Array | None = ctx.world.committed.pop(JOINT_OFFSETS, None)
    if shown is not None:
        calibrate(ctx, shown)


def calibrate(ctx: Context, offsets: Array) -> None:
    """From the next beat on joint angles are told without `offsets` (n,) rad, on top of those that were known."""
    known = ctx.world.encoder_offsets
    ctx.world.encoder_offsets = np.array(offsets if known is None else known + offsets)


def remember_offsets(ctx: Context) -> None:
    """Keeps the offsets for a resumed mission that finds the robot at the same stop."""
    if ctx.world.encoder_offsets is not None:
        ctx.ledger.remember(ENCODER_OFFSETS, ctx.world.encoder_offsets.tolist())


def recall_offsets(ctx: Context) -> None:
    """What `remember_offsets` has kept at this stop is known again."""
    offsets = ctx.ledger.recall(ENCODER_OFFSETS)
    if offsets is not None:
        ctx.world.encoder_offsets = np.array(offsets)
