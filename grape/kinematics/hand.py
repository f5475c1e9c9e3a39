"""Where the nails of a hand are for a finger angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import pose, rotation_exp
from grape.messages import Array


class NailGeometry(Protocol):
    """The constants of a hand with two nails, as a robot description gives them (hand frame, metres, radians)."""

    @property
    def pivot(self) -> Array: ...
    @property
    def axis(self) -> Array: ...
    @property
    def radius(self) -> float: ...
    @property
    def reference(self) -> float: ...
    @property
    def nail_x(self) -> float: ...


@dataclass(frozen=True)
class HandModel:
    """Closed-form kinematics of the nails on fingers 2 and 3; the fingers mirror each other in the hand's y-z plane."""

    geometry: NailGeometry

    def nail(self, q_finger: float) -> Array:
        """Groove of the nail on finger 2 (3,), hand frame; finger 3 has the opposite x.

        Raises:
            InvalidInput: the angle is not finite.
        """
        if not np.isfinite(q_finger):
            raise InvalidInput(f"a finger angle must be finite, got {q_finger}")
        g = self.geometry
        arm = np.array([g.nail_x - g.pivot[0], 0.0, -g.radius])
        return np.asarray(g.pivot + rotation_exp(g.axis * (q_finger - g.reference)) @ arm)

    def T_hand_nails(self, q_finger: float) -> Array:
        """Pose (4, 4) of the mid-point between both grooves, with the hand's axes, for equal finger angles (rad)."""
        _, y, z = self.nail(q_finger)
        return pose(translation=(0.0, float(y), float(z)))

    def gap(self, q_finger: float) -> float:
        """Distance (m) between both grooves along the hand's x."""
        return 2.0 * float(self.nail(q_finger)[0])
