"""Where and how to hang a dispenser, and the poses of the hand that do it.

The loop is held by both nails at its middle; its long axis is y of the hand. A spur (or nail) is to pass through the
loop on the +y side of the nail line. Source: grape's contact study (docs/decisions.md, "Contact").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from grape.actions.core import Context
from grape.errors import InvalidInput
from grape.geometry import inverse, pose, rotation_x, rotation_z, transform
from grape.messages import Array, frozen_array
from grape.planning import Ball

AIM_OFFSET_M = 0.028  # from the nail line to where the spur passes the loop, along the hand's y
AIM_DEPTH_M = 0.030  # how far the loop is pushed over the tip
# What the hand may touch: what was seen so far from the spur, from beyond its tip down to where the fingers come.
TOUCH_RADIUS_M, TOUCH_BEYOND_M, TOUCH_DOWN_M = 0.04, 0.015, 0.06
TOUCH_UNSURE_M = 0.12  # around the tip, where the arm's zeros are not known and the cloud is that far off
SPURS = "spurs"  # in the ledger: what was found from this stop, whether or not the arm reaches it
FELT_MAX = 0.3  # of what an arm may feel elsewhere; of its own friction it feels 0.22, of nails that press by 8 N 0.4
RETREAT_M = 0.14  # straight back along the fingers after letting go


@dataclass(frozen=True, kw_only=True, eq=False)
class HangTarget:
    """One place where a dispenser can hang, valid until the base moves.

    Attributes:
        plant: id in the site file.
        kind: nail or spur.
        tip: (3,) m in base_link, the free end of nail or spur.
        direction: (3,) unit vector in base_link from its base to its tip.
        pitch: rad, how far the hand tilts from pointing down (0) towards pointing at the row (pi/2).
        azimuth: rad about base_link z; 0 points the pitched hand to the robot's left.
        diameter: m.
        score: 0..1 of the list it comes from, 1 for a nail.
        up: (3,) unit vector against gravity in base_link when it was seen; None: unknown.
    """

    plant: str
    kind: str
    tip: Array
    direction: Array
    pitch: float
    azimuth: float = 0.0
    diameter: float = 0.008
    score: float = 1.0
    up: Array | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("nail", "spur"):
            raise InvalidInput(f"kind must be 'nail' or 'spur', got {self.kind!r}")
        for name in ("tip", "direction") if self.up is None else ("tip", "direction", "up"):
            value = np.asarray(getattr(self, name), float)
            if value.shape != (3,) or not np.isfinite(value).all():
                raise InvalidInput(f"{name} must be three finite numbers, got {value}")
            object.__setattr__(self, name, frozen_array(value))

    def as_record(self) -> dict[str, Any]:
        """The target as JSON has it, for the ledger."""
        plain = np.ndarray | np.generic
        return {name: v.tolist() if isinstance(v, plain) else v for name, v in asdict(self).items()}

    def moved(self, T: Array, up: Array | None) -> HangTarget:
        """The same place after base_link has moved: `T` (4, 4) takes what was seen to where it is now."""
        return replace(self, tip=transform(T, self.tip), direction=T[:3, :3] @ self.direction, up=up)

    @property
    def approach(self) -> Array:
        """(3,) unit vector in base_link along which the loop backs off the tip.

        Level hands slide along the nail; pitched hands come half way between the vertical and the spur's axis.
        """
        axis = self.direction if self.kind == "nail" else np.array([0.0, 0.0, 1.0]) + 0.6 * self.direction * [1, 1, 0]
        return axis / np.linalg.norm(axis)

    def touched(self) -> tuple[Ball, ...]:
        """Balls in base_link in which the hand may touch what was seen there: nail or spur, not their neighbours."""
        count = round((TOUCH_BEYOND_M + TOUCH_DOWN_M) / (0.25 * TOUCH_RADIUS_M)) + 1
        along = np.linspace(TOUCH_BEYOND_M, -TOUCH_DOWN_M, count)
        return tuple((self.tip + s * self.direction, TOUCH_RADIUS_M) for s in along)

    def rotation(self) -> Array:
        """`R_base_hand` while hanging."""
        return rotation_z(self.azimuth) @ rotation_x(self.pitch)

    def hand_pose(self, T_hand_nails: Array, back_off: float = 0.0) -> Array:
        """`T_base_hand` that holds the loop's aim point `AIM_DEPTH_M` over the tip.

        Args:
            T_hand_nails: (4, 4) the nails' mid-point in the hand at the present finger angle.
            back_off: m back along `approach` from that final pose.
        """
        R = self.rotation()
        nails = self.tip + self.approach * (back_off - AIM_DEPTH_M) - R @ [0.0, AIM_OFFSET_M, 0.0]
        T_base_nails = pose(R, nails)
        return T_base_nails @ inverse(pose(None, T_hand_nails[:3, 3]))


def hang_line(robot: Any, target: HangTarget, stand_off: float) -> tuple[Array, ...]:
    """The hand's whole way at a target, (4, 4) poses in base_link: stand-off, over the tip, fingers closed, backed off.

    Args:
        robot: models of the robot (`grape.actions.robot.Robot`).
        target: where to hang.
        stand_off: m.
    """
    gripper = robot.description.gripper
    opened, closed = (robot.hand.T_hand_nails(angle) for angle in (gripper.open_angle, gripper.closed_angle))
    over = target.hand_pose(opened)
    released = over @ opened @ inverse(closed)
    return target.hand_pose(opened, stand_off), over, released, released @ pose(None, (0.0, 0.0, RETREAT_M))


def remember_spurs(ctx: Context, targets: Sequence[HangTarget]) -> None:
    """Keeps every spur that was found from this stop in the ledger, for the choice of another stop."""
    ctx.ledger.remember(SPURS, [target.as_record() for target in targets])


def recall_spurs(ctx: Context, plant: str) -> tuple[HangTarget, ...]:
    """The spurs of a plant, in base_link, that were found since the base moved last; none when nothing was."""
    records = ctx.ledger.recall(SPURS) or ()
    return tuple(HangTarget(**record) for record in records if record["plant"] == plant)
