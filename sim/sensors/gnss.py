"""Modes of an RTK receiver: centimetre fixes, now and then a float solution with a bias that steps and stays.

Source: facts sheet, section 3 (GNSS mode model: fix to float once per 200 s, held 5-30 s, bias 0.05-0.5 m).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class GnssModel:
    """Errors of an RTK receiver, metres."""

    fix_sigma: float = 0.012  # horizontal, each axis
    fix_sigma_up: float = 0.025
    float_sigma: float = 0.03
    float_bias: tuple[float, float] = (0.05, 0.5)  # length of the horizontal bias of a float spell
    float_rate: float = 1.0 / 200.0  # float spells per second of fix; 0 switches them off
    float_hold_s: tuple[float, float] = (5.0, 30.0)


@dataclass(frozen=True, kw_only=True)
class FloatSpell:
    """A time without integer fix: from `start` to `end` (s) all positions are shifted by `bias` (3,) m.

    With `wrong_fix` the receiver takes what it has for a fix.
    """

    start: float
    end: float
    bias: Array
    wrong_fix: bool = False


def float_spells(model: GnssModel, rng: np.random.Generator, until_s: float = 4 * 3600.0) -> tuple[FloatSpell, ...]:
    """Every float spell of a run of at most `until_s` seconds."""
    spells: list[FloatSpell] = []
    time_s = 0.0
    while model.float_rate > 0:
        start = time_s + rng.exponential(1.0 / model.float_rate)
        if start > until_s:
            break
        time_s = start + rng.uniform(*model.float_hold_s)
        heading, length = rng.uniform(0, 2 * np.pi), rng.uniform(*model.float_bias)
        bias = length * np.array([np.cos(heading), np.sin(heading), rng.uniform(-1, 1)])
        spells.append(FloatSpell(start=start, end=time_s, bias=bias))
    return tuple(spells)
