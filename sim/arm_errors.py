"""What a real arm does worse than its model: zeros of joints are off, gears have play, joints trail and overrun.

Open loop, the hand of the real arm ended 0 to 5 cm off. Source: facts sheet, section 2, reference behaviour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array, frozen_array

# Largest errors at level 1, for a joint at the shoulder end and at the wrist of the arm.
BIAS_RAD = np.radians((2.6, 3.0))
PLAY_RAD = np.radians((0.10, 0.15))
RATE = 0.04  # share of the speed
TRAILING = 0.3  # share of the servo's lag that the arm's controller does not make up for


@dataclass(frozen=True, kw_only=True)
class ArmErrors:
    """The errors of one arm; they stay the same for a whole mission.

    Attributes:
        bias: (n,) rad, the encoders tell so much more than the links have turned.
        play: (n,) rad between the two flanks of each gear: after a reversal the link follows when the play is used up.
        rate: (n,) share by which a joint overruns its velocity set-point.
        trailing: share of the servo's lag behind a moving set-point that remains.
    """

    bias: Array
    play: Array
    rate: Array
    trailing: float = 0.0

    def __post_init__(self) -> None:
        for name in ("bias", "play", "rate"):
            value = frozen_array(getattr(self, name), float)
            if value.shape != np.shape(self.bias) or not np.isfinite(value).all():
                raise InvalidInput(f"arm errors: {name} must be {np.shape(self.bias)} finite numbers, got {value}")
            object.__setattr__(self, name, value)
        if (self.play < 0).any():
            raise InvalidInput(f"arm errors: play cannot be negative, got {self.play}")


def draw_arm_errors(rng: np.random.Generator, joints: int, level: float = 1.0) -> ArmErrors:
    """The errors of an arm as it comes: bias uniform in both directions, play between half and all of the largest.

    Args:
        rng: drawn from the mission's seed.
        joints: of the arm; the first half counts as the shoulder end.
        level: 0 for a perfect arm, 1 for one as bad as the measured one.

    Raises:
        InvalidInput: a negative level.
    """
    if not (np.isfinite(level) and level >= 0.0):
        raise InvalidInput(f"the level of arm errors must be 0 or more, got {level}")
    wrist = (np.arange(joints) >= joints / 2).astype(int)
    return ArmErrors(
        bias=level * BIAS_RAD[wrist] * rng.uniform(-1.0, 1.0, joints),
        play=level * PLAY_RAD[wrist] * rng.uniform(0.5, 1.0, joints),
        rate=level * RATE * rng.uniform(-1.0, 1.0, joints),
        trailing=min(level * TRAILING, 1.0),
    )
