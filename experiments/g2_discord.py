"""EKF and AMCL where sources fail: no GNSS, AMCL one vine off along the row, GNSS half a metre off for a while."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from grape.experiments.g2_tracks import Track, followed
from grape.experiments.laser_worlds import VINE_SPACING
from grape.experiments.session_laser import FilterWithAmcl
from grape.experiments.skid_steer_log import PERIOD_S, SkidSteerLog
from grape.localization import Reading
from grape.messages import Array

ALIAS_S, HELD_S = 400.0, (460.0, 480.0)  # both in the second row
WATCHED_S = 40.0  # from the beginning of each
SOURCES = {"alias": "amcl", "held": "gnss"}
A_SECOND = round(1.0 / PERIOD_S)
Spell = tuple[float, float]


def spoilt(log: SkidSteerLog, both: FilterWithAmcl, jump: Array, silent: Sequence[Spell]) -> tuple[Track, list[Any]]:
    """The track of the filter with AMCL where both sources are spoilt in turn.

    Args:
        jump: (3,) degrees and m, added to the fixes of `HELD_S`.
        silent: times without GNSS, s.

    Returns:
        the track, and (s, source, sigma) of each discord, once a second.
    """
    said: list[Any] = []
    shifts = iter([ALIAS_S, np.inf])
    shift = next(shifts)

    def take(reading: Reading) -> None:
        nonlocal shift
        if reading.sensor == "gnss" and HELD_S[0] <= reading.stamp <= HELD_S[1]:
            reading = replace(reading, geodetic=reading.geodetic + jump)
        if reading.stamp >= shift:
            both.input.amcl.poses[:, 0] += VINE_SPACING
            shift = next(shifts)
        both.take(reading)
        if reading.sensor == "wheels" and round(reading.stamp / PERIOD_S) % A_SECOND == 0:
            said.extend((reading.stamp, discord.source, discord.sigma) for discord in both.discords)

    return followed(log, both.fusion, take, filter(partial(heard, silent), log.readings)), said


def accounted(clean: Track, trouble: Track, said: Sequence[Any]) -> dict[str, Any]:
    """How far the estimate was from that of the unspoilt sources, and when the discord was told; as JSON takes it."""
    found: dict[str, Any] = {}
    told = np.zeros(len(said), bool)
    for name, begins in (("alias", ALIAS_S), ("held", HELD_S[0])):
        a, b = (track.between(begins, begins + WATCHED_S) for track in (clean, trouble))
        if not len(a.stamps) or a.stamps[-1] < begins + WATCHED_S - 1.0:
            continue
        mine = np.array([s == SOURCES[name] and begins <= t <= begins + WATCHED_S for t, s, _ in said], bool)
        told |= mine
        stamps = [said[k][0] for k in np.flatnonzero(mine)]
        found[name] = {
            "off": float(np.hypot(*(a.said - b.said).T).max()),
            "told_after": float(stamps[0] - begins) if stamps else None,
            "told_for": len(stamps),
            "sigma": float(max((said[k][2] for k in np.flatnonzero(mine)), default=0.0)),
        }
    found["false_s"] = int(np.count_nonzero(~told))
    return found


def heard(silent: Sequence[Spell], reading: Reading) -> bool:
    """Whether a reading comes: none of GNSS in the silent times."""
    return reading.sensor != "gnss" or not any(first <= reading.stamp <= last for first, last in silent)
