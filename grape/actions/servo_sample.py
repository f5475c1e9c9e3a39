"""What one frame of a servo run came to, for the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grape.actions.core import Recorder
from grape.messages import Array, RgbdImage

SEEN_BGR, WANTED_BGR = (0, 255, 255), (255, 0, 255)


@dataclass(frozen=True, eq=False)
class ServoSample:
    """Where the features are and where they should be.

    Attributes:
        error_px: inf before any was seen.
        seen: points (n, 2) px by marker.
        wanted: points (n, 2) px of each marker in use.
        converged: whether that is enough.
    """

    image: RgbdImage
    error_px: float
    seen: Mapping[int, Array]
    wanted: Sequence[Array]
    converged: bool

    def record(self, log: Recorder, action: str) -> None:
        """Tells it as an event of an action's run."""
        log.event(
            "servo_sample",
            action=action,
            t=self.image.stamp,
            error_px=self.error_px,
            ids=[*self.seen],
            corners=[place for places in self.seen.values() for place in places.tolist()],
            desired=[place for places in self.wanted for place in places.tolist()],
        )

    def picture(self) -> Array:
        """The frame (h, w, 3), a diamond where each point is and a cross where it should be."""
        import cv2

        bgr = np.array(self.image.bgr)
        for kind, colour, groups in (
            (cv2.MARKER_DIAMOND, SEEN_BGR, [*self.seen.values()]),
            (cv2.MARKER_CROSS, WANTED_BGR, self.wanted),
        ):
            for place in np.concatenate([np.zeros((0, 2)), *groups]):
                if np.abs(place).max() < 1e4:
                    cv2.drawMarker(bgr, np.round(place).astype(int).tolist(), colour, kind, 12, 1)
        return bgr
