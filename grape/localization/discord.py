"""Whether two estimates of the robot's pose agree, before one of them is believed.

AMCL that slipped into the next row, or GNSS that jumped, looks sure of itself. Fused as one more measurement it drags
the filter to and fro; here it becomes a typed answer that says by how much, and for how long.
Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4
(normalised innovation squared).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import wrap_angle
from grape.localization.amcl import AmclEstimate
from grape.localization.state import STATE, Measurement
from grape.messages import Array, frozen_array


class Accord(StrEnum):
    """What two estimates say of each other."""

    AGREE = "agree"
    SUSPECT = "suspect"  # apart, but not often enough in a row
    DISCORD = "discord"  # apart, again and again
    UNSURE = "unsure"  # one of them does not know where it is


@dataclass(frozen=True, kw_only=True)
class PlanarBelief:
    """A pose (3,) x y yaw in map with its covariance (3, 3)."""

    pose: Array
    covariance: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen_array(self.pose, float))
        object.__setattr__(self, "covariance", frozen_array(self.covariance, float))
        if self.pose.shape != (3,) or self.covariance.shape != (3, 3):
            raise InvalidInput(f"(3,) and (3, 3) needed, got {self.pose.shape} and {self.covariance.shape}")
        if not (np.isfinite(self.pose).all() and np.isfinite(self.covariance).all()):
            raise InvalidInput("pose and covariance must be finite")


@dataclass(frozen=True, kw_only=True)
class DiscordOptions:
    """`gate`: chi-square of 3 degrees of freedom above which estimates are apart (16.3 for one in a thousand).

    Covariances are never believed below `least_way` (m) and `least_turn` (rad) of each estimate. `patience` is how
    often in a row estimates are apart before it is discord, and how often near before that ends. An estimate that is
    known worse than `unsure_way`, or an AMCL cluster below `least_share`, says nothing.
    """

    gate: float = 16.3
    least_way: float = 0.10
    least_turn: float = 0.03
    patience: int = 3
    unsure_way: float = 1.0
    least_share: float = 0.6

    def __post_init__(self) -> None:
        if self.patience < 1 or not self.gate > 0:
            raise InvalidInput(f"patience from 1 and a gate above 0 needed, got {self}")


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """The answer: what it is, the offset (3,) x y yaw of the second from the first, and how unlikely that is.

    Args:
        distance: m between the two.
        chi_square: of the offset; the gate is `DiscordOptions.gate`.
        in_a_row: how many comparisons in a row said the same (near, or apart).
    """

    accord: Accord
    offset: Array
    distance: float
    chi_square: float
    in_a_row: int


class DiscordWatch:
    """Compares two estimates again and again, and calls discord what lasts."""

    def __init__(self, options: DiscordOptions | None = None) -> None:
        self.options = options or DiscordOptions()
        self._apart = False
        self._in_a_row = 0
        self._discord = False

    def compare(self, first: PlanarBelief, second: PlanarBelief, share: float = 1.0) -> Agreement:
        """Compare estimates of the same time; `share` is the AMCL cluster's weight where one of them is AMCL's."""
        options = self.options
        offset = second.pose - first.pose
        offset[2] = wrap_angle(offset[2])
        floor = np.diag([options.least_way**2, options.least_way**2, options.least_turn**2])
        chi = float(offset @ np.linalg.solve(first.covariance + second.covariance + 2.0 * floor, offset))
        widest = max(np.linalg.eigvalsh(belief.covariance[:2, :2])[-1] for belief in (first, second))
        if widest > options.unsure_way**2 or share < options.least_share:
            return self._answer(Accord.UNSURE, offset, chi)
        apart = chi > options.gate
        self._in_a_row = self._in_a_row + 1 if apart == self._apart else 1
        self._apart = apart
        if self._in_a_row >= options.patience:
            self._discord = apart
        if apart:
            return self._answer(Accord.DISCORD if self._discord else Accord.SUSPECT, offset, chi)
        return self._answer(Accord.SUSPECT if self._discord else Accord.AGREE, offset, chi)

    def _answer(self, accord: Accord, offset: Array, chi: float) -> Agreement:
        return Agreement(
            accord=accord,
            offset=frozen_array(offset),
            distance=float(np.hypot(offset[0], offset[1])),
            chi_square=chi,
            in_a_row=self._in_a_row,
        )


def belief_of(estimate: AmclEstimate) -> PlanarBelief:
    """AMCL's estimate for a comparison."""
    return PlanarBelief(pose=estimate.pose, covariance=estimate.covariance)


def from_amcl(
    stamp: float, estimate: AmclEstimate, agreement: Agreement, least_way: float = 0.05, least_turn: float = 0.02
) -> Measurement | None:
    """AMCL's pose as a measurement of the filter; None unless it is fresh and the two agree.

    Args:
        agreement: of the filter's belief with this estimate.
        least_way, least_turn: m and rad, standard deviations it is never believed below: particles of successive
            updates are not independent.
    """
    if agreement.accord is not Accord.AGREE or not estimate.updated:
        return None
    index = [STATE.index(name) for name in ("x", "y", "yaw")]
    floor = np.diag([least_way**2, least_way**2, least_turn**2])
    return Measurement(
        stamp=stamp, source="amcl", index=np.array(index), value=estimate.pose, covariance=estimate.covariance + floor
    )
