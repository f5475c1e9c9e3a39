"""What every servo run shares: its stages, and how much it may move while frames or features are late."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import isnan

from grape.errors import ActionFailed, Reason

BEAT_MAX_S = 0.05  # a longer pause between two commands does not count as motion time


class ServoStage(StrEnum):
    """Where a servo run stands."""

    STAND_OFF = "stand_off"
    DESCEND = "descend"
    FINAL = "final"
    CONVERGED = "converged"


class FeatureWatch:
    """How long ago frames came and features were seen, and what share of the motion that leaves.

    Args:
        what: the features, for error texts.
        fade_from_s, fade_to_s: age of the last seen feature between which the motion fades to zero.
        lost_s: age at which the run is given up.
    """

    def __init__(self, what: str, fade_from_s: float, fade_to_s: float, lost_s: float) -> None:
        self._what = what
        self._fade, self._lost_s = (fade_from_s, fade_to_s), lost_s
        self._first = self._last_frame = self._last_seen = self._last_command = float("nan")

    @property
    def ever_seen(self) -> bool:
        """Whether any frame has shown the features."""
        return not isnan(self._last_seen)

    def frame(self, stamp: float) -> bool:
        """A frame taken at `stamp` has come; false when it is not newer than the last one."""
        if stamp <= self._last_frame:
            return False
        self._last_frame = stamp
        self._begin(stamp)
        return True

    def seen(self, stamp: float) -> None:
        """The frame taken at `stamp` shows the features."""
        self._last_seen = stamp

    def beat(self, now: float) -> float:
        """Seconds since the last command, for which a command is made now; 0 the first time."""
        self._begin(now)
        last, self._last_command = self._last_command, now
        return 0.0 if isnan(last) else min(max(now - last, 0.0), BEAT_MAX_S)

    def share(self, now: float, *, blind: bool = False) -> float:
        """1 while features are fresh, falling to 0 when they are not.

        Args:
            blind: features need not be seen any more.

        Raises:
            ActionFailed: STALE_DATA when no frame came for too long, FEATURE_LOST when none showed the features.
        """
        since_frame = now - (self._first if isnan(self._last_frame) else self._last_frame)
        since_seen = now - (self._last_seen if self.ever_seen else self._first)
        if since_frame > self._lost_s:
            raise ActionFailed(Reason.STALE_DATA, f"no camera frame for {since_frame:.1f} s")
        if blind:
            return 1.0
        if since_seen > self._lost_s:
            raise ActionFailed(Reason.FEATURE_LOST, f"{self._what} not seen for {since_seen:.1f} s")
        if not self.ever_seen:
            return 0.0
        fade_from, fade_to = self._fade
        return min(max((fade_to - since_seen) / (fade_to - fade_from), 0.0), 1.0)

    def _begin(self, now: float) -> None:
        if isnan(self._first):
            self._first = now


@dataclass(kw_only=True)
class StageGate:
    """Moves a run on when its error was small for enough frames in a row.

    Args:
        standoff_limit, standoff_frames: for the way in to begin.
        stop_limit, stop_frames: at stand-off 0, for the run to be over.
    """

    standoff_limit: float
    standoff_frames: int
    stop_limit: float
    stop_frames: int
    good_frames: int = 0

    def miss(self) -> None:
        """A frame did not show the features."""
        self.good_frames = 0

    def after(self, stage: ServoStage, error: float, standoff_m: float) -> ServoStage:
        """The stage after a frame with `error` at a stand-off."""
        if stage is ServoStage.DESCEND and standoff_m <= 0.0:
            stage, self.good_frames = ServoStage.FINAL, 0
        if stage not in (ServoStage.STAND_OFF, ServoStage.FINAL):
            return stage
        first = stage is ServoStage.STAND_OFF
        limit, frames = (self.standoff_limit, self.standoff_frames) if first else (self.stop_limit, self.stop_frames)
        self.good_frames = self.good_frames + 1 if error < limit else 0
        if self.good_frames < frames:
            return stage
        self.good_frames = 0
        return ServoStage.DESCEND if first else ServoStage.CONVERGED


def descent(standoff_m: float, speed: float, slow_m: float) -> float:
    """m/s at which a stand-off shrinks: `speed`, and from `slow_m` on less, down to two fifths of it."""
    return speed * min(max(standoff_m / slow_m, 0.4), 1.0) if standoff_m > 0.0 else 0.0
