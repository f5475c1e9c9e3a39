"""From where a vine was scanned: once the joints' offsets are known, what the scan told can be put right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from grape.actions.core import Context
from grape.actions.hand_path import JOINT_OFFSETS, hand_correction
from grape.geometry import inverse, transform
from grape.messages import Array
from grape.tasks.dispenser.targets import HangTarget

VIEWS = "scan_views"  # in the ledger's memory of this stop: camera pose and joint angles of each depth frame
NEAREST_M = 0.15  # a point nearer to the camera than this was not seen from there


def remember_views(ctx: Context, T_base_camera: Sequence[Array], joints: Sequence[Array]) -> None:
    """Keeps camera poses (4, 4) and joint angles (n,) rad, as the encoders told both, of the frames of a scan."""
    ctx.ledger.remember(VIEWS, [[T.tolist(), q.tolist()] for T, q in zip(T_base_camera, joints, strict=True)])


def as_calibrated(ctx: Context, target: HangTarget) -> HangTarget:
    """The target where it is by the joints' offsets that servoing has shown; unchanged where nothing is known of them.

    What a scan puts into base_link is as wrong there as the arm was in the posture from which it was seen.
    """
    views = [(np.array(T), np.array(q)) for T, q in ctx.ledger.recall(VIEWS) or ()]
    if not views or JOINT_OFFSETS not in ctx.world.committed:
        return target

    def off_centre(view: tuple[Array, Array]) -> float:
        x, y, z = transform(inverse(view[0]), target.tip)
        return float(np.hypot(x, y) / z) if z > NEAREST_M else np.inf

    T = hand_correction(ctx, min(views, key=off_centre)[1])
    return replace(target, tip=transform(T, target.tip), direction=T[:3, :3] @ target.direction)
